//! Errors of map matching.

use wayfix::HmmError;
use wayfix::error::{At, OutOfRange};
use wayfix::internal::Number;

/// A drive that cannot be matched.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum MatchError {
    /// A parameter of the model, or the mass that roads should hold, is out of range.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
    /// A number of a point is out of range.
    #[error("point {point} has {what} {value}, expected {expected}", value = Number(*.value))]
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
    #[error(
        "point {point} has time {time}, expected one after that of the point before, {before}",
        time = Number(*.time),
        before = Number(*.before)
    )]
    Time {
        /// Index of the point in its drive, from 0.
        point: usize,
        /// Time of the point.
        time: f64,
        /// Time of the point before.
        before: f64,
    },
    /// A drive without points.
    #[error("the drive has no points")]
    Empty,
    /// One of several drives cannot be matched.
    #[error(transparent)]
    Drive(At<Box<MatchError>>),
    /// A vehicle or a drive comes from a matcher of another network.
    #[error(
        "the vehicle or drive is from another network: expected fingerprint {expected:016x}, found {found:016x}"
    )]
    Network {
        /// Fingerprint of the network of the vehicle or drive.
        found: u64,
        /// Fingerprint of the network of this matcher.
        expected: u64,
    },
    /// A stored vehicle is on an edge that its network does not have: what was stored was changed.
    #[error("the vehicle is on edge {edge}, but the network has {edges} edges (0 to {})", .edges.saturating_sub(1))]
    Vehicle {
        /// An edge of the vehicle.
        edge: usize,
        /// Number of edges of the network.
        edges: usize,
    },
    /// Inference failed.
    #[error(transparent)]
    Inference(#[from] HmmError),
}

impl MatchError {
    /// Wraps the error of one of several drives.
    pub(super) fn of_drive(self, drive: usize) -> Self {
        Self::Drive(At::new(&["drive ", ""], drive, Box::new(self)))
    }
}
