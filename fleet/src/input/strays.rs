//! Invalid drives in tables with one row per step.
//!
//! Rows without an id, and rows whose id is not above all earlier ones, are left out where they
//! stand. A drive is left out as a whole if one of its rows cannot be read, its steps do not
//! increase, or other rows stand between its own. When drives become ready depends only on the
//! rows, not on where reading began, so a run that continues makes the same parts.

use arrow_array::cast::AsArray;
use arrow_array::types::Int64Type;
use arrow_array::{Array, ArrayRef, Int64Array, RecordBatch};
use arrow_cast::{CastOptions, cast_with_options};
use arrow_schema::DataType;
use arrow_select::concat::concat_batches;

use super::Rows;
use super::invalid::{Invalid, halves, joined};
use super::lists::{Id, Ids};
use super::long::{LongDrives, not_rising, starts, unsorted};
use super::nested::column;
use crate::error::{FleetError, Outcome};

/// Maximum number of left-out drives waiting to be handed out: some 20 MB.
const MOST_PENDING: usize = 1 << 16;

/// State of leaving drives out.
#[derive(Debug, Default)]
pub(super) struct Faults {
    /// Left-out drives not yet handed out.
    pending: Vec<Invalid>,
    /// Why the current drive is to be left out, if it is. It may still continue.
    broken: Option<Invalid>,
    /// True if stray rows follow those of the current drive: should it continue, it is broken.
    interrupted: bool,
    /// A batch without rows, to build empty `Drives` from.
    empty: Option<RecordBatch>,
}

impl Faults {
    /// True if the next rows need a closer look.
    pub(super) fn is_open(&self) -> bool {
        self.broken.is_some() || self.interrupted
    }
}

/// Complete drives in consecutive rows.
#[derive(Default)]
struct Stretch {
    rows: Vec<RecordBatch>,
    first_row: u64,
    end_row: u64,
}

impl LongDrives {
    /// Adds rows, some of them invalid, one run of equal ids after another.
    pub(super) fn sort_out(&mut self, rows: Rows) -> Outcome<()> {
        let Rows { batch, mut wrong } = rows;
        let names = self.layout.names.clone();
        // Unreadable values become null here, where `wrong` or the null itself tells what is wrong
        // with them.
        let ids = loose(column(&batch, &names.trace_id)?, &self.layout.id_type, &names.trace_id)?;
        let steps = loose(column(&batch, &names.step)?, &DataType::Int64, &names.step)?;
        let steps: &Int64Array = steps.as_primitive::<Int64Type>();
        let (start, end) = (self.next_row, batch.num_rows());
        self.next_row += end as u64;
        self.faults.empty = Some(batch.slice(0, 0));
        let mut stretch = Stretch::default();
        // In this loop `from..to` is a run of rows with one id, `row` the number of its first row
        // in the file, and `self.last` the last row that belongs to a valid or broken drive; stray
        // rows do not move it.
        let id_of = |row: usize| ids.is_valid(row).then(|| Ids::of(&ids).get(row));
        let mut from = 0;
        while from < end {
            let id = id_of(from);
            // Rows without an id do not belong together: each is a run of its own.
            let next = |&row: &usize| id.is_none() || id_of(row) != id;
            let to = (from + 1..end).find(next).unwrap_or(end);
            let row = start + from as u64;
            // Errors of unreadable text within the run, in order. `wrong` is sorted by row.
            let mut faults = Vec::new();
            while let Some((_, error)) = wrong.pop_front_if(|(row, _)| *row < to) {
                faults.push(error);
            }
            // `None` for no id, else how the id compares with that of the current drive.
            let order = match (&id, &self.last) {
                (None, _) => None,
                (Some(_), None) => Some(std::cmp::Ordering::Greater),
                (Some(id), Some((last, _))) => Some(id.order(last)),
            };
            match order {
                None => {
                    let message = "is null or cannot be read, expected a value";
                    let null = FleetError::value(&names.trace_id, row, message);
                    self.stray(faults.into_iter().next().unwrap_or(null), None)?;
                }
                // Sorted order is judged against the last drive kept in order, so one id that is
                // too high makes all lower ones behind it stray; `stray` gives up if there are too
                // many.
                Some(std::cmp::Ordering::Less) => {
                    let last = self.last.as_ref().map(|(last, _)| last.clone());
                    let message = id.as_ref().zip(last).map(|(id, last)| unsorted(id, &last));
                    let message = message.map(|wrong| wrong.message).unwrap_or_default();
                    self.stray(FleetError::value(&names.trace_id, row, message), id)?;
                }
                Some(order) => {
                    let Some(id) = id else { break };
                    let mut last = self.last.take().map(|(_, step)| step);
                    // A higher id ends the current drive. The new one begins at `row`.
                    if order.is_gt() {
                        self.close(&mut stretch, row)?;
                        (self.first_row, last) = (row, None);
                    } else if self.faults.interrupted {
                        let message = format!("other rows stand between those of drive {id}");
                        // Same id as the current drive, but stray rows in between.
                        faults.insert(0, FleetError::value(&names.trace_id, row, message));
                    }
                    self.faults.interrupted = false;
                    let fault = faults.into_iter().next();
                    // `last` is the step before the run if the drive continues.
                    let fault = fault.or_else(|| {
                        let fault = rising(steps, from..to, last, &id);
                        let (row, message) = fault?;
                        Some(FleetError::value(&names.step, start + row as u64, message))
                    });
                    // Only the first fault of a drive is reported, and its rows are dropped at
                    // once, so a broken drive takes no memory however long it is.
                    if let (Some(error), None) = (fault, &self.faults.broken) {
                        self.faults.broken = Some(Invalid::new(error, Some(id.clone()))?);
                        self.begun.clear();
                    }
                    if self.faults.broken.is_none() {
                        self.begun.push(batch.slice(from, to - from));
                    }
                    // A null step is a fault already, so any value will do.
                    let step = if steps.is_valid(to - 1) { steps.value(to - 1) } else { 0 };
                    self.last = Some((id, step));
                }
            }
            from = to;
        }
        self.emit_stretch(&mut stretch, self.first_row)?;
        self.hand_out(self.first_row)
    }

