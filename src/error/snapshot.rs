//! Errors of reading a snapshot from bytes.

use std::error::Error;
use std::fmt;

/// Bytes that are not a valid snapshot.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SnapshotError {
    /// The bytes do not begin with the header of a snapshot.
    Format,
    /// The bytes are a snapshot of another type.
    Kind {
        /// Name of the type found, or "unknown".
        found: &'static str,
        /// Name of the type asked for.
        expected: &'static str,
    },
    /// The bytes are in another version of the format.
    Version {
        /// Version found.
        found: u8,
        /// Version that can be read.
        expected: u8,
    },
    /// Some bytes are changed or missing: the checksum does not match.
    Checksum {
        /// Checksum of the bytes.
        found: u64,
        /// Checksum stored at their end.
        expected: u64,
    },
    /// The bytes end too early.
    Length {
        /// Number of bytes found.
        found: usize,
        /// Least number of bytes needed.
        expected: usize,
    },
    /// There are bytes after the end of the snapshot.
    Trailing {
        /// Number of these bytes.
        bytes: usize,
    },
    /// The control of a past step could not be read.
    Control {
        /// Index of the past step, from 0.
        index: usize,
    },
    /// The numbers are not a valid state of a stream.
    Contents {
        /// The invalid number, with the valid values.
        reason: String,
    },
}

impl fmt::Display for SnapshotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Format => write!(f, "the bytes do not begin as those of a snapshot"),
            Self::Kind { found, expected } => {
                write!(f, "the bytes are of type {found}, expected {expected}")
            }
            Self::Version { found, expected } => {
                write!(f, "the bytes are of version {found}, expected {expected}")
            }
            Self::Checksum { found, expected } => {
                write!(f, "the bytes are damaged: their sum is {found:#x}, expected {expected:#x}")
            }
            Self::Length { found, expected } => {
                write!(f, "the snapshot ends after {found} bytes, expected at least {expected}")
            }
            Self::Trailing { bytes } => write!(f, "{bytes} bytes after the snapshot, expected 0"),
            Self::Control { index } => {
                write!(f, "the control of past step {index} could not be read")
            }
            Self::Contents { reason } => write!(f, "{reason}"),
        }
    }
}

impl Error for SnapshotError {}
