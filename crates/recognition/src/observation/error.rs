//! Errors of descriptors, of rows of distances, and of the sensors that read them.

use wayfix::error::OutOfRange;

/// Invalid descriptors, an invalid row of distances, or a parameter of a sensor of views.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// A number is out of range.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
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
    /// A query is infinitely far from all references, in a model without a state off the map.
    #[error("the query is infinitely far from all references, and there is no state off the map")]
    NoMatch,
    /// Descriptors without elements.
    #[error("descriptors have dimension 0, expected at least 1")]
    NoDimension,
    /// A map without references.
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
