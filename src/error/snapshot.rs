//! What can be wrong with a snapshot in bytes.

use std::error::Error;
use std::fmt;

/// Why bytes are not those of a snapshot.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SnapshotError {
    /// They do not begin as those of any snapshot do.
    Format,
    /// They are those of a snapshot of another kind.
    Kind {
        /// The name of its type, or "unknown".
        found: &'static str,
        /// That of the type asked for.
        expected: &'static str,
    },
    /// They are in another version of the format.
    Version {
        /// The version.
        found: u8,
        /// The one that is read.
        expected: u8,
    },
    /// Some of them have changed, or are missing: their sum is not the one that they end
    /// with.
    Checksum {
        /// The sum of the bytes.
        found: u64,
        /// The sum that they say they have.
        expected: u64,
    },
    /// They end too early.
    Length {
        /// How many there are.
        found: usize,
        /// How many are needed at least.
        expected: usize,
    },
    /// There are more of them than the snapshot takes.
    Trailing {
        /// How many.
        bytes: usize,
    },
    /// The control of a past step could not be read.
    Control {
        /// Which of the past steps, from 0.
        index: usize,
    },
    /// Their numbers are none that a stream can have.
    Contents {
        /// What was found, and what was expected.
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
