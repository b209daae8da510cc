//! Numpy's arrays as a stream of Arrow's arrays: one table in one batch. All columns are copied, so
//! that the consumer's memory does not depend on Python's.

use std::sync::Arc;

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{
    ArrayRef, BooleanArray, FixedSizeListArray, Float32Array, Float64Array, Int64Array,
    LargeListArray, LargeStringArray, RecordBatch, RecordBatchIterator, TimestampMicrosecondArray,
    TimestampMillisecondArray, TimestampNanosecondArray, TimestampSecondArray, UInt64Array,
};
use arrow_buffer::{OffsetBuffer, ScalarBuffer};
use arrow_schema::{Field, Schema};
use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict, PyTuple};

use crate::error::invalid;

/// Returns a capsule with the columns of a dictionary: arrays of numbers, truth values, dates or
/// texts, matrices (as lists of one length), and pairs of values and offsets (as lists).
#[pyfunction]
pub(crate) fn arrow_stream<'py>(columns: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyCapsule>> {
    let (mut fields, mut arrays) = (Vec::new(), Vec::new());
    for (name, values) in columns {
        let name: String = name.extract()?;
        let array =
            array_of(&values).map_err(|error| invalid(format!("column {name:?}: {error}")))?;
        let rows = arrays.first().map_or(array.len(), |first: &ArrayRef| first.len());
        if array.len() != rows {
            let found = array.len();
            return Err(invalid(format!("column {name:?} has {found} rows, expected {rows}")));
        }
        fields.push(Field::new(name, array.data_type().clone(), true));
        arrays.push(array);
    }
    let schema = Arc::new(Schema::new(fields));
    let rows = arrays.first().map_or(0, |array| array.len());
    // Without columns, the number of rows does not follow from them.
    let options = arrow_array::RecordBatchOptions::new().with_row_count(Some(rows));
    let batch = RecordBatch::try_new_with_options(Arc::clone(&schema), arrays, &options);
    let reader = RecordBatchIterator::new([Ok(batch.map_err(invalid)?)], schema);
    let stream = FFI_ArrowArrayStream::new(Box::new(reader));
    // The capsule drops the stream. A stream that a consumer took is marked released by then, so
    // its memory is freed once in either case.
    PyCapsule::new_with_value(columns.py(), stream, c"arrow_array_stream")
}

fn vector<T: Element + Copy>(values: &Bound<'_, PyAny>, kind: &str) -> PyResult<Vec<T>> {
    let array: PyReadonlyArray1<'_, T> = values.call_method1("astype", (kind,))?.extract()?;
    Ok(array.as_array().iter().copied().collect())
}

fn array_of(values: &Bound<'_, PyAny>) -> PyResult<ArrayRef> {
    if let Ok(pair) = values.cast::<PyTuple>() {
        let (values, offsets): (Bound<'_, PyAny>, Bound<'_, PyAny>) = pair.extract()?;
        // The values may be any column, including another list column.
        let (values, offsets) = (array_of(&values)?, vector::<i64>(&offsets, "int64")?);
        // Offsets that never decrease, from 0 to the number of values, index nothing outside them.
        let ascend = offsets.first() == Some(&0) && offsets.is_sorted();
        let end = offsets.last().and_then(|last| usize::try_from(*last).ok());
        if !ascend || end != Some(values.len()) {
            return Err(invalid(format!("offsets do not ascend from 0 to {}", values.len())));
        }
        let field = Arc::new(Field::new("item", values.data_type().clone(), true));
        let offsets = OffsetBuffer::new(ScalarBuffer::from(offsets));
        return Ok(Arc::new(
            LargeListArray::try_new(field, offsets, values, None).map_err(invalid)?,
        ));
    }
    let dtype = values.getattr("dtype")?;
    let kind: String = dtype.getattr("kind")?.extract()?;
    let axes: usize = values.getattr("ndim")?.extract()?;
    if axes == 2 {
        let array: PyReadonlyArray2<'_, f64> =
            values.call_method1("astype", ("float64",))?.extract()?;
        let width = i32::try_from(array.shape()[1]).map_err(invalid)?;
        let flat = Arc::new(Float64Array::from_iter_values(array.as_array().iter().copied()));
        let field = Arc::new(Field::new("item", arrow_schema::DataType::Float64, true));
        let lists = FixedSizeListArray::try_new(field, width, flat, None);
        return Ok(Arc::new(lists.map_err(invalid)?));
    }
    if axes != 1 {
        return Err(invalid(format!("{axes} axes, expected 1 or 2")));
    }
    Ok(match &kind[..] {
        "f" if dtype.getattr("itemsize")?.extract::<usize>()? == 4 => {
            Arc::new(Float32Array::from(vector::<f32>(values, "float32")?))
        }
        // Also half floats and long doubles, which Arrow or Rust lacks.
        "f" => Arc::new(Float64Array::from(vector::<f64>(values, "float64")?)),
        "i" => Arc::new(Int64Array::from(vector::<i64>(values, "int64")?)),
        "u" => Arc::new(UInt64Array::from(vector::<u64>(values, "uint64")?)),
        "b" => Arc::new(BooleanArray::from(vector::<bool>(values, "bool")?)),
        "M" => dates(values)?,
        // Texts, objects, and whatever else `str` can write; None is null.
        _ => {
            let words: Vec<Bound<'_, PyAny>> = values.call_method0("tolist")?.extract()?;
            let word = |value: &Bound<'_, PyAny>| {
                if value.is_none() { Ok(None) } else { value.str()?.extract().map(Some) }
            };
            let words = words.iter().map(word).collect::<PyResult<Vec<Option<String>>>>()?;
            Arc::new(LargeStringArray::from(words))
        }
    })
}

fn dates(values: &Bound<'_, PyAny>) -> PyResult<ArrayRef> {
    let numpy = values.py().import("numpy")?;
    let unit: (String, i64) =
        numpy.call_method1("datetime_data", (values.getattr("dtype")?,))?.extract()?;
    // Numpy also has multiples of units, and days or months; Arrow has these four. The rest become
    // nanoseconds.
    let unit = if unit.1 == 1 { unit.0 } else { "ns".to_owned() };
    let unit = if ["s", "ms", "us"].contains(&&unit[..]) { unit } else { "ns".to_owned() };
    let values = values.call_method1("astype", (format!("datetime64[{unit}]"),))?;
    let times = vector::<i64>(&values, "int64")?;
    // The smallest integer is numpy's "not a time".
    let times = times.into_iter().map(|time| (time != i64::MIN).then_some(time));
    Ok(match &unit[..] {
        "s" => Arc::new(times.collect::<TimestampSecondArray>()),
        "ms" => Arc::new(times.collect::<TimestampMillisecondArray>()),
        "us" => Arc::new(times.collect::<TimestampMicrosecondArray>()),
        _ => Arc::new(times.collect::<TimestampNanosecondArray>()),
    })
}
