//! Errors of sensors of places.

use crate::error::{Number, Parameter, TableError};

/// An invalid observation model, invalid descriptors, or a query without a likelihood.
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
    /// A row does not have one distance per reference.
    #[error("{found} distances, expected one for each of {expected} references")]
    Distances {
        /// Number of distances given.
        found: usize,
        /// Number of references.
        expected: usize,
    },
    /// A distance is NaN or −∞.
    #[error("the distance to reference {reference} is {value}, expected a number or infinity")]
    Distance {
        /// Index of the reference, from 0.
        reference: usize,
        /// Distance given.
        value: f32,
    },
    /// A query is infinitely far from all references, and there is no state for being off the
    /// map.
    #[error("the query is infinitely far from all references, and there is no state off the map")]
    NoMatch,
    /// The probabilities do not form a valid table.
    #[error(transparent)]
    Table(#[from] TableError),
    /// Descriptors without elements.
    #[error("descriptors have dimension 0, expected at least 1")]
    NoDimension,
    /// There are no references.
    #[error("there are no references, expected at least one")]
    NoReferences,
    /// The last descriptor is incomplete.
    #[error("{values} values do not make a whole number of descriptors of dimension {dimension}")]
    Values {
        /// Numbers given.
        values: usize,
        /// Numbers of a descriptor.
        dimension: usize,
    },
    /// A descriptor is too short or too long.
    #[error("{which} {index} has {length} elements, expected {expected}")]
    Length {
        /// `"reference"` or `"query"`.
        which: &'static str,
        /// The reference, or the query of a call, from 0.
        index: usize,
        /// Its length.
        length: usize,
        /// The dimension expected.
        expected: usize,
    },
    /// An element is NaN or infinite.
    #[error("element {element} of {which} {index} is {value}, expected a finite value")]
    Element {
        /// `"reference"` or `"query"`.
        which: &'static str,
        /// The reference, or the query of a call, from 0.
        index: usize,
        /// The element, from 0.
        element: usize,
        /// Its value.
        value: f32,
    },
    /// A descriptor is 0 in every element, so it has no direction to compare.
    #[error("{which} {index} is 0 in every element, so it has no cosine with another")]
    Zero {
        /// `"reference"` or `"query"`.
        which: &'static str,
        /// The reference, or the query of a call, from 0.
        index: usize,
    },
    /// Two or more references are all equal, so they cannot tell places apart.
    #[error("all {references} references are equal, so they cannot tell places apart")]
    AllEqual {
        /// The number of references.
        references: usize,
    },
    /// A distance is too large for 32 bits.
    #[error(
        "the distance of query {query} to reference {reference} is {distance:e}, expected at most 3.4028235e38"
    )]
    TooFar {
        /// The query, from 0.
        query: usize,
        /// The reference, from 0.
        reference: usize,
        /// The distance.
        distance: f64,
    },
    /// The output slice has a wrong length.
    #[error("there is room for {found} distances, expected {expected}")]
    Room {
        /// Its length.
        found: usize,
        /// Queries times references.
        expected: usize,
    },
}
