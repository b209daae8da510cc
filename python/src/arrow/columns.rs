//! Arrow's arrays as numpy's: the chunks of a column become one array.
//!
//! Numpy has no nulls. They become NaN in numbers (integers turn into doubles), "not a time" in
//! dates, `None` in texts, and an empty list in lists.

use arrow_array::cast::AsArray;
use arrow_array::types::{
    Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type,
    UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef, ArrowPrimitiveType, OffsetSizeTrait};
use arrow_schema::{DataType, TimeUnit};
use numpy::{Element, PyArray1};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use super::stream::Chunks;
use crate::error::invalid;

/// Returns a table's columns as a dictionary, or an array.
pub(super) fn read(py: Python<'_>, chunks: Chunks) -> PyResult<Bound<'_, PyAny>> {
    let Chunks { data_type, arrays } = chunks;
    let DataType::Struct(fields) = &data_type else { return column(py, &data_type, &arrays) };
    let columns = PyDict::new(py);
    for (number, field) in fields.iter().enumerate() {
        let parts: Vec<ArrayRef> =
            arrays.iter().map(|table| table.as_struct().column(number).clone()).collect();
        // A column of a type that is not supported is an error only for the caller who needs it.
        let values = match column(py, field.data_type(), &parts) {
            Ok(values) => values,
            Err(_) => py.None().into_bound(py),
        };
        columns.set_item(field.name(), values)?;
    }
    Ok(columns.into_any())
}

fn column<'py>(
    py: Python<'py>,
    data_type: &DataType,
    arrays: &[ArrayRef],
) -> PyResult<Bound<'py, PyAny>> {
    match data_type {
        DataType::Int8 => Ok(whole::<Int8Type>(py, arrays, f64::from)),
        DataType::Int16 => Ok(whole::<Int16Type>(py, arrays, f64::from)),
        DataType::Int32 => Ok(whole::<Int32Type>(py, arrays, f64::from)),
        DataType::Int64 => Ok(whole::<Int64Type>(py, arrays, |value| value as f64)),
        DataType::UInt8 => Ok(whole::<UInt8Type>(py, arrays, f64::from)),
        DataType::UInt16 => Ok(whole::<UInt16Type>(py, arrays, f64::from)),
        DataType::UInt32 => Ok(whole::<UInt32Type>(py, arrays, f64::from)),
        DataType::UInt64 => Ok(whole::<UInt64Type>(py, arrays, |value| value as f64)),
        DataType::Float32 => Ok(numbers::<Float32Type>(py, arrays, f32::NAN)),
        DataType::Float64 => Ok(numbers::<Float64Type>(py, arrays, f64::NAN)),
        DataType::Boolean => {
            objects(py, arrays, |array, row| array.as_boolean().value(row).into_bound_py_any(py))
                .and_then(|values| narrowed(values, nulls(arrays) == 0, "bool"))
        }
        DataType::Utf8 => objects(py, arrays, |array, row| {
            array.as_string::<i32>().value(row).into_bound_py_any(py)
        }),
        DataType::LargeUtf8 => objects(py, arrays, |array, row| {
            array.as_string::<i64>().value(row).into_bound_py_any(py)
        }),
        DataType::Utf8View => objects(py, arrays, |array, row| {
            array.as_string_view().value(row).into_bound_py_any(py)
        }),
        DataType::Timestamp(unit, _) => dates(py, *unit, arrays),
        DataType::Dictionary(_, values) => dictionary(py, values, arrays),
        DataType::List(field) => lists::<i32>(py, field.data_type(), arrays),
        DataType::LargeList(field) => lists::<i64>(py, field.data_type(), arrays),
        DataType::FixedSizeList(field, size) => {
            let parts = arrays.iter().map(|array| {
                // A null takes up a row of values here, and these may hold anything.
                if array.null_count() > 0 {
                    return Err(invalid("a list column of one length has nulls"));
                }
                Ok(array.as_fixed_size_list().values().clone())
            });
            let values = column(py, field.data_type(), &parts.collect::<PyResult<Vec<_>>>()?)?;
            let rows: usize = arrays.iter().map(arrow_array::Array::len).sum();
            values.call_method1("reshape", (rows, *size))
        }
        other => Err(invalid(format!(
            "an arrow column has type {other}, expected numbers, texts, dates or lists"
        ))),
    }
}

fn nulls(arrays: &[ArrayRef]) -> usize {
    arrays.iter().map(arrow_array::Array::null_count).sum()
}

/// Returns numbers, with `null` in place of nulls.
fn numbers<'py, T>(py: Python<'py>, arrays: &[ArrayRef], null: T::Native) -> Bound<'py, PyAny>
where
    T: ArrowPrimitiveType<Native: Element>,
{
    let mut out = Vec::with_capacity(arrays.iter().map(arrow_array::Array::len).sum());
    for array in arrays {
        let array = array.as_primitive::<T>();
        match array.nulls() {
            // A column without nulls, the usual case, is copied as a whole.
            None => out.extend_from_slice(array.values()),
            Some(_) => out.extend(array.iter().map(|value| value.unwrap_or(null))),
        }
    }
    PyArray1::from_vec(py, out).into_any()
}

