//! Arrays of other types than doubles, columns with missing entries, and counts.

use std::num::NonZero;

use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::Borrowed;
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;

use crate::array::{borrowed, converted};
use crate::error::invalid;

/// Rows of a matrix, which may have no columns; so the number of rows is kept, since it does not
/// follow from the values.
#[derive(Debug)]
pub(crate) struct Rows<'a, T> {
    values: &'a [T],
    count: usize,
    width: usize,
}

impl<'a, T: Element> Rows<'a, T> {
    pub(crate) fn of(array: &'a PyReadonlyArray2<'_, T>) -> PyResult<Self> {
        let &[count, width] = array.shape() else { return Err(invalid("expected two axes")) };
        let values = array.as_slice().map_err(invalid)?;
        Ok(Self { values, count, width })
    }
}

impl<'a, T> Rows<'a, T> {
    /// Creates rows of the same shape over other values, one for each of these.
    pub(crate) fn with<'b, U>(&self, values: &'b [U]) -> Rows<'b, U> {
        Rows { values, count: self.count, width: self.width }
    }

    pub(crate) fn values(&self) -> &'a [T] {
        self.values
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &'a [T]> + use<'a, T> {
        // Not by chunks of the values: a matrix without columns has rows, but nothing to cut.
        let (values, width) = (self.values, self.width);
        (0..self.count).map(move |row| &values[row * width..][..width])
    }
}

/// Reads rows of floats.
pub(crate) fn float_rows<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray2<'py, f32>> {
    converted(values, what, ("fiub", "float32"), 2)?.extract()
}

/// Reads a list of floats.
pub(crate) fn floats<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray1<'py, f32>> {
    // The usual case is the array of a live camera, for which the conversion would cost more than
    // the step.
    if let Some(array) = borrowed(values) {
        return Ok(array);
    }
    converted(values, what, ("fiub", "float32"), 1)?.extract()
}

/// Reads truth values.
pub(crate) fn truths<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray1<'py, bool>> {
    converted(values, what, ("b", "bool"), 1)?.extract()
}

/// Reads rows of integers.
pub(crate) fn integer_rows<'py>(
    values: &Bound<'py, PyAny>,
    what: &str,
) -> PyResult<PyReadonlyArray2<'py, i64>> {
    converted(values, what, ("iu", "int64"), 2)?.extract()
}

/// Reads doubles with NaN for missing ones; `None` is an empty vector.
pub(crate) fn optional(
    values: Option<&Bound<'_, PyAny>>,
    what: &str,
    expected: usize,
) -> PyResult<Vec<Option<f64>>> {
    let Some(values) = values else { return Ok(Vec::new()) };
    let array = crate::array::doubles(values, what)?;
    let values = array.as_slice().map_err(invalid)?;
    if values.len() != expected {
        return Err(invalid(format!("found {} {what}, expected {expected}", values.len())));
    }
    Ok(values.iter().map(|value| (!value.is_nan()).then_some(*value)).collect())
}

/// Count from Python: an integer of at least 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Size(pub(crate) usize);

impl FromPyObject<'_, '_> for Size {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        value.extract().map(Self).map_err(|error: PyErr| {
            // A negative or a huge integer overflows; a value of another type keeps its TypeError.
            if error.is_instance_of::<PyOverflowError>(value.py()) {
                return invalid(format!("{} is not a valid count, expected 0 or more", &*value));
            }
            error
        })
    }
}

/// Returns the number of threads that joblib's `n_jobs` asks for: -1 is one for each processor, -2
/// one less, and so on.
pub(crate) fn threads(n_jobs: isize) -> PyResult<usize> {
    if n_jobs == 0 {
        return Err(invalid("n_jobs is 0, expected a number of threads, or -1 for all processors"));
    }
    let processors = std::thread::available_parallelism().map_or(1, NonZero::get);
    // `unsigned_abs` also takes the smallest integer.
    let count = n_jobs.unsigned_abs();
    // More threads than processors gain nothing, and the system may refuse to start them.
    Ok(if n_jobs < 0 {
        (processors + 1).saturating_sub(count).max(1)
    } else {
        count.min(processors)
    })
}

/// Returns an index as numpy's integer; `None` is -1.
pub(crate) fn index(value: Option<usize>) -> i64 {
    value.map_or(-1, |value| i64::try_from(value).unwrap_or(i64::MAX))
}
