//! Drives that are left out of tables with a row for each step.
//!
//! A drive whose id is not above all before is left out as far as it stands there, as are rows
//! without an id. A drive of which a row cannot be read, whose steps do not rise, or between whose
//! rows others stand, is left out as a whole. Where drives become ready is a matter of the rows
//! alone, not of where reading began: a run that continues makes the same parts.

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

/// Drives that may wait to be handed out: some 20 MB.
const MOST_PENDING: usize = 1 << 16;

/// State of leaving out.
#[derive(Debug, Default)]
pub(super) struct Faults {
    /// Drives that are left out, and not yet handed out.
    pending: Vec<Invalid>,
    /// Cause to leave out the drive that may go on.
    broken: Option<Invalid>,
    /// True if rows that belong to no drive follow those of the drive that may go on.
    interrupted: bool,
    /// A batch without rows.
    empty: Option<RecordBatch>,
}

impl Faults {
    /// True if rows to come need a closer look.
    pub(super) fn is_open(&self) -> bool {
        self.broken.is_some() || self.interrupted
    }
}

/// Complete drives without a gap.
#[derive(Default)]
struct Stretch {
    rows: Vec<RecordBatch>,
    first_row: u64,
    end_row: u64,
}

impl LongDrives {
    /// Adds rows of which some are not valid.
    pub(super) fn sort_out(&mut self, rows: Rows) -> Outcome<()> {
        let Rows { batch, mut wrong } = rows;
        let names = self.layout.names.clone();
        let ids = loose(column(&batch, &names.trace_id)?, &self.layout.id_type, &names.trace_id)?;
        let steps = loose(column(&batch, &names.step)?, &DataType::Int64, &names.step)?;
        let steps: &Int64Array = steps.as_primitive::<Int64Type>();
        let (start, end) = (self.next_row, batch.num_rows());
        self.next_row += end as u64;
        self.faults.empty = Some(batch.slice(0, 0));
        let mut stretch = Stretch::default();
        let id_of = |row: usize| ids.is_valid(row).then(|| Ids::of(&ids).get(row));
        let mut from = 0;
        while from < end {
            let id = id_of(from);
            // Rows without an id are no drive together.
            let next = |&row: &usize| id.is_none() || id_of(row) != id;
            let to = (from + 1..end).find(next).unwrap_or(end);
            let row = start + from as u64;
            let mut faults = Vec::new();
            while let Some((_, error)) = wrong.pop_front_if(|(row, _)| *row < to) {
                faults.push(error);
            }
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
                Some(std::cmp::Ordering::Less) => {
                    let last = self.last.as_ref().map(|(last, _)| last.clone());
                    let message = id.as_ref().zip(last).map(|(id, last)| unsorted(id, &last));
                    let message = message.map(|wrong| wrong.message).unwrap_or_default();
                    self.stray(FleetError::value(&names.trace_id, row, message), id)?;
                }
                Some(order) => {
                    let Some(id) = id else { break };
                    let mut last = self.last.take().map(|(_, step)| step);
                    if order.is_gt() {
                        self.close(&mut stretch, row)?;
                        (self.first_row, last) = (row, None);
                    } else if self.faults.interrupted {
                        let message = format!("other rows stand between those of drive {id}");
                        faults.insert(0, FleetError::value(&names.trace_id, row, message));
                    }
                    self.faults.interrupted = false;
                    let fault = faults.into_iter().next();
                    let fault = fault.or_else(|| {
                        let fault = rising(steps, from..to, last, &id);
                        let (row, message) = fault?;
                        Some(FleetError::value(&names.step, start + row as u64, message))
                    });
                    if let (Some(error), None) = (fault, &self.faults.broken) {
                        self.faults.broken = Some(Invalid::new(error, Some(id.clone()))?);
                        self.begun.clear();
                    }
                    if self.faults.broken.is_none() {
                        self.begun.push(batch.slice(from, to - from));
                    }
                    let step = if steps.is_valid(to - 1) { steps.value(to - 1) } else { 0 };
                    self.last = Some((id, step));
                }
            }
            from = to;
        }
        self.emit_stretch(&mut stretch, self.first_row)?;
        self.hand_out(self.first_row)
    }

    /// Leaves out rows after those of the drive that may go on. They wait until it is complete: a run
    /// that continues begins with it.
    fn stray(&mut self, error: FleetError, id: Option<Id>) -> Outcome<()> {
        if self.faults.pending.len() >= MOST_PENDING {
            let causes = match &self.last {
                Some((id, _)) => format!(
                    "after drive {id} would be left out, since their ids are missing or not above \
                     its own; is this id wrong, or the file not sorted?"
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

    /// Completes the drive that may have gone on, before a row.
    fn close(&mut self, stretch: &mut Stretch, next_row: u64) -> Outcome<()> {
        let begun = std::mem::take(&mut self.begun);
        if let Some(broken) = self.faults.broken.take() {
            self.faults.pending.push(broken);
            return self.emit_stretch(stretch, self.first_row);
        }
        if begun.is_empty() {
            return Ok(());
        }
        if stretch.end_row != self.first_row {
            self.emit_stretch(stretch, self.first_row)?;
        }
        if stretch.rows.is_empty() {
            stretch.first_row = self.first_row;
        }
        let count: usize = begun.iter().map(RecordBatch::num_rows).sum();
        stretch.end_row = self.first_row + count as u64;
        stretch.rows.extend(begun);
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

    /// Makes complete drives ready, after which the next one begins at a row.
    pub(super) fn emit(
        &mut self,
        rows: &RecordBatch,
        first_row: u64,
        next_row: u64,
    ) -> Outcome<()> {
        let mut ready = match self.drives(rows, first_row) {
            Err(FleetError::Value { .. }) if self.leave_out => self.good(rows, first_row)?,
            done => vec![done?],
        };
        let end_row = first_row + rows.num_rows() as u64;
        if let Some(last) = ready.last_mut().filter(|last| last.end_row == end_row) {
            last.end_row = next_row;
        }
        let pending = &mut self.faults.pending;
        pending.sort_by_key(|invalid| invalid.row);
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

    /// Drives of rows in order that are valid; the others become pending.
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

    /// Hands out drives that are left out before a row with which a drive begins.
    fn hand_out(&mut self, next_row: u64) -> Outcome<()> {
        self.faults.pending.sort_by_key(|invalid| invalid.row);
        let count = self.faults.pending.partition_point(|invalid| invalid.row < next_row);
        if count == 0 {
            return Ok(());
        }
        let Some(empty) = &self.faults.empty else { return Ok(()) };
        let mut drives = self.drives(empty, next_row)?;
        drives.invalid = self.faults.pending.drain(..count).collect();
        self.ready.push_back(drives);
        Ok(())
    }

    /// Hands out all that are left out, at the end of the file.
    pub(super) fn end_faults(&mut self) -> Outcome<()> {
        self.faults.pending.extend(self.faults.broken.take());
        self.hand_out(self.next_row)
    }
}

/// First row whose step does not rise or is none.
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

/// Values of a type, null where one cannot be read.
fn loose(array: &ArrayRef, to: &DataType, name: &str) -> Outcome<ArrayRef> {
    let options = CastOptions { safe: true, ..CastOptions::default() };
    cast_with_options(array, to, &options)
        .map_err(|error| FleetError::column(name, error.to_string()))
}
