//! Lists, integers and floating-point numbers of any width, each as one type.

use std::cmp::Ordering;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int64Type};
use arrow_array::{Array, ArrayRef, Float64Array, Int64Array, StringArray};
use arrow_cast::{CastOptions, cast_with_options};
use arrow_schema::DataType;
use serde::Serialize;

use crate::error::{FleetError, Outcome};

/// Maps an element and a message to the row and message of an error.
pub(super) type Locate<'a> = &'a dyn Fn(usize, &str) -> (u64, String);

/// Lists with their elements; element 0 is the first of list 0.
pub(super) struct Lists {
    /// First element of each list, and at the end the number of elements.
    pub(super) offsets: Vec<usize>,
    pub(super) values: ArrayRef,
}

/// Separates lists into offsets and elements. Null lists count as empty.
pub(super) fn lists(array: &ArrayRef) -> Lists {
    let apart = |offsets: Vec<usize>, values: &ArrayRef| {
        // A sliced array keeps all values of the original, so cut them to the slice.
        let first = offsets.first().copied().unwrap_or(0);
        let end = offsets.last().copied().unwrap_or(first);
        let values = values.slice(first, end - first);
        Lists { offsets: offsets.into_iter().map(|offset| offset - first).collect(), values }
    };
    let mut lists = match array.data_type() {
        DataType::List(_) => {
            let list = array.as_list::<i32>();
            apart(list.value_offsets().iter().map(|&o| o as usize).collect(), list.values())
        }
        DataType::LargeList(_) => {
            let list = array.as_list::<i64>();
            apart(list.value_offsets().iter().map(|&o| o as usize).collect(), list.values())
        }
        _ => {
            let list = array.as_fixed_size_list();
            let width = list.value_length() as usize;
            // Unlike in the lists above, a slice of this one also slices the values.
            apart((0..=list.len()).map(|k| k * width).collect(), list.values())
        }
    };
    if lists.offsets.is_empty() {
        // An empty array may have no offsets at all.
        lists.offsets.push(0);
    }
    lists
}

/// Returns an error for the first null.
pub(super) fn no_nulls(array: &dyn Array, column: &str, locate: Locate<'_>) -> Outcome<()> {
    if array.null_count() == 0 {
        return Ok(());
    }
    let element = (0..array.len()).find(|&element| array.is_null(element)).unwrap_or(0);
    let (row, message) = locate(element, "is null, expected a value");
    Err(FleetError::value(column, row, message))
}

/// Casts, with an error for the first value that does not fit the type.
fn cast(
    array: &ArrayRef,
    to: &DataType,
    what: &str,
    column: &str,
    locate: Locate<'_>,
) -> Outcome<ArrayRef> {
    if array.data_type() == to {
        return Ok(array.clone());
    }
    // With `safe`, a value that does not fit becomes null; without, the error would not say where.
    let options = CastOptions { safe: true, ..CastOptions::default() };
    let done = cast_with_options(array, to, &options)
        .map_err(|error| FleetError::column(column, error.to_string()))?;
    // More nulls than before: the first new one is the value at fault. Nulls of a dictionary are in
    // its values, hence `logical`.
    if done.null_count() > array.logical_null_count() {
        let lost = |&element: &usize| done.is_null(element) && !array.is_null(element);
        let element = (0..array.len()).find(lost).unwrap_or(0);
        let (row, message) = locate(element, &format!("cannot be read as {what}"));
        return Err(FleetError::value(column, row, message));
    }
    Ok(done)
}

/// Reads integers, possibly null.
pub(super) fn integers(array: &ArrayRef, column: &str, locate: Locate<'_>) -> Outcome<Int64Array> {
    let done = cast(array, &DataType::Int64, "a 64-bit integer", column, locate)?;
    Ok(done.as_primitive::<Int64Type>().clone())
}

/// Reads floating-point numbers, possibly null.
pub(super) fn numbers(array: &ArrayRef, column: &str, locate: Locate<'_>) -> Outcome<Float64Array> {
    let done = cast(array, &DataType::Float64, "a number", column, locate)?;
    Ok(done.as_primitive::<Float64Type>().clone())
}

/// Reads trace ids, none of them null.
pub(super) fn ids(
    array: &ArrayRef,
    to: &DataType,
    column: &str,
    locate: Locate<'_>,
) -> Outcome<ArrayRef> {
    let what = if *to == DataType::Int64 { "a 64-bit integer" } else { "text" };
    let done = cast(array, to, what, column, locate)?;
    no_nulls(&done, column, locate)?;
    Ok(done)
}

/// Trace id of a drive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Id {
    /// An integer.
    Number(i64),
    /// Text.
    Text(String),
}

impl Id {
    /// Order in a table: numbers by value, text by bytes.
    pub(super) fn order(&self, other: &Self) -> Ordering {
        match (self, other) {
            (Self::Number(id), Self::Number(other)) => id.cmp(other),
            (Self::Text(id), Self::Text(other)) => id.cmp(other),
            // Does not occur: all ids of an input have one type.
            _ => Ordering::Greater,
        }
    }
}

impl std::fmt::Display for Id {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(id) => write!(f, "{id}"),
            Self::Text(id) => write!(f, "`{id}`"),
        }
    }
}

/// View of a column of ids.
pub(super) enum Ids<'a> {
    Numbers(&'a [i64]),
    Texts(&'a StringArray),
}

impl<'a> Ids<'a> {
    pub(super) fn of(array: &'a ArrayRef) -> Self {
        match array.as_primitive_opt::<Int64Type>() {
            Some(numbers) => Self::Numbers(numbers.values()),
            None => Self::Texts(array.as_string()),
        }
    }

    pub(super) fn get(&self, row: usize) -> Id {
        match self {
            Self::Numbers(ids) => Id::Number(ids[row]),
            Self::Texts(ids) => Id::Text(ids.value(row).to_owned()),
        }
    }
}