/// Returns integers, or doubles with NaN if there are nulls.
fn whole<'py, T>(
    py: Python<'py>,
    arrays: &[ArrayRef],
    double: impl Fn(T::Native) -> f64,
) -> Bound<'py, PyAny>
where
    T: ArrowPrimitiveType<Native: Element + Default>,
{
    if nulls(arrays) == 0 {
        return numbers::<T>(py, arrays, T::Native::default());
    }
    // Only a double can be NaN; the price is that integers beyond 2^53 are rounded.
    let values = arrays.iter().flat_map(|array| array.as_primitive::<T>().iter());
    let values: Vec<f64> = values.map(|value| value.map_or(f64::NAN, &double)).collect();
    PyArray1::from_vec(py, values).into_any()
}

/// Returns an array of Python's objects, with None for nulls.
fn objects<'py>(
    py: Python<'py>,
    arrays: &[ArrayRef],
    value: impl Fn(&ArrayRef, usize) -> PyResult<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut out = Vec::new();
    for array in arrays {
        for row in 0..array.len() {
            out.push(if array.is_null(row) {
                py.None().into_bound(py)
            } else {
                value(array, row)?
            });
        }
    }
    py.import("numpy")?.call_method1("array", (PyList::new(py, out)?, "object"))
}

fn narrowed<'py>(
    values: Bound<'py, PyAny>,
    narrow: bool,
    kind: &str,
) -> PyResult<Bound<'py, PyAny>> {
    if narrow { values.call_method1("astype", (kind,)) } else { Ok(values) }
}

/// Returns dates, in UTC.
fn dates<'py>(py: Python<'py>, unit: TimeUnit, arrays: &[ArrayRef]) -> PyResult<Bound<'py, PyAny>> {
    let word = match unit {
        TimeUnit::Second => "datetime64[s]",
        TimeUnit::Millisecond => "datetime64[ms]",
        TimeUnit::Microsecond => "datetime64[us]",
        TimeUnit::Nanosecond => "datetime64[ns]",
    };
    let mut out = Vec::new();
    for array in arrays {
        // The times are read as integers of the same bits, so that one branch serves all units. The
        // smallest integer is numpy's "not a time".
        let data = array.to_data().into_builder().data_type(DataType::Int64).build();
        let array = arrow_array::make_array(data.map_err(invalid)?);
        out.extend(array.as_primitive::<Int64Type>().iter().map(|time| time.unwrap_or(i64::MIN)));
    }
    PyArray1::from_vec(py, out).call_method1("view", (word,))
}

fn dictionary<'py>(
    py: Python<'py>,
    values: &DataType,
    arrays: &[ArrayRef],
) -> PyResult<Bound<'py, PyAny>> {
    let numpy = py.import("numpy")?;
    let parts = PyList::empty(py);
    for array in arrays {
        let array = array.as_any_dictionary();
        let words = column(py, values, std::slice::from_ref(array.values()))?;
        // Without words, all entries are null, and `take` has nothing to index.
        if array.values().is_empty() {
            let nothing = PyList::new(py, (0..array.len()).map(|_| py.None()))?;
            parts.append(numpy.call_method1("array", (nothing, "object"))?)?;
            continue;
        }
        let keys: Vec<u64> = array.normalized_keys().into_iter().map(|key| key as u64).collect();
        // The normalized key of a null is 0, a word like any other, which is overwritten.
        let taken = words.call_method1("take", (PyArray1::from_vec(py, keys),))?;
        if array.keys().null_count() > 0 {
            let taken = taken.call_method1("astype", ("object",))?;
            for row in (0..array.len()).filter(|row| array.keys().is_null(*row)) {
                taken.set_item(row, py.None())?;
            }
            parts.append(taken)?;
        } else {
            parts.append(taken)?;
        }
    }
    // `concatenate` needs at least one array; without chunks, this gives an empty one of the type.
    if parts.is_empty() {
        return column(py, values, &[]);
    }
    numpy.call_method1("concatenate", (parts,))
}

/// Returns the values and offsets of lists; a null is an empty list.
fn lists<'py, O: OffsetSizeTrait>(
    py: Python<'py>,
    values: &DataType,
    arrays: &[ArrayRef],
) -> PyResult<Bound<'py, PyAny>> {
    let (mut parts, mut offsets, mut end) = (Vec::new(), vec![0_i64], 0_usize);
    // `end` is the number of values of all rows so far, over all chunks; `parts` has just these
    // values, so that the offsets are those of their concatenation.
    for array in arrays {
        let array = array.as_list::<O>();
        for row in 0..array.len() {
            let bounds = [row, row + 1].map(|at| array.value_offsets()[at].as_usize());
            let length = if array.is_null(row) { 0 } else { bounds[1] - bounds[0] };
            if length > 0 {
                end += length;
            }
            offsets.push(i64::try_from(end).map_err(invalid)?);
        }
        // A sliced chunk has values outside its rows, and a null may have values of its own; both
        // are left out.
        if array.null_count() == 0 {
            let bounds = [0, array.len()].map(|at| array.value_offsets()[at].as_usize());
            parts.push(array.values().slice(bounds[0], bounds[1] - bounds[0]));
        } else {
            let some = (0..array.len()).filter(|row| array.is_valid(*row));
            parts.extend(some.map(|row| array.value(row)));
        }
    }
    let pair = (column(py, values, &parts)?, PyArray1::from_vec(py, offsets));
    Ok(pair.into_pyobject(py)?.into_any())
}
