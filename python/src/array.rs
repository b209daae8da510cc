//! Arrays as slices.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::invalid;

/// Returns the slice of a contiguous array.
pub(crate) fn contiguous<'a, T, E>(slice: Result<&'a [T], E>, what: &str) -> PyResult<&'a [T]> {
    slice.map_err(|_| invalid(format!("{what} are not contiguous in C order")))
}

/// Returns the values of an array with so many columns.
pub(crate) fn matrix<'a>(
    array: &'a PyReadonlyArray2<'_, f64>,
    columns: usize,
    what: &str,
) -> PyResult<&'a [f64]> {
    let found = array.shape()[1];
    if found != columns {
        return Err(invalid(format!("{what} have {found} columns, expected {columns}")));
    }
    contiguous(array.as_slice(), what)
}

/// Returns values as an array of so many axes, in C order and of one type; one that is so already is
/// not copied.
fn converted<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
    (kinds, kind): (&str, &str),
    axes: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let numpy = values.py().import("numpy")?;
    // What is masked would be taken for a value.
    if values.hasattr("mask")?
        && numpy.getattr("ma")?.call_method1("is_masked", (values,))?.is_truthy()?
    {
        return Err(invalid(format!("{what} have masked values, expected numbers")));
    }
    let array = numpy.call_method1("asarray", (values,)).map_err(invalid)?;
    let found: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    // An empty list has some type.
    let is_empty = array.getattr("size")?.extract::<usize>()? == 0;
    if !kinds.contains(&found) && !is_empty {
        let name = array.getattr("dtype")?;
        return Err(invalid(format!("{what} have type {name}, expected {kind}")));
    }
    let found: usize = array.getattr("ndim")?.extract()?;
    if found != axes {
        return Err(invalid(format!("{what} have {found} axes, expected {axes}")));
    }
    numpy.call_method1("ascontiguousarray", (array, kind)).map_err(invalid)
}

/// Reads a list of doubles.
pub(crate) fn doubles<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray1<'py, f64>> {
    converted(values, what, ("fiub", "float64"), 1)?.extract()
}

/// Reads rows of doubles.
pub(crate) fn rows<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray2<'py, f64>> {
    converted(values, what, ("fiub", "float64"), 2)?.extract()
}

/// Reads indices: integers from 0.
pub(crate) fn indices(values: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<usize>> {
    let array: PyReadonlyArray1<'_, i64> =
        converted(values, what, ("iu", "int64"), 1)?.extract()?;
    let values = contiguous(array.as_slice(), what)?;
    let index = |(at, value): (usize, &i64)| {
        let error = |_| invalid(format!("{what} have {value} at {at}, expected at least 0"));
        usize::try_from(*value).map_err(error)
    };
    values.iter().enumerate().map(index).collect()
}
