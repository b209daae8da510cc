//! The arguments that a recogniser was made from, which pickles keep.

use numpy::{PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyList;
use wayfix_recognition::observation::Distance;

use super::options::name;

/// References of a recogniser.
#[derive(Debug)]
pub(super) enum Source {
    Descriptors {
        traverses: Vec<Py<PyArray2<f32>>>,
        distance: Distance,
    },
    /// Queries are distances, or similarities to be negated.
    Compared {
        negated: bool,
    },
}

impl Source {
    pub(super) fn clone_ref(&self, py: Python<'_>) -> Self {
        // `Clone` cannot be derived: counting a reference of Python's takes the global lock.
        match self {
            Self::Descriptors { traverses, distance } => Self::Descriptors {
                traverses: traverses.iter().map(|array| array.clone_ref(py)).collect(),
                distance: *distance,
            },
            Self::Compared { negated } => Self::Compared { negated: *negated },
        }
    }

    /// True if queries are similarities.
    pub(super) fn negated(&self) -> bool {
        matches!(self, Self::Compared { negated: true })
    }

    /// Returns the arrays of references, and the name of the comparison.
    pub(super) fn stored<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyList>, &'static str)> {
        Ok(match self {
            Self::Descriptors { traverses, distance } => {
                (PyList::new(py, traverses)?, name(*distance))
            }
            Self::Compared { negated: true } => (PyList::empty(py), "similarities"),
            Self::Compared { negated: false } => (PyList::empty(py), "distances"),
        })
    }

    /// Describes the queries, for `repr`.
    pub(super) fn described(&self, py: Python<'_>) -> String {
        match self {
            Self::Descriptors { traverses, .. } => {
                let width = traverses.first().map_or(0, |first| first.bind(py).shape()[1]);
                format!("descriptors of {width}")
            }
            Self::Compared { negated: true } => "similarities".to_owned(),
            Self::Compared { negated: false } => "distances".to_owned(),
        }
    }
}
