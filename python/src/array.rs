//! Arrays of 64-bit numbers as slices: an array of the right type in C order is borrowed, and
//! anything else that numpy can convert without loss of meaning is copied once.

use numpy::ndarray::Dimension;
use numpy::{
    Element, PyArray, PyArrayMethods, PyReadonlyArray, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyList};

use crate::error::{invalid, of_step};

/// Returns the slice of a contiguous array.
pub(crate) fn contiguous<'a, T, E>(slice: Result<&'a [T], E>, what: &str) -> PyResult<&'a [T]> {
    slice.map_err(|_| invalid(format!("{what} are not contiguous in C order")))
}

/// Returns the values of an array, which must have this number of columns.
pub(crate) fn matrix<'a>(
    array: &'a PyReadonlyArray2<'_, f64>,
    columns: usize,
    what: &str,
) -> PyResult<&'a [f64]> {
    if !array.is_c_contiguous() {
        return Err(invalid(format!("{what} are not contiguous in C order")));
    }
    let found = array.shape()[1];
    if found != columns {
        return Err(invalid(format!("{what} have {found} columns, expected {columns}")));
    }
    contiguous(array.as_slice(), what)
}

/// Returns values as an array with this number of axes, of one type, in C order. An array that is
/// all of that already is not copied.
pub(crate) fn converted<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
    (kinds, kind): (&str, &str),
    axes: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let py = values.py();
    let numpy = py.import("numpy")?;
    // `asarray` would drop the mask and return the numbers beneath it.
    if is_masked(values, &numpy)? {
        return Err(invalid(format!("{what} have masked values, expected numbers")));
    }
    let mut array = numpy.call_method1("asarray", (values,)).map_err(invalid)?;
    let kind_of = |array: &Bound<'py, PyAny>| -> PyResult<String> {
        array.getattr("dtype")?.getattr("kind")?.extract()
    };
    // An Arrow column of lists, which numpy makes an array of objects.
    let is_arrow = values.hasattr("__arrow_c_stream__")? || values.hasattr("__arrow_c_array__")?;
    if axes == 2 && kind_of(&array)? == "O" && is_arrow {
        array = py.import("wayfix.arrow")?.call_method1("matrix", (values,))?;
    }
    // Nothing follows from the type of an empty array: numpy gives an empty list doubles.
    let is_empty = array.getattr("size")?.extract::<usize>()? == 0;
    // Numpy's letters: f is floating, i signed, u unsigned, b truth values; O is objects.
    if !kinds.contains(&kind_of(&array)?) && !is_empty {
        let dtype = array.getattr("dtype")?;
        return Err(invalid(format!("{what} have type {dtype}, expected {kind}")));
    }
    let found: usize = array.getattr("ndim")?.extract()?;
    if found != axes {
        let expected = if axes == 1 { "a list of values" } else { "a row of values for each" };
        let found = if found == 0 { "one value".into() } else { format!("{found} axes") };
        return Err(invalid(format!("{what} have {found}, expected {axes}: {expected}")));
    }
    // Doubles beyond the range of floats become infinite, which the library reports with the step
    // and the element; numpy's warning would say neither.
    let over = [("over", "ignore")].into_py_dict(py)?;
    let quiet = numpy.call_method("errstate", (), Some(&over))?;
    quiet.call_method0("__enter__")?;
    // "C": in C order, "A": aligned; slices need both.
    let result = numpy.call_method1("require", (array, kind, ["C", "A"])).map_err(invalid);
    quiet.call_method1("__exit__", (py.None(), py.None(), py.None()))?;
    result
}

/// True if an element is masked in the array, or in one of a list of arrays.
fn is_masked(values: &Bound<'_, PyAny>, numpy: &Bound<'_, PyModule>) -> PyResult<bool> {
    let ma = numpy.getattr("ma")?;
    let class = ma.getattr("MaskedArray")?;
    let masked = |value: &Bound<'_, PyAny>| {
        Ok::<_, PyErr>(
            value.is_instance(&class)? && ma.call_method1("is_masked", (value,))?.is_truthy()?,
        )
    };
    if let Ok(list) = values.cast::<PyList>() {
        for value in list {
            if masked(&value)? {
                return Ok(true);
            }
        }
    }
    masked(values)
}

/// Reads a list of doubles.
pub(crate) fn doubles<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray1<'py, f64>> {
    if let Some(array) = borrowed(values) {
        return Ok(array);
    }
    converted(values, what, ("fiub", "float64"), 1)?.extract()
}

/// Reads rows of doubles.
pub(crate) fn rows<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray2<'py, f64>> {
    if let Some(array) = borrowed(values) {
        return Ok(array);
    }
    converted(values, what, ("fiub", "float64"), 2)?.extract()
}

/// Borrows an array that needs no conversion, or returns `None`.
pub(crate) fn borrowed<'py, T: Element, D: Dimension>(
    values: &Bound<'py, PyAny>,
) -> Option<PyReadonlyArray<'py, T, D>> {
    // Exactly numpy's class: a subclass may have a mask.
    let array = values.cast_exact::<PyUntypedArray>().ok()?;
    // The borrow outlasts the global lock, and keeps other Rust code from writing meanwhile. A
    // Python thread that writes is a race that numpy does not prevent either.
    let array = array.cast::<PyArray<T, D>>().ok()?.try_readonly().ok()?;
    // `as_slice` alone would also accept Fortran's order.
    (array.is_c_contiguous() && array.as_slice().is_ok()).then_some(array)
}

/// Reads integers.
pub(crate) fn integers<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray1<'py, i64>> {
    converted(values, what, ("iu", "int64"), 1)?.extract()
}

/// Reads indices: integers from 0.
pub(crate) fn indices(values: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<usize>> {
    let array = integers(values, what)?;
    let values = contiguous(array.as_slice(), what)?;
    let index = |(at, value): (usize, &i64)| {
        let error = |_| invalid(format!("{what} have {value} at {at}, expected at least 0"));
        usize::try_from(*value).map_err(error)
    };
    values.iter().enumerate().map(index).collect()
}

/// Reads symbols of a sequence, or of several of these lengths; an error names the step.
pub(crate) fn symbols(values: &Bound<'_, PyAny>, lengths: &[usize]) -> PyResult<Vec<usize>> {
    let array = integers(values, "symbols")?;
    let error = |at: usize, value: i64| {
        // `step` counts from the start of `sequence`: full sequences are taken off until the rest
        // lies within one. Lengths are not checked yet, so the last takes whatever remains.
        let (mut sequence, mut step) = (0, at + 1);
        while sequence + 1 < lengths.len() && step > lengths[sequence] {
            step -= lengths[sequence];
            sequence += 1;
        }
        let of = if lengths.is_empty() { String::new() } else { format!("sequence {sequence}: ") };
        let message = format!("{of}step {step} has symbol {value}, expected at least 0");
        of_step(values.py(), sequence, step, message)
    };
    let symbol =
        |(at, value): (usize, &i64)| usize::try_from(*value).map_err(|_| error(at, *value));
    contiguous(array.as_slice(), "symbols")?.iter().enumerate().map(symbol).collect()
}

/// Reads the symbol of a step.
pub(crate) fn symbol(value: &Bound<'_, PyAny>, step: usize) -> PyResult<usize> {
    value.extract().map_err(|_| {
        // PyO3's own error, of a type that depends on the value, would lack the step.
        let message = format!("the symbol is {value}, expected an integer from 0");
        of_step(value.py(), 0, step, message)
    })
}
