//! Errors of descriptors.

use std::fmt;

/// The descriptor that an error is about, by its index from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Descriptor {
    /// The descriptor of a reference image.
    Reference(usize),
    /// The descriptor of one of the queries of a call; 0 for a single query.
    Query(usize),
}

impl fmt::Display for Descriptor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reference(index) => write!(f, "reference {index}"),
            Self::Query(index) => write!(f, "query {index}"),
        }
    }
}

/// Descriptors that are not valid, or have no distance.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DescriptorError {
    /// Descriptors without elements.
    #[error("descriptors have dimension 0, expected at least 1")]
    NoDimension,
    /// There are no references.
    #[error("there are no references, expected at least one")]
    NoReferences,
    /// The last descriptor is incomplete.
    #[error("{values} values are no whole number of descriptors of dimension {dimension}")]
    Values {
        /// Numbers given.
        values: usize,
        /// Numbers of a descriptor.
        dimension: usize,
    },
    /// A descriptor is too short or too long.
    #[error("{which} has {length} elements, expected {expected}")]
    Length {
        /// The descriptor.
        which: Descriptor,
        /// Its length.
        length: usize,
        /// The dimension expected.
        expected: usize,
    },
    /// An element is NaN or infinite.
    #[error("element {element} of {which} is {value}, expected a finite value")]
    Element {
        /// The descriptor.
        which: Descriptor,
        /// The element, from 0.
        element: usize,
        /// Its value.
        value: f32,
    },
    /// A descriptor is 0 in every element, so that it has no direction to compare.
    #[error("{which} is 0 in every element, so it has no cosine with another")]
    Zero {
        /// The descriptor.
        which: Descriptor,
    },
    /// Two or more references are all equal, so that they cannot tell places apart.
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
