//! Columns of text, parsed into their types. What cannot be parsed is reported with its row and
//! becomes null.

use std::sync::Arc;

use arrow_array::builder::{
    ArrayBuilder, Float64Builder, Int64Builder, ListBuilder, StructBuilder,
};
use arrow_array::cast::AsArray;
use arrow_array::types::Int64Type;
use arrow_array::{Array, ArrayRef, Int64Array, StringArray};
use arrow_cast::{CastOptions, cast_with_options};
use arrow_schema::{DataType, Field, Fields};

use crate::error::{FleetError, Outcome};
use crate::sensor::Kind;

/// Type of an observation in CSV.
pub(super) fn observation(kind: &Kind) -> DataType {
    match kind {
        Kind::Table(_) | Kind::SparseTable(_) => DataType::Int64,
        Kind::Vector { .. } => DataType::new_list(DataType::Float64, true),
        Kind::Sparse(_) => DataType::new_list(DataType::Struct(pair()), true),
        Kind::Places(_) => DataType::Utf8, // not read
    }
}

/// Fields of a state and its likelihood.
fn pair() -> Fields {
    Fields::from(vec![
        Field::new("state", DataType::Int64, true),
        Field::new("likelihood", DataType::Float64, true),
    ])
}

/// Type of trace ids, judged by the first one: integers, if it is one.
pub(super) fn type_of_ids(first: Option<&str>) -> DataType {
    let is_number = first.is_none_or(|id| is_plain(id) && id.parse::<i64>().is_ok());
    if is_number { DataType::Int64 } else { DataType::Utf8 }
}

/// True for an integer in canonical form: `007` and `+7` may be other ids than `7`.
fn is_plain(text: &str) -> bool {
    match text.strip_prefix('-').unwrap_or(text).as_bytes() {
        [b'0'] => text == "0",
        [b'1'..=b'9', digits @ ..] => digits.iter().all(u8::is_ascii_digit),
        _ => false,
    }
}

/// Called with the row and error of unreadable text; an error from it ends the work.
pub(super) type Refuse<'a> = &'a mut dyn FnMut(usize, FleetError) -> Outcome<()>;

/// Parses trace ids; what cannot be parsed is null.
pub(super) fn ids(
    text: &ArrayRef,
    field: &Field,
    first_row: u64,
    refuse: Refuse<'_>,
) -> Outcome<ArrayRef> {
    if !field.data_type().is_integer() {
        return typed(text, field, first_row, refuse);
    }
    let why = "but the first id of the file is an integer, so all must be; write all ids as text \
               that is not a number (`v7`), or use Parquet with a text column";
    let strings = text.as_string::<i32>();
    let done = cast(text, field.data_type())?;
    let numbers = done.as_primitive::<Int64Type>();
    let mut read: Option<Vec<bool>> = None;
    for (row, id) in strings.iter().enumerate() {
        let Some(id) = id else { continue };
        // The cast also accepts `007`, but the ids `007` and `7` must stay different.
        let what = match numbers.is_valid(row) {
            true if is_plain(id) => continue,
            true => format!("is not an integer in its plain form ({})", numbers.value(row)),
            false => "is not a 64-bit integer".to_owned(),
        };
        // The mask is only built if an id is refused, which is rare.
        read.get_or_insert_with(|| (0..text.len()).map(|row| numbers.is_valid(row)).collect())
            [row] = false;
        let message = format!("`{id}` {what}, {why}");
        refuse(row, FleetError::value(field.name(), first_row + row as u64, message))?;
    }
    let Some(read) = read else { return Ok(done) };
    Ok(Arc::new(Int64Array::new(numbers.values().clone(), Some(read.into()))))
}

/// Parses a column of text into a type; what cannot be parsed is null.
pub(super) fn typed(
    text: &ArrayRef,
    field: &Field,
    first_row: u64,
    refuse: Refuse<'_>,
) -> Outcome<ArrayRef> {
    let strings = text.as_string::<i32>();
    let mut refuse = |row: usize, what: &str| {
        let message = format!("`{}` is not {what}", strings.value(row));
        refuse(row, FleetError::value(field.name(), first_row + row as u64, message))
    };
    match field.data_type() {
        DataType::List(inner) if inner.data_type().is_floating() => {
            let row = |out: &mut ListBuilder<Float64Builder>, text: &str| {
                for value in parts(text) {
                    out.values().append_value(value.parse().ok()?);
                }
                Some(())
            };
            let what = "a list of numbers";
            list(strings, ListBuilder::new(Float64Builder::new()), row, |row| refuse(row, what))
        }
        DataType::List(_) => {
            let fields: Vec<Box<dyn ArrayBuilder>> =
                vec![Box::new(Int64Builder::new()), Box::new(Float64Builder::new())];
            let row = |out: &mut ListBuilder<StructBuilder>, text: &str| {
                // On an early return the fields pushed so far stay in the values, under a null
                // list: harmless, since offsets move past them.
                for pair in parts(text) {
                    let (state, likelihood) = pair.split_once(':')?;
                    let (state, likelihood) = (state.parse().ok()?, likelihood.parse().ok()?);
                    let pairs = out.values();
                    pairs.field_builder::<Int64Builder>(0)?.append_value(state);
                    pairs.field_builder::<Float64Builder>(1)?.append_value(likelihood);
                    pairs.append(true);
                }
                Some(())
            };
            let pairs = ListBuilder::new(StructBuilder::new(pair(), fields));
            list(strings, pairs, row, |row| refuse(row, "a list of pairs `state:likelihood`"))
        }
        to => {
            let done = cast(text, to)?;
            // More nulls than empty fields: some text was not a value.
            if done.null_count() > text.null_count() {
                let what = if to.is_integer() { "a 64-bit integer" } else { "a number" };
                let lost = |&row: &usize| done.is_null(row) && !text.is_null(row);
                (0..text.len()).filter(lost).try_for_each(|row| refuse(row, what))?;
            }
            Ok(done)
        }
    }
}

fn cast(text: &ArrayRef, to: &DataType) -> Outcome<ArrayRef> {
    let options = CastOptions { safe: true, ..CastOptions::default() };
    Ok(cast_with_options(text, to, &options)?)
}

/// Splits a list at spaces and semicolons.
fn parts(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', ';']).filter(|part| !part.is_empty())
}

/// Builds one list per row.
fn list<B: ArrayBuilder>(
    texts: &StringArray,
    mut out: ListBuilder<B>,
    mut row: impl FnMut(&mut ListBuilder<B>, &str) -> Option<()>,
    mut refuse: impl FnMut(usize) -> Outcome<()>,
) -> Outcome<ArrayRef> {
    for (at, text) in texts.iter().enumerate() {
        let read = text.and_then(|text| row(&mut out, text));
        if text.is_some() && read.is_none() {
            refuse(at)?;
        }
        out.append(read.is_some());
    }
    Ok(Arc::new(out.finish()))
}