    /// Leaves out stray rows behind the current drive. They are handed out only after that drive: a
    /// run that continues starts reading at its first row, and would find them again.
    fn stray(&mut self, error: FleetError, id: Option<Id>) -> Outcome<()> {
        if self.faults.pending.len() >= MOST_PENDING {
            let causes = match &self.last {
                Some((id, _)) => format!(
                    "after drive {id} would be left out, since their ids are missing or not above \
                     its own; is this id wrong, or is the file not sorted?"
                ),
                None => {
                    "would be left out, since their ids are missing or cannot be read".to_owned()
                }
            };
            let message = format!("more than {MOST_PENDING} drives {causes}");
            return Err(FleetError::value(&self.layout.names.trace_id, self.first_row, message));
        }
        self.faults.pending.push(Invalid::new(error, id)?);
        self.faults.interrupted = true;
        Ok(())
    }

    /// Completes the current drive, which ends before row `next_row`.
    fn close(&mut self, stretch: &mut Stretch, next_row: u64) -> Outcome<()> {
        let begun = std::mem::take(&mut self.begun);
        if let Some(broken) = self.faults.broken.take() {
            self.faults.pending.push(broken);
            return self.emit_stretch(stretch, self.first_row);
        }
        if begun.is_empty() {
            return Ok(());
        }
        // Stray rows, or a broken drive, lie between the stretch and this drive.
        if stretch.end_row != self.first_row {
            self.emit_stretch(stretch, self.first_row)?;
        }
        if stretch.rows.is_empty() {
            stretch.first_row = self.first_row;
        }
        let count: usize = begun.iter().map(RecordBatch::num_rows).sum();
        stretch.end_row = self.first_row + count as u64;
        stretch.rows.extend(begun);
        // Stray rows follow: the stretch ends here, and takes them along as left out.
        if stretch.end_row != next_row {
            self.emit_stretch(stretch, next_row)?;
        }
        Ok(())
    }

    fn emit_stretch(&mut self, stretch: &mut Stretch, next_row: u64) -> Outcome<()> {
        let Stretch { rows, first_row, .. } = std::mem::take(stretch);
        let Some(schema) = rows.first().map(RecordBatch::schema) else { return Ok(()) };
        self.emit(&concat_batches(&schema, &rows)?, first_row, next_row)
    }

