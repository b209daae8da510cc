//! Errors. Each names the file, the column and the row, where there is one.

use std::io;
use std::path::{Path, PathBuf};

use parquet::errors::ParquetError;

/// Reason why a run cannot start or continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FleetError {
    /// A file cannot be opened, read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// A file is not what its name or use suggests: damaged, truncated, or of another kind.
    #[error("{}: {message}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Cause, in words.
        message: String,
    },
    /// A column is missing, or has an unusable type.
    #[error("column `{column}`: {message}")]
    Column {
        /// Name of the column.
        column: String,
        /// Cause, in words.
        message: String,
    },
    /// An input value cannot be used.
    #[error("column `{column}`, row {row} (counted from 0): {message}")]
    Value {
        /// Name of the column.
        column: String,
        /// Row of the input, from 0.
        row: u64,
        /// Cause, in words.
        message: String,
    },
    /// A file is not the one that the finished parts were made from, or changes while it is read.
    #[error("{}: {message}", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// The piece that differs, in words.
        message: String,
    },
    /// One of several input files is at fault.
    #[error("{}: {source}", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: Box<FleetError>,
    },
    /// Settings contradict each other, the model, or the run they continue.
    #[error("{0}")]
    Settings(String),
    /// The model cannot be learned from these drives.
    #[error("learning failed: {0}")]
    Learning(String),
    /// A query is invalid, or fails.
    #[cfg(feature = "sql")]
    #[error("{0}")]
    Query(Box<datafusion::error::DataFusionError>),
    /// A process of a cluster cannot continue.
    #[cfg(feature = "ballista")]
    #[error("{0}")]
    Cluster(String),
    /// A record batch cannot be built.
    #[error(transparent)]
    Arrow(#[from] arrow_schema::ArrowError),
}

impl FleetError {
    /// Wraps an error of a file.
    pub(crate) fn file(path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| match source.get_ref() {
            // Readers can only return `io::Error`, so a replaced object travels inside one.
            Some(cause) if cause.is::<Replaced>() => Self::changed(path, cause.to_string()),
            _ => Self::File { path: path.to_owned(), source },
        }
    }

    /// Wraps an error of a Parquet file. I/O errors keep their kind: they say nothing about the
    /// contents, and a second run may succeed.
    pub(crate) fn parquet(path: &Path) -> impl Fn(ParquetError) -> Self {
        move |error| match error {
            ParquetError::External(cause) => match cause.downcast::<io::Error>() {
                Ok(source) => Self::file(path)(*source),
                Err(cause) => Self::format(path, cause),
            },
            other => Self::format(path, other),
        }
    }

    pub(crate) fn format(path: &Path, message: impl std::fmt::Display) -> Self {
        Self::Format { path: path.to_owned(), message: message.to_string() }
    }

    pub(crate) fn changed(path: &Path, message: impl Into<String>) -> Self {
        Self::Changed { path: path.to_owned(), message: message.into() }
    }

    /// Adds the file to the error, if it does not name one.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Self::Column { .. } | Self::Value { .. } | Self::Arrow(_) => {
                Self::InFile { path: path.to_owned(), source: Box::new(self) }
            }
            other => other,
        }
    }

    pub(crate) fn column(column: &str, message: impl Into<String>) -> Self {
        Self::Column { column: column.to_owned(), message: message.into() }
    }

    pub(crate) fn value(column: &str, row: u64, message: impl Into<String>) -> Self {
        Self::Value { column: column.to_owned(), row, message: message.into() }
    }
}

/// Cause of a [`FleetError::Changed`], inside an `io::Error`.
#[derive(Debug, thiserror::Error)]
#[error("was written to while it was read")]
pub(crate) struct Replaced;

#[cfg(feature = "sql")]
impl From<datafusion::error::DataFusionError> for FleetError {
    fn from(error: datafusion::error::DataFusionError) -> Self {
        Self::Query(Box::new(error))
    }
}

/// Result with an error of this crate.
pub type Outcome<T> = Result<T, FleetError>;
