//! Errors of descriptors.

use std::error::Error;
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
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum DescriptorError {
    /// Descriptors without elements.
    NoDimension,
    /// There are no references.
    NoReferences,
    /// The last descriptor is incomplete.
    Values {
        /// Numbers given.
        values: usize,
        /// Numbers of a descriptor.
        dimension: usize,
    },
    /// A descriptor is too short or too long.
    Length {
        /// The descriptor.
        which: Descriptor,
        /// Its length.
        length: usize,
        /// The dimension expected.
        expected: usize,
    },
    /// An element is NaN or infinite.
    Element {
        /// The descriptor.
        which: Descriptor,
        /// The element, from 0.
        element: usize,
        /// Its value.
        value: f32,
    },
    /// A descriptor is 0 in every element, so that it has no direction to compare.
    Zero {
        /// The descriptor.
        which: Descriptor,
    },
    /// Two or more references are all equal, so that they cannot tell places apart.
    AllEqual {
        /// The number of references.
        references: usize,
    },
    /// A distance is too large for 32 bits.
    TooFar {
        /// The query, from 0.
        query: usize,
        /// The reference, from 0.
        reference: usize,
        /// The distance.
        distance: f64,
    },
    /// The output slice has a wrong length.
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