    /// Makes complete drives ready; the next drive begins at row `next_row`.
    pub(super) fn emit(
        &mut self,
        rows: &RecordBatch,
        first_row: u64,
        next_row: u64,
    ) -> Outcome<()> {
        let mut ready = match self.drives(rows, first_row) {
            // In order, but some observation may be invalid.
            Err(FleetError::Value { .. }) if self.leave_out => self.good(rows, first_row)?,
            done => vec![done?],
        };
        let end_row = first_row + rows.num_rows() as u64;
        // Rows between these drives and the next one belong to the last batch, so that a part that
        // ends with it covers them.
        if let Some(last) = ready.last_mut().filter(|last| last.end_row == end_row) {
            last.end_row = next_row;
        }
        let pending = &mut self.faults.pending;
        pending.sort_by_key(|invalid| invalid.row);
        // Each left-out drive travels with the first batch that ends behind it; those that come
        // after the last batch stay pending.
        for drives in &mut ready {
            let count = pending.partition_point(|invalid| invalid.row < drives.end_row);
            drives.invalid = pending.drain(..count).collect();
        }
        self.ready.extend(ready);
        if !pending.is_empty() {
            self.faults.empty = Some(rows.slice(0, 0));
        }
        self.hand_out(next_row)
    }

    /// Valid drives among rows in order; the others become pending.
    fn good(&mut self, rows: &RecordBatch, first_row: u64) -> Outcome<Vec<super::Drives>> {
        let names = &self.layout.names;
        let ids = loose(column(rows, &names.trace_id)?, &self.layout.id_type, &names.trace_id)?;
        let steps = loose(column(rows, &names.step)?, &DataType::Int64, &names.step)?;
        let mut offsets = starts(&ids, steps.as_primitive(), None)
            .map_err(|(row, wrong)| FleetError::value(&names.step, row as u64, wrong.message))?;
        let count = offsets.len();
        offsets.push(rows.num_rows());
        let drives = |range: std::ops::Range<usize>| {
            let (from, to) = (offsets[range.start], offsets[range.end]);
            self.drives(&rows.slice(from, to - from), first_row + from as u64)
        };
        let (mut good, mut invalid) = (Vec::new(), Vec::new());
        halves(
            0..count,
            // Results are computed again below, over joined ranges: a batch per range found by
            // bisection would be small.
            &mut |range| drives(range).map(drop),
            &mut |range, ()| good.push(range),
            &mut |drive, error| {
                let id = Ids::of(&ids).get(offsets[drive]);
                invalid.push(Invalid::new(error, Some(id))?);
                Ok(())
            },
        )?;
        let good = joined(good).into_iter().map(drives).collect::<Outcome<Vec<_>>>()?;
        self.faults.pending.extend(invalid);
        Ok(good)
    }

    /// Hands out left-out drives before row `next_row`, at which a drive begins.
    fn hand_out(&mut self, next_row: u64) -> Outcome<()> {
        self.faults.pending.sort_by_key(|invalid| invalid.row);
        let count = self.faults.pending.partition_point(|invalid| invalid.row < next_row);
        if count == 0 {
            return Ok(());
        }
        let Some(empty) = &self.faults.empty else { return Ok(()) };
        // No drive is ready to carry the left-out drives, so an empty batch does.
        let mut drives = self.drives(empty, next_row)?;
        drives.invalid = self.faults.pending.drain(..count).collect();
        self.ready.push_back(drives);
        Ok(())
    }

    /// Hands out the remaining left-out drives, at the end of the file.
    pub(super) fn end_faults(&mut self) -> Outcome<()> {
        self.faults.pending.extend(self.faults.broken.take());
        self.hand_out(self.next_row)
    }
}

/// First row whose step is missing or does not increase.
fn rising(
    steps: &Int64Array,
    rows: std::ops::Range<usize>,
    mut last: Option<i64>,
    id: &Id,
) -> Option<(usize, String)> {
    for row in rows {
        if steps.is_null(row) {
            return Some((row, "is null or cannot be read, expected a value".to_owned()));
        }
        let step = steps.value(row);
        if let Some(last) = last.filter(|&last| step <= last) {
            return Some((row, not_rising(step, last, id).message));
        }
        last = Some(step);
    }
    None
}

/// Casts to a type, null where a value cannot be read.
fn loose(array: &ArrayRef, to: &DataType, name: &str) -> Outcome<ArrayRef> {
    let options = CastOptions { safe: true, ..CastOptions::default() };
    cast_with_options(array, to, &options)
        .map_err(|error| FleetError::column(name, error.to_string()))
}
