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
        /// Index of the point in its drive, from 0.
        point: usize,
        /// Name of the number.
        what: &'static str,
        /// Value found.
        value: f64,
        /// Valid values.
        expected: &'static str,
    },
    /// A point is not later than the one before.
    Time {
        /// Index of the point in its drive, from 0.
        point: usize,
        /// Time of the point.
        time: f64,
        /// Time of the point before.
        before: f64,
    },
    /// There are no points.
    Empty,
    /// One of several drives cannot be matched.
    Drive {
        /// Index of the drive, from 0.
        drive: usize,
        /// Error of the drive.
        source: Box<MatchError>,
    },
    /// A probability that roads are to hold is not above 0 and at most 1.
    Mass {
        /// Value found.
        mass: f64,
    },
    /// A vehicle, or a drive, was made by a matcher of another network.
    Network {
        /// Fingerprint of the network of the vehicle or drive.
        found: u64,
        /// Fingerprint of the network of this matcher.
        expected: u64,
    },
    /// A saved vehicle is on an edge that its network does not have: its bytes were changed.
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
            Self::Point { point, what, value, expected } => {
                write!(f, "point {point} has {what} {value}, expected {expected}")
            }
            Self::Time { point, time, before } => write!(
                f,
                "point {point} has time {time}, expected one after that of the point before, {before}"
            ),
            Self::Drive { drive, source } => write!(f, "drive {drive}: {source}"),
            Self::Mass { mass } => {
                write!(f, "the mass is {mass}, expected a probability above 0 and at most 1")
            }
            Self::Network { found, expected } => write!(
                f,
                "the network is another one: its fingerprint is {expected:016x}, that of the vehicle or drive {found:016x}"
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
            Self::Drive { source, .. } => source.source(),
            _ => None,
        }
    }
}

impl From<InferenceError> for MatchError {
    fn from(source: InferenceError) -> Self {
        Self::Inference(source)
    }
}
