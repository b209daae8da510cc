//! What can be wrong with descriptors.

use std::error::Error;
use std::fmt;

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
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum DescriptorError {
    /// Descriptors without elements.
    NoDimension,
    /// Nothing to match with.
    NoReferences,
    /// The last descriptor is not whole.
    Values {
        /// How many numbers were given.
        values: usize,
        /// How many a descriptor has.
        dimension: usize,
    },
    /// A descriptor is too short or too long.
    Length {
        /// Which descriptor.
        which: Descriptor,
        /// Its length.
        length: usize,
        /// The dimension.
        expected: usize,
    },
    /// An element is NaN or infinite.
    Element {
        /// Which descriptor.
        which: Descriptor,
        /// Its element, from 0.
        element: usize,
        /// What was found.
        value: f32,
    },
    /// A descriptor without direction, where directions are compared.
    Zero {
        /// Which descriptor.
        which: Descriptor,
    },
    /// Two or more references, and any query is as far from each as from all.
    AllEqual {
        /// How many references there are.
        references: usize,
    },
    /// A distance of finite descriptors that 32 bits do not hold.
    TooFar {
        /// The query, from 0.
        query: usize,
        /// The reference, from 0.
        reference: usize,
        /// The distance.
        distance: f64,
    },
    /// The caller's memory does not fit.
    Room {
        /// Its length.
        found: usize,
        /// Queries times references.
        expected: usize,
    },
}

impl fmt::Display for DescriptorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDimension => write!(f, "descriptors have dimension 0, expected at least 1"),
            Self::NoReferences => write!(f, "there are no references, expected at least one"),
            Self::Values { values, dimension } => write!(
                f,
                "{values} values are no whole number of descriptors of dimension {dimension}"
            ),
            Self::Length { which, length, expected } => {
                write!(f, "{which} has {length} elements, expected {expected}")
            }
            Self::Element { which, element, value } => {
                write!(f, "element {element} of {which} is {value}, expected a finite value")
            }
            Self::Zero { which } => {
                write!(f, "{which} is 0 in every element, so it has no cosine with another")
            }
            Self::AllEqual { references } => {
                write!(f, "all {references} references are equal, so they cannot tell places apart")
            }
            Self::TooFar { query, reference, distance } => write!(
                f,
                "the distance of query {query} to reference {reference} is {distance:e}, expected at most 3.4028235e38"
            ),
            Self::Room { found, expected } => {
                write!(f, "there is room for {found} distances, expected {expected}")
            }
        }
    }
}

impl Error for DescriptorError {}
