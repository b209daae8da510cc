//! Tables with one row per step, sorted by drive and step.
//!
//! Batches of rows end anywhere, so the last drive of each is held back until a row of the next
//! drive, or the end of the file, shows that it is complete. Between batches this holds: `begun`
//! has the rows of the current drive, `first_row` is the number of its first row, and `next_row`
//! that of the next row to come.

use std::collections::VecDeque;

use arrow_array::{ArrayRef, Int64Array, RecordBatch, UInt64Array};
use arrow_select::concat::concat_batches;
use arrow_select::take::take;

use super::columns::{Form, Layout};
use super::lists::{Id, Ids, ids, integers, no_nulls};
use super::nested::column;
use super::observed::Observed;
use super::strays::Faults;
use super::{Batches, Drives, Rows, locate};
use crate::error::{FleetError, Outcome};

/// Drives from rows that arrive in batches, which may end within a drive.
pub(super) struct LongDrives {
    batches: Batches,
    pub(super) layout: Layout,
    /// True if invalid drives are left out, false if they are an error.
    pub(super) leave_out: bool,
    /// Rows of the current drive, which may continue. The first of them is the first row of the
    /// first batch.
    pub(super) begun: Vec<RecordBatch>,
    /// Trace id and step of the last row in order.
    pub(super) last: Option<(Id, i64)>,
    /// Number of the first row of the current drive.
    pub(super) first_row: u64,
    /// Number of the next row to come.
    pub(super) next_row: u64,
    /// Complete drives.
    pub(super) ready: VecDeque<Drives>,
    pub(super) faults: Faults,
    ended: bool,
}

impl LongDrives {
    pub(super) fn new(batches: Batches, layout: Layout, first_row: u64, leave_out: bool) -> Self {
        Self {
            batches,
            layout,
            leave_out,
            begun: Vec::new(),
            last: None,
            first_row,
            next_row: first_row,
            ready: VecDeque::new(),
            faults: Faults::default(),
            ended: false,
        }
    }

    /// Adds rows; drives that are now complete become ready.
    fn add(&mut self, rows: Rows) -> Outcome<()> {
        if rows.batch.num_rows() == 0 {
            return Ok(());
        }
        // The usual case has no faults and takes the fast path below. `sort_out` goes run by run.
        if self.leave_out && (self.faults.is_open() || !rows.wrong.is_empty()) {
            return self.sort_out(rows);
        }
        let (steps, ids, starts) = match self.in_order(&rows.batch) {
            // Nothing has been changed yet, so the slower way can start over with these rows.
            Err(FleetError::Value { .. }) if self.leave_out => return self.sort_out(rows),
            done => done?,
        };
        let (end, batch) = (rows.batch.num_rows(), rows.batch);
        self.last = Some((Ids::of(&ids).get(end - 1), steps.value(end - 1)));
        let first = self.next_row;
        self.next_row += end as u64;
        // The last drive of these rows may continue.
        let Some(&cut) = starts.last().filter(|&&cut| cut > 0 || !self.begun.is_empty()) else {
            self.begun.push(batch);
            return Ok(());
        };
        self.begun.push(batch.slice(0, cut));
        let rows = concat_batches(&batch.schema(), &self.begun)?;
        self.begun = vec![batch.slice(cut, end - cut)];
        let first_row = std::mem::replace(&mut self.first_row, first + cut as u64);
        self.emit(&rows, first_row, self.first_row)
    }

    /// Ids and steps of rows in order, and the rows at which drives start.
    fn in_order(&self, batch: &RecordBatch) -> Outcome<(Int64Array, ArrayRef, Vec<usize>)> {
        let names = &self.layout.names;
        let first_row = self.next_row;
        let by_row = |row: usize, message: &str| (first_row + row as u64, message.to_owned());
        let (trace_id, step) = (names.trace_id.as_str(), names.step.as_str());
        let ids = ids(column(batch, trace_id)?, &self.layout.id_type, trace_id, &by_row)?;
        let steps = integers(column(batch, step)?, step, &by_row)?;
        no_nulls(&steps, step, &by_row)?;
        let starts = starts(&ids, &steps, self.last.as_ref()).map_err(|(row, wrong)| {
            let name = if wrong.is_step { step } else { trace_id };
            FleetError::value(name, first_row + row as u64, wrong.message)
        })?;
        Ok((steps, ids, starts))
    }

