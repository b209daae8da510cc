//! Errors of sensors of places.

use std::error::Error;
use std::fmt;

use crate::error::TableError;

/// An invalid observation model, or a query without a likelihood.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ObservationError {
    /// A number is out of range.
    Parameter {
        /// Name of the number.
        what: &'static str,
        /// Value given.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// No place has a neighbour, so places cannot be confused.
    NoNeighbors {
        /// Mean probability of a correct observation asked for.
        mean: f64,
    },
    /// A place has so many neighbours that no probability is left for itself.
    TooManyNeighbors {
        /// Id of the place.
        id: u64,
        /// Number of its neighbours.
        neighbors: usize,
        /// Remaining probability of a correct observation.
        correct: f64,
    },
    /// A confusion names a place that does not exist.
    OutOfRange {
        /// Index of the place.
        place: usize,
        /// Index of the place that it is seen as.
        seen_as: usize,
        /// Number of places.
        places: usize,
    },
    /// An entry of a confusion is given twice.
    Twice {
        /// Index of the place.
        place: usize,
        /// Index of the place that it is seen as.
        seen_as: usize,
    },
    /// A weight of a confusion is NaN, negative or infinite.
    Weight {
        /// Index of the place.
        place: usize,
        /// Index of the place that it is seen as.
        seen_as: usize,
        /// Value found.
        value: f64,
    },
    /// All weights of a place are 0.
    NoWeight {
        /// Index of the place.
        place: usize,
    },
    /// A row does not have one distance per reference.
    Distances {
        /// Number of distances given.
        found: usize,
        /// Number of references.
        expected: usize,
    },
    /// A distance is NaN or −∞.
    Distance {
        /// Index of the reference, from 0.
        reference: usize,
        /// Distance given.
        value: f32,
    },
    /// A query is infinitely far from all references, and there is no state for being off the
    /// map.
    NoMatch,
    /// The probabilities do not form a valid table.
    Table(TableError),
}

impl fmt::Display for ObservationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Parameter { what, value, expected } => {
                write!(f, "{what} is {value}, expected {expected}")
            }
            Self::NoNeighbors { mean } => write!(
                f,
                "no place has a neighbour, so a mean correct probability of {mean} cannot be reached"
            ),
            Self::TooManyNeighbors { id, neighbors, correct } => write!(
                f,
                "place {id} has {neighbors} neighbours, which leaves it a correct probability of {correct}, expected above 0"
            ),
            Self::OutOfRange { place, seen_as, places } => write!(
                f,
                "place {place} seen as place {seen_as} is out of range, there are {places} places (0 to {})",
                places.saturating_sub(1)
            ),
            Self::Twice { place, seen_as } => {
                write!(f, "the probability that place {place} is seen as {seen_as} is given twice")
            }
            Self::Weight { place, seen_as, value } => write!(
                f,
                "place {place} is seen as {seen_as} with weight {value}, expected a finite value of at least 0"
            ),
            Self::NoWeight { place } => {
                write!(f, "place {place} has no weight above 0, expected at least one")
            }
            Self::Distances { found, expected } => {
                write!(f, "{found} distances, expected one for each of {expected} references")
            }
            Self::Distance { reference, value } => write!(
                f,
                "the distance to reference {reference} is {value}, expected a number or infinity"
            ),
            Self::NoMatch => write!(
                f,
                "the query is infinitely far from all references, and there is no state off the map"
            ),
            Self::Table(error) => fmt::Display::fmt(error, f),
        }
    }
}

impl Error for ObservationError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Table(error) => error.source(),
            _ => None,
        }
    }
}

impl From<TableError> for ObservationError {
    fn from(source: TableError) -> Self {
        Self::Table(source)
    }
}
