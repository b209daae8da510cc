//! What can be wrong with sensors of places.

use thiserror::Error;

use crate::error::TableError;

/// Why an observation model cannot be built.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ObservationError {
    /// A number is out of its range.
    #[error("{what} is {value}, expected {expected}")]
    Parameter {
        /// Which number.
        what: &'static str,
        /// What was found.
        value: f64,
        /// Its range.
        expected: &'static str,
    },
    /// No neighbours at all, so nothing can be confused.
    #[error("no place has a neighbour, so a mean correct probability of {mean} cannot be reached")]
    NoNeighbours {
        /// The mean asked for.
        mean: f64,
    },
    /// A place has so many neighbours that nothing is left for itself.
    #[error(
        "place {id} has {neighbours} neighbours, which leaves it a correct probability of {correct}, expected above 0"
    )]
    TooManyNeighbours {
        /// The place's id.
        id: u64,
        /// How many neighbours it has.
        neighbours: usize,
        /// What is left for seeing itself.
        correct: f64,
    },
    /// The probabilities are no table.
    #[error(transparent)]
    Table(#[from] TableError),
}
