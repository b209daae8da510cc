//! What can be wrong with descriptors.

use std::fmt;

use thiserror::Error;

/// Which descriptor an error is about, by its index from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Descriptor {
    /// One of a reference image.
    Reference(usize),
    /// One of the queries of a call; of a single query, 0.
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

/// Why descriptors are not valid, or have no distance.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DescriptorError {
    /// Descriptors without elements.
    #[error("descriptors have dimension 0, expected at least 1")]
    NoDimension,
    /// Nothing to match with.
    #[error("there are no references, expected at least one")]
    NoReferences,
    /// The last descriptor is not whole.
    #[error("{values} values are no whole number of descriptors of dimension {dimension}")]
    Values {
        /// How many numbers were given.
        values: usize,
        /// How many a descriptor has.
        dimension: usize,
    },
    /// A descriptor is too short or too long.
    #[error("{which} has {length} elements, expected {expected}")]
    Length {
        /// Which descriptor.
        which: Descriptor,
        /// Its length.
        length: usize,
        /// The dimension.
        expected: usize,
    },
    /// An element is NaN or infinite.
    #[error("element {element} of {which} is {value}, expected a finite value")]
    Element {
        /// Which descriptor.
        which: Descriptor,
        /// Its element, from 0.
        element: usize,
        /// What was found.
        value: f32,
    },
    /// A descriptor without direction, where directions are compared.
    #[error("{which} is 0 in every element, so it has no cosine with another")]
    Zero {
        /// Which descriptor.
        which: Descriptor,
    },
    /// Two or more references, and any query is as far from each as from all.
    #[error("all {references} references are equal, so they cannot tell places apart")]
    AllEqual {
        /// How many references there are.
        references: usize,
    },
    /// A distance of finite descriptors that 32 bits do not hold.
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
    /// The caller's memory does not fit.
    #[error("there is room for {found} distances, expected {expected}")]
    Room {
        /// Its length.
        found: usize,
        /// Queries times references.
        expected: usize,
    },
}
