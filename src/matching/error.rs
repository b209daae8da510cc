//! Errors of map matching.

use std::error::Error;
use std::fmt;

use crate::error::InferenceError;

/// A drive that cannot be matched.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum MatchError {
    /// A parameter of the model is out of range.
    Parameter {
        /// Name of the parameter.
        what: &'static str,
        /// Value found.
        value: f64,
        /// Valid values.
        expected: &'static str,
    },
    /// A number of a point is out of range.
    Point {
        /// Name of the number.
        what: &'static str,
        /// Value found.
        value: f64,
        /// Valid values.
        expected: &'static str,
    },
    /// A point is not later than the one before.
    Time {
        /// Time of the point.
        time: f64,
        /// Time of the point before.
        before: f64,
    },
    /// There are no points.
    Empty,
    /// A saved vehicle, or a drive, does not belong to this network.
    Vehicle {
        /// An edge of the vehicle.
        edge: usize,
        /// Number of edges of the network.
        edges: usize,
    },
    /// Inference failed.
    Inference(InferenceError),
}

impl fmt::Display for MatchError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Parameter { what, value, expected } => {
                write!(f, "the parameter {what} is {value}, expected {expected}")
            }
            Self::Point { what, value, expected } => {
                write!(f, "the point has {what} {value}, expected {expected}")
            }
            Self::Time { time, before } => write!(
                f,
                "the point has time {time}, expected one after that of the point before, {before}"
            ),
            Self::Empty => write!(f, "the drive has no points"),
            Self::Vehicle { edge, edges } => write!(
                f,
                "the vehicle is on edge {edge}, but the network has {edges} edges (0 to {})",
                edges.saturating_sub(1)
            ),
            Self::Inference(error) => fmt::Display::fmt(error, f),
        }
    }
}

impl Error for MatchError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Inference(error) => error.source(),
            _ => None,
        }
    }
}

impl From<InferenceError> for MatchError {
    fn from(source: InferenceError) -> Self {
        Self::Inference(source)
    }
}
