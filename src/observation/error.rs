//! What can be wrong with sensors of places.

use thiserror::Error;

use crate::error::TableError;

/// Why an observation model cannot be built, or has no likelihood for a query.
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
    /// A row has not a distance for each reference.
    #[error("{found} distances, expected one for each of {expected} references")]
    Distances {
        /// Distances found.
        found: usize,
        /// The number of references.
        expected: usize,
    },
    /// A distance is NaN or −∞.
    #[error("the distance to reference {reference} is {value}, expected a number or infinity")]
    Distance {
        /// The reference, from 0.
        reference: usize,
        /// What was found.
        value: f32,
    },
    /// A query is infinitely far from all references, and there is no state off
    /// the map.
    #[error("the query is infinitely far from all references, and there is no state off the map")]
    NoMatch,
    /// Rows of distances have no spread to take a scale from.
    #[error("most of the rows have no finite range of distances above 0 to take a scale from")]
    NoSpread,
    /// The label of a row is not a reference that it may show.
    #[error("row {row} is labelled {place}, expected a reference at a finite distance, 0 to {}", references.saturating_sub(1))]
    Label {
        /// The row, from 0.
        row: usize,
        /// Its label.
        place: usize,
        /// The number of references.
        references: usize,
    },
    /// Labels and rows differ in number.
    #[error("{labels} labels for {rows} rows, expected one each")]
    Labels {
        /// Labels given.
        labels: usize,
        /// Rows given.
        rows: usize,
    },
    /// No row is labelled.
    #[error("none of {rows} rows is labelled")]
    Unlabelled {
        /// Rows given.
        rows: usize,
    },
    /// No temperature is best: the hotter or the colder, the better.
    #[error("the labelled rows are the more probable the {trend} the temperature, without end")]
    Unbounded {
        /// "hotter" or "colder".
        trend: &'static str,
    },
    /// The probabilities are no table.
    #[error(transparent)]
    Table(#[from] TableError),
}
