//! Arrow's columns to numpy's arrays and back, by the PyCapsule interface: data frames of any
//! library can be read and made without depending on one.

mod columns;
mod export;
mod stream;

use pyo3::prelude::*;

/// Reads an object with `__arrow_c_stream__` or `__arrow_c_array__`. Returns a dictionary of the
/// columns of a table, or an array. A list column is a pair of values and offsets.
#[pyfunction]
pub(crate) fn read_arrow<'py>(data: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    columns::read(data.py(), stream::chunks(data)?)
}

pub(crate) use export::arrow_stream;