    /// Reads rows of complete drives, which are known to be in order.
    pub(super) fn drives(&self, rows: &RecordBatch, first_row: u64) -> Outcome<Drives> {
        let names = &self.layout.names;
        let by_row = |row: usize, message: &str| locate(Form::Long, first_row, &[], row, message);
        let trace_id = names.trace_id.as_str();
        let all = ids(column(rows, trace_id)?, &self.layout.id_type, trace_id, &by_row)?;
        let steps = integers(column(rows, &names.step)?, &names.step, &by_row)?;
        let mut offsets = starts(&all, &steps, None)
            .map_err(|(row, wrong)| FleetError::value(trace_id, row as u64, wrong.message))?;
        let first: UInt64Array = offsets.iter().map(|&row| row as u64).collect();
        let ids = take(&all, &first, None)?;
        offsets.push(rows.num_rows());
        let needed = self.layout.needed();
        // The columns after the id and the step, both of which a long table always has.
        let columns = needed[2..].iter().map(|&name| Ok((name, column(rows, name)?.clone())));
        let columns = columns.collect::<Outcome<Vec<_>>>()?;
        let observed = Observed::new(&self.layout.sensor, &columns, &by_row)?;
        let (form, invalid, end_row) = (Form::Long, Vec::new(), first_row + rows.num_rows() as u64);
        Ok(Drives { ids, offsets, steps: Some(steps), observed, form, first_row, end_row, invalid })
    }

    fn advance(&mut self) -> Outcome<Option<Drives>> {
        while self.ready.is_empty() && !self.ended {
            if let Some(batch) = self.batches.next() {
                self.add(batch?)?;
            } else {
                self.ended = true;
                self.end()?;
            }
        }
        Ok(self.ready.pop_front())
    }

    /// Completes the last drive, at the end of the file.
    fn end(&mut self) -> Outcome<()> {
        let begun = std::mem::take(&mut self.begun);
        let Some(schema) = begun.first().map(RecordBatch::schema) else { return self.end_faults() };
        let rows = concat_batches(&schema, &begun)?;
        self.emit(&rows, self.first_row, self.next_row)
    }
}

impl Iterator for LongDrives {
    type Item = Outcome<Drives>;

    fn next(&mut self) -> Option<Outcome<Drives>> {
        let next = self.advance();
        // After an error the iterator is exhausted: the state may be half changed.
        if next.is_err() {
            self.ended = true;
            self.begun.clear();
        }
        next.transpose()
    }
}

/// Rows that are out of order.
pub(super) struct Disorder {
    is_step: bool,
    pub(super) message: String,
}

/// Returns the rows at which drives start, given the row before the first.
pub(super) fn starts(
    ids: &ArrayRef,
    steps: &Int64Array,
    last: Option<&(Id, i64)>,
) -> Result<Vec<usize>, (usize, Disorder)> {
    let all = Ids::of(ids);
    let steps = &steps.values()[..];
    let mut starts = Vec::new();
    // Row 0 is compared with `last`, all others with the previous row.
    let mut first = 0;
    if let Some(&row) = [0].iter().find(|_| !steps.is_empty()) {
        first = 1;
        match last {
            None => starts.push(row),
            Some((id, step)) => {
                let next = all.get(row);
                let order = next.order(id);
                if order.is_gt() {
                    starts.push(row);
                } else if order.is_lt() {
                    return Err((row, unsorted(&next, id)));
                } else if steps[row] <= *step {
                    return Err((row, not_rising(steps[row], *step, &next)));
                }
            }
        }
    }
    // Equal ids are by far the most frequent, so compare them where they are, without building an
    // `Id` for each.
    let disorder = match &all {
        Ids::Numbers(ids) => {
            find(first..steps.len(), &mut starts, steps, |row| ids[row].cmp(&ids[row - 1]))
        }
        Ids::Texts(ids) => find(first..steps.len(), &mut starts, steps, |row| {
            ids.value(row).cmp(ids.value(row - 1))
        }),
    };
    match disorder {
        None => Ok(starts),
        Some(row) => {
            let (next, id) = (all.get(row), all.get(row - 1));
            let step = next == id;
            let wrong = if step {
                not_rising(steps[row], steps[row - 1], &id)
            } else {
                unsorted(&next, &id)
            };
            Err((row, wrong))
        }
    }
}

/// Collects the starts among rows that each have a row before them; returns the first row out of
/// order.
fn find(
    rows: std::ops::Range<usize>,
    starts: &mut Vec<usize>,
    steps: &[i64],
    order: impl Fn(usize) -> std::cmp::Ordering,
) -> Option<usize> {
    for row in rows {
        let order = order(row);
        if order.is_gt() {
            starts.push(row);
        } else if order.is_lt() || steps[row] <= steps[row - 1] {
            return Some(row);
        }
    }
    None
}

pub(super) fn unsorted(next: &Id, last: &Id) -> Disorder {
    let message = format!(
        "drive {next} follows drive {last}, expected rows sorted by drive (numbers by value, text \
         by its bytes)"
    );
    Disorder { is_step: false, message }
}

pub(super) fn not_rising(next: i64, last: i64, id: &Id) -> Disorder {
    let message = if next == last {
        format!("step {next} of drive {id} occurs twice")
    } else {
        format!("step {next} follows step {last} of drive {id}, expected increasing steps")
    };
    Disorder { is_step: true, message }
}
