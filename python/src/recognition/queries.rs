//! Queries in the library's form: rows of 32-bit numbers, smaller for more alike. Similarities are
//! negated, which turns them into distances up to scale and offset.

use std::borrow::Cow;

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::typed::{Rows, float_rows, floats};

/// Queries of a drive: descriptors, distances, or similarities to be negated.
#[derive(Debug)]
pub(super) struct Queries<'py> {
    array: PyReadonlyArray2<'py, f32>,
    negated: bool,
}

impl<'py> Queries<'py> {
    pub(super) fn new(values: &Bound<'py, PyAny>, negated: bool) -> PyResult<Self> {
        Ok(Self { array: float_rows(values, "queries")?, negated })
    }

    /// Returns the array that was given, before any negation.
    pub(super) fn array(&self) -> Py<PyArray2<f32>> {
        (*self.array).clone().unbind()
    }

    pub(super) fn rows(&self) -> PyResult<Rows<'_, f32>> {
        Rows::of(&self.array)
    }

    /// Returns the values in C order.
    pub(super) fn values<'a>(&self, rows: &Rows<'a, f32>) -> Cow<'a, [f32]> {
        // Only similarities are copied: descriptors may take most of the memory.
        if self.negated {
            rows.values().iter().map(|value| -value).collect()
        } else {
            Cow::Borrowed(rows.values())
        }
    }
}

/// Reads one query.
pub(super) fn query(values: &Bound<'_, PyAny>, negated: bool) -> PyResult<Vec<f32>> {
    let array = floats(values, "the values of a query")?;
    let values = array.as_slice().map_err(crate::error::invalid)?;
    // Distances are also copied: the step runs without the global lock, and a camera may write its
    // next frame into the array meanwhile.
    Ok(if negated { values.iter().map(|value| -value).collect() } else { values.to_vec() })
}
