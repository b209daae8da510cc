//! Lists, integers and numbers of any width, as one type each.

use std::cmp::Ordering;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int64Type};
use arrow_array::{Array, ArrayRef, Float64Array, Int64Array, StringArray};
use arrow_cast::{CastOptions, cast_with_options};
use arrow_schema::DataType;
use serde::Serialize;

use crate::error::{FleetError, Outcome};

/// A place in the input, for messages: element and message to row and message.
pub(super) type Locate<'a> = &'a dyn Fn(usize, &str) -> (u64, String);

/// Lists with their elements, which begin at the first list.
pub(super) struct Lists {
    /// First element of each list, and the number of elements.
    pub(super) offsets: Vec<usize>,
    pub(super) values: ArrayRef,
}

/// Takes lists apart. Null lists count as empty.
pub(super) fn lists(array: &ArrayRef) -> Lists {
    let apart = |offsets: Vec<usize>, values: &ArrayRef| {
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
            // Its values begin with the first list.
            apart((0..=list.len()).map(|k| k * width).collect(), list.values())
        }
    };
    if lists.offsets.is_empty() {
        lists.offsets.push(0);
    }
    lists
}

/// First null, as an error.
pub(super) fn no_nulls(array: &dyn Array, column: &str, locate: Locate<'_>) -> Outcome<()> {
    if array.null_count() == 0 {
        return Ok(());
    }
    let element = (0..array.len()).find(|&element| array.is_null(element)).unwrap_or(0);
    let (row, message) = locate(element, "is null, expected a value");
    Err(FleetError::value(column, row, message))
}

/// Casts, with an error for what the type does not hold.
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
    let options = CastOptions { safe: true, ..CastOptions::default() };
    let done = cast_with_options(array, to, &options)
        .map_err(|error| FleetError::column(column, error.to_string()))?;
    if done.null_count() > array.logical_null_count() {
        let lost = |&element: &usize| done.is_null(element) && !array.is_null(element);
        let element = (0..array.len()).find(lost).unwrap_or(0);
        let (row, message) = locate(element, &format!("cannot be read as {what}"));
        return Err(FleetError::value(column, row, message));
    }
    Ok(done)
}

/// Integers, which may be null.
pub(super) fn integers(array: &ArrayRef, column: &str, locate: Locate<'_>) -> Outcome<Int64Array> {
    let done = cast(array, &DataType::Int64, "a 64-bit integer", column, locate)?;
    Ok(done.as_primitive::<Int64Type>().clone())
}

/// Numbers, which may be null.
pub(super) fn numbers(array: &ArrayRef, column: &str, locate: Locate<'_>) -> Outcome<Float64Array> {
    let done = cast(array, &DataType::Float64, "a number", column, locate)?;
    Ok(done.as_primitive::<Float64Type>().clone())
}

/// Trace ids, none of them null.
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
    /// Order in a table: numbers by value, text by its bytes.
    pub(super) fn order(&self, other: &Self) -> Ordering {
        match (self, other) {
            (Self::Number(id), Self::Number(other)) => id.cmp(other),
            (Self::Text(id), Self::Text(other)) => id.cmp(other),
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

/// Ids of a column, without a copy.
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
