//! [`SnapshotError`]: errors of reading a snapshot from bytes.

use super::Count;

/// Bytes that are not a valid snapshot.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SnapshotError {
    /// The bytes do not begin with the header of a snapshot.
    #[error("the bytes do not begin with the header of a snapshot")]
    Format,
    /// The bytes hold a snapshot of another type.
    #[error("the bytes are of type {found}, expected {expected}")]
    Kind {
        /// Name of the type found, or "unknown".
        found: &'static str,
        /// Name of the type asked for.
        expected: &'static str,
    },
    /// The bytes are in another version of the format.
    #[error("the bytes are of version {found}, expected {expected}")]
    Version {
        /// Version found.
        found: u8,
        /// Version that can be read.
        expected: u8,
    },
    /// Some bytes were changed or are missing: the checksum does not match.
    #[error("the bytes are damaged: their checksum is {found:#x}, expected {expected:#x}")]
    Checksum {
        /// Checksum of the bytes.
        found: u64,
        /// Checksum stored at their end.
        expected: u64,
    },
    /// The bytes end too early.
    #[error("the snapshot ends after {found} bytes, expected at least {expected}")]
    Length {
        /// Number of bytes found.
        found: usize,
        /// Smallest number of bytes needed.
        expected: usize,
    },
    /// There are bytes after the end of the snapshot.
    #[error(transparent)]
    Trailing(Count),
    /// The numbers are not a valid state of a stream.
    #[error("{reason}")]
    Contents {
        /// The invalid number, and which values are valid.
        reason: String,
    },
}
