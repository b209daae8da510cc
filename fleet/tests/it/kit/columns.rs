//! Columns of results and of inputs.

use std::sync::Arc;

use arrow::array::{
    Array, ArrayRef, AsArray, Float64Array, Int64Array, ListArray, RecordBatch, StructArray,
};
use arrow::buffer::OffsetBuffer;
use arrow::datatypes::{DataType, Field, Float64Type, Int64Type, UInt32Type};

pub(crate) fn numbers(rows: &RecordBatch, name: &str) -> Vec<Option<f64>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_primitive::<Float64Type>().iter().collect()
}

pub(crate) fn integers(rows: &RecordBatch, name: &str) -> Vec<Option<i64>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_primitive::<Int64Type>().iter().collect()
}

pub(crate) fn states(rows: &RecordBatch, name: &str) -> Vec<Option<u32>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_primitive::<UInt32Type>().iter().collect()
}

pub(crate) fn texts(rows: &RecordBatch, name: &str) -> Vec<Option<String>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_string::<i32>().iter().map(|text| text.map(str::to_owned)).collect()
}

/// Fields of the lists of a nested table, and the first element of each list.
pub(crate) fn items(rows: &RecordBatch, name: &str) -> (Vec<usize>, RecordBatch) {
    let lists = rows.column_by_name(name).unwrap().as_list::<i32>();
    let offsets = lists.value_offsets().iter().map(|&offset| offset as usize).collect();
    (offsets, RecordBatch::from(lists.values().as_struct()))
}

pub(crate) fn close(found: f64, expected: f64) {
    let tolerance = 1e-12 * expected.abs().max(1.0);
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
}

/// Lists of states with their likelihoods.
pub(crate) fn lists_of_pairs<'a>(
    lists: impl Iterator<Item = &'a [(usize, f64)]> + Clone,
) -> ListArray {
    let all = || lists.clone().flatten();
    let states = Int64Array::from_iter_values(all().map(|(state, _)| *state as i64));
    let likelihoods = Float64Array::from_iter_values(all().map(|(_, p)| *p));
    let pairs = StructArray::from(vec![
        (Arc::new(Field::new("state", DataType::Int64, false)), Arc::new(states) as ArrayRef),
        (Arc::new(Field::new("likelihood", DataType::Float64, false)), Arc::new(likelihoods)),
    ]);
    let item = Arc::new(Field::new_list_field(pairs.data_type().clone(), false));
    let offsets = OffsetBuffer::from_lengths(lists.map(<[_]>::len));
    ListArray::try_new(item, offsets, Arc::new(pairs), None).unwrap()
}
