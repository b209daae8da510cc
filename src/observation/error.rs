//! Errors of sensors of places.

use crate::error::{Number, Parameter, TableError};

/// An invalid observation model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ObservationError {
    /// A number is out of range.
    #[error(transparent)]
    Parameter(#[from] Parameter),
    /// No place has a neighbour, so places cannot be confused.
    #[error(
        "no place has a neighbour, so a mean correct probability of {mean} cannot be reached",
        mean = Number(*.mean)
    )]
    NoNeighbors {
        /// Mean probability of a correct observation asked for.
        mean: f64,
    },
    /// A place has so many neighbours that no probability is left for itself.
    #[error(
        "place {id} has {neighbors} neighbours, which leaves it a correct probability of {correct}, expected above 0",
        correct = Number(*.correct)
    )]
    TooManyNeighbors {
        /// Id of the place.
        id: u64,
        /// Number of its neighbours.
        neighbors: usize,
        /// Remaining probability of a correct observation.
        correct: f64,
    },
    /// A confusion names a place that does not exist.
    #[error("place {place} seen as place {seen_as} is out of range, there are {places} places (0 to {})", .places.saturating_sub(1))]
    OutOfRange {
        /// Index of the place.
        place: usize,
        /// Index of the place that it is seen as.
        seen_as: usize,
        /// Number of places.
        places: usize,
    },
    /// An entry of a confusion is given twice.
    #[error("the probability that place {place} is seen as {seen_as} is given twice")]
    Twice {
        /// Index of the place.
        place: usize,
        /// Index of the place that it is seen as.
        seen_as: usize,
    },
    /// A weight of a confusion is NaN, negative or infinite.
    #[error(
        "place {place} is seen as {seen_as} with weight {value}, expected a finite value of at least 0",
        value = Number(*.value)
    )]
    Weight {
        /// Index of the place.
        place: usize,
        /// Index of the place that it is seen as.
        seen_as: usize,
        /// Value found.
        value: f64,
    },
    /// All weights of a place are 0.
    #[error("place {place} has no weight above 0, expected at least one")]
    NoWeight {
        /// Index of the place.
        place: usize,
    },
    /// The probabilities do not form a valid table.
    #[error(transparent)]
    Table(#[from] TableError),
}
