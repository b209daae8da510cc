//! Errors of sensors of places.

use std::error::Error;
use std::fmt;

use crate::error::TableError;

/// An invalid observation model, or a query without a likelihood.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ObservationError {
    /// A number is out of its range.
    Parameter {
        /// Name of the number.
        what: &'static str,
        /// The value given.
        value: f64,
        /// The valid range.
        expected: &'static str,
    },
    /// No place has a neighbour, so that none can be confused.
    NoNeighbors {
        /// The mean probability of a correct observation asked for.
        mean: f64,
    },
    /// A place has so many neighbours that no probability is left for itself.
    TooManyNeighbors {
        /// The place's id.
        id: u64,
        /// Its number of neighbours.
        neighbors: usize,
        /// The remaining probability of a correct observation.
        correct: f64,
    },
    /// A place of a confusion is beyond the last one.
    OutOfRange {
        /// The place, by index.
        place: usize,
        /// The place that it is seen as.
        seen_as: usize,
        /// The number of places.
        places: usize,
    },
    /// An entry of a confusion was given twice.
    Twice {
        /// The place, by index.
        place: usize,
        /// The place that it is seen as.
        seen_as: usize,
    },
    /// A weight of a confusion is NaN, negative or infinite.
    Weight {
        /// The place, by index.
        place: usize,
        /// The place that it is seen as.
        seen_as: usize,
        /// The weight given.
        value: f64,
    },
    /// No weight of a place is above 0.
    NoWeight {
        /// The place, by index.
        place: usize,
    },
    /// A row does not have one distance for each reference.
    Distances {
        /// Distances given.
        found: usize,
        /// The number of references.
        expected: usize,
    },
    /// A distance is NaN or −∞.
    Distance {
        /// The reference, from 0.
        reference: usize,
        /// The distance given.
        value: f32,
    },
    /// A query is infinitely far from all references, and there is no state off
    /// the map.
    NoMatch,
    /// Rows of distances have no spread to take a scale from.
    NoSpread,
    /// The label of a row is not a reference at a finite distance.
    Label {
        /// The row, from 0.
        row: usize,
        /// The label.
        place: usize,
        /// The number of references.
        references: usize,
    },
    /// Labels and rows differ in number.
    Labels {
        /// Labels given.
        labels: usize,
        /// Rows given.
        rows: usize,
    },
    /// No row is labelled.
    Unlabelled {
        /// Rows given.
        rows: usize,
    },
    /// No temperature is best: the likelihood rises without end.
    Unbounded {
        /// "hotter" or "colder".
        trend: &'static str,
    },
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
            Self::NoSpread => write!(
                f,
                "most of the rows have no finite range of distances above 0 to take a scale from"
            ),
            Self::Label { row, place, references } => write!(
                f,
                "row {row} is labelled {place}, expected a reference at a finite distance, 0 to {}",
                references.saturating_sub(1)
            ),
            Self::Labels { labels, rows } => {
                write!(f, "{labels} labels for {rows} rows, expected one each")
            }
            Self::Unlabelled { rows } => write!(f, "none of {rows} rows is labelled"),
            Self::Unbounded { trend } => write!(
                f,
                "the labelled rows are the more probable the {trend} the temperature, without end"
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
