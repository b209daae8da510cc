//! Tables with one row per drive, whose steps are lists.

use std::ops::Range;

use arrow_array::{ArrayRef, RecordBatch};

use super::columns::{Form, Layout};
use super::invalid::{Invalid, halves, joined};
use super::lists::{Ids, ids, integers, lists, no_nulls};
use super::observed::Observed;
use super::{Batches, Drives, Rows, locate};
use crate::error::{FleetError, Outcome};

/// Reads the drives of each batch of rows; `first_row` is the number of the first row.
pub(super) fn nested(
    batches: Batches,
    layout: Layout,
    mut first_row: u64,
    leave_out: bool,
) -> impl Iterator<Item = Outcome<Drives>> + Send {
    batches.flat_map(move |batch| {
        let done = batch.and_then(|Rows { batch, .. }| {
            let done = match drives(&batch, &layout, first_row) {
                Err(FleetError::Value { .. }) if leave_out => good(&batch, &layout, first_row)?,
                done => vec![done?],
            };
            first_row += batch.num_rows() as u64;
            Ok(done)
        });
        let (done, error) = match done {
            Ok(done) => (done, None),
            Err(error) => (Vec::new(), Some(Err(error))),
        };
        done.into_iter().map(Ok).chain(error)
    })
}

/// Valid drives of a batch, with the invalid ones between them.
fn good(batch: &RecordBatch, layout: &Layout, first_row: u64) -> Outcome<Vec<Drives>> {
    let rows = |range: Range<usize>| {
        drives(&batch.slice(range.start, range.len()), layout, first_row + range.start as u64)
    };
    let trace_id = &layout.names.trace_id;
    // There is no id if the id itself is what is wrong.
    let id = |row: usize| {
        let known = column(batch, trace_id).ok()?.slice(row, 1);
        let by_row = |_: usize, message: &str| (0, message.to_owned());
        let id = ids(&known, &layout.id_type, trace_id, &by_row).ok()?;
        Some(Ids::of(&id).get(0))
    };
    let (mut found, mut invalid) = (Vec::new(), Vec::new());
    halves(
        0..batch.num_rows(),
        &mut |range| rows(range).map(drop),
        &mut |range, ()| found.push(range),
        &mut |row, error| {
            invalid.push(Invalid::new(error, id(row))?);
            Ok(())
        },
    )?;
    let mut good = joined(found).into_iter().map(rows).collect::<Outcome<Vec<_>>>()?;
    if !invalid.is_empty() {
        // An empty batch, for invalid drives after the last valid one.
        good.push(rows(batch.num_rows()..batch.num_rows())?);
    }
    for drives in &mut good {
        // Invalid drives and batches are in the order of rows, so each invalid drive goes with the
        // first batch that ends behind it.
        let count = invalid.partition_point(|invalid: &Invalid| invalid.row < drives.end_row);
        drives.invalid = invalid.drain(..count).collect();
    }
    Ok(good)
}

/// Returns a column of a batch.
pub(super) fn column<'a>(batch: &'a RecordBatch, name: &str) -> Outcome<&'a ArrayRef> {
    batch.column_by_name(name).ok_or_else(|| FleetError::column(name, "is missing"))
}

/// Reads the drives of a batch of rows.
pub(super) fn drives(batch: &RecordBatch, layout: &Layout, first_row: u64) -> Outcome<Drives> {
    let names = &layout.names;
    let by_row = |row: usize, message: &str| (first_row + row as u64, message.to_owned());
    let ids = ids(column(batch, &names.trace_id)?, &layout.id_type, &names.trace_id, &by_row)?;
    let needed = layout.needed();
    // Skips the id, and the step if there is one: see `Layout::needed`.
    let observed = &needed[if names.step.is_empty() { 1 } else { 2 }..];
    // All lists of a row must have the same length. The first column read sets the offsets, and the
    // others are compared with it.
    let mut offsets: Option<(Vec<usize>, &str)> = None;
    let mut flat = |name| {
        let array = column(batch, name)?;
        no_nulls(array, name, &by_row)?;
        let lists = lists(array);
        match &offsets {
            None => offsets = Some((lists.offsets, name)),
            Some((known, first)) => {
                // Offsets agree up to the first difference, so the row that ends there is the one
                // at fault.
                let same = |row: &usize| known[row + 1] == lists.offsets[row + 1];
                if let Some(row) = (0..batch.num_rows()).find(|row| !same(row)) {
                    let length = |offsets: &[usize]| offsets[row + 1] - offsets[row];
                    let message = format!(
                        "has {} elements, but column `{first}` has {}",
                        length(&lists.offsets),
                        length(known)
                    );
                    return Err(FleetError::value(name, first_row + row as u64, message));
                }
            }
        }
        Ok(lists.values)
    };
    let columns = observed.iter().map(|&name| Ok((name, flat(name)?)));
    let columns = columns.collect::<Outcome<Vec<_>>>()?;
    let steps = if names.step.is_empty() { None } else { Some(flat(names.step.as_str())?) };
    let offsets = offsets.map_or_else(|| vec![0], |(offsets, _)| offsets);
    let by_element =
        |element: usize, message: &str| locate(Form::Nested, first_row, &offsets, element, message);
    let steps = match steps {
        None => None,
        Some(steps) => {
            let steps = integers(&steps, &names.step, &by_element)?;
            no_nulls(&steps, &names.step, &by_element)?;
            for drive in offsets.windows(2) {
                let steps = &steps.values()[drive[0]..drive[1]];
                if let Some(at) = steps.windows(2).position(|pair| pair[0] >= pair[1]) {
                    let message = format!(
                        "step {} follows step {}, expected increasing steps",
                        steps[at + 1],
                        steps[at]
                    );
                    let (row, message) = by_element(drive[0] + at + 1, &message);
                    return Err(FleetError::value(&names.step, row, message));
                }
            }
            Some(steps)
        }
    };
    let observed = Observed::new(&layout.sensor, &columns, &by_element)?;
    let (form, end_row) = (Form::Nested, first_row + batch.num_rows() as u64);
    Ok(Drives { ids, offsets, steps, observed, form, first_row, end_row, invalid: Vec::new() })
}
