//! Columns of results under construction.
//!
//! Values of steps are appended drive by drive. A [`Group`] for each drive (or path) records what
//! is constant within it; [`Rows::finish`] repeats that per row in the long form, or cuts the steps
//! into lists in the nested one.

use std::sync::Arc;

use arrow_array::{
    ArrayRef, Float64Array, Int64Array, ListArray, RecordBatch, StringArray, StructArray,
    UInt32Array, UInt64Array,
};
use arrow_buffer::{NullBuffer, OffsetBuffer};
use arrow_schema::{DataType, Schema};
use arrow_select::take::take;
use wayfix::HmmError;
use wayfix::error::At;

use super::{Batch, Results, Table};
use crate::error::Outcome;
use crate::input::{Drives, Form};

/// Failure of a drive.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub(super) kind: &'static str,
    /// The step, as given in the input.
    pub(super) step: Option<i64>,
    pub(super) message: String,
}

/// Returns the kind of a failure and its step, counted from 1.
pub(crate) fn kind(error: &HmmError) -> (&'static str, Option<usize>) {
    match error {
        HmmError::Impossible { step } => ("impossible", Some(*step)),
        HmmError::ImpossibleMove { step } => ("impossible_move", Some(*step)),
        HmmError::Likelihood(At { number: step, .. }) => ("likelihood", Some(*step)),
        HmmError::Predicted { step, .. } | HmmError::PredictedSum { step, .. } => {
            ("transition", Some(*step))
        }
        _ => ("other", None),
    }
}

/// A drive, or one of several paths of a drive.
#[derive(Debug)]
struct Group {
    drive: usize,
    rank: u32,
    steps: usize,
    total: f64,
    failure: Option<Failure>,
}

/// Results step by step. Columns that the table lacks stay empty.
#[derive(Debug, Default)]
pub(super) struct Rows {
    pub(super) step: Vec<i64>,
    pub(super) rank: Vec<u32>,
    pub(super) state: Vec<u32>,
    pub(super) probability: Vec<f64>,
    pub(super) entropy: Vec<f64>,
    pub(super) log_likelihood: Vec<f64>,
    groups: Vec<Group>,
    /// Number of step rows at the end of each group.
    ends: Vec<usize>,
    /// Rows without values, one per failed drive.
    empty: Vec<usize>,
}

impl Rows {
    /// Ends the rows of a drive or path.
    pub(super) fn end(&mut self, drive: usize, rank: u32, steps: usize, total: f64) {
        self.groups.push(Group { drive, rank, steps, total, failure: None });
        self.ends.push(self.step.len());
    }

    /// Adds a failed drive: a row without values in the long form, a null list in the nested one.
    pub(super) fn fail(&mut self, drive: usize, steps: usize, failure: Failure, results: &Results) {
        if results.form == Form::Long && results.table != Table::Drives {
            // The values are arbitrary: `step_columns` marks the row as null. Each column of the
            // table must grow by one, to stay aligned.
            self.empty.push(self.step.len());
            self.step.push(failure.step.unwrap_or(0));
            self.state.push(0);
            match results.table {
                Table::Steps => {
                    self.probability.push(0.0);
                    self.entropy.push(0.0);
                    if results.has_step_logs() {
                        self.log_likelihood.push(0.0);
                    }
                }
                Table::Best(_) => {
                    self.rank.push(0);
                    self.probability.push(0.0);
                }
                Table::Paths(_) | Table::Drives => {}
            }
        }
        let failure = Some(failure);
        self.groups.push(Group { drive, rank: 1, steps, total: 0.0, failure });
        self.ends.push(self.step.len());
    }

    /// Builds the table.
    pub(super) fn finish(
        mut self,
        results: &Results,
        schema: &Arc<Schema>,
        drives: &Drives,
    ) -> Outcome<Batch> {
        // If this is false, there is one row per group.
        let per_row = results.form == Form::Long && results.table != Table::Drives;
        // Group of each row of the table.
        let of_rows: Option<Vec<usize>> = per_row.then(|| {
            let starts = std::iter::once(0).chain(self.ends.iter().copied());
            let lengths = starts.zip(&self.ends).map(|(start, end)| end - start);
            lengths.enumerate().flat_map(|(g, rows)| std::iter::repeat_n(g, rows)).collect()
        });
        let count = of_rows.as_ref().map_or(self.groups.len(), Vec::len);
        let group = |row: usize| &self.groups[of_rows.as_ref().map_or(row, |of| of[row])];
        let by_row = |f: &dyn Fn(&Group) -> usize| -> UInt64Array {
            (0..count).map(|row| f(group(row)) as u64).collect()
        };
        let failed = |group: &Group| group.failure.is_some();
        let any_failed = self.groups.iter().any(failed);
        // Without failures, which is the usual case, skip the masks and texts.
        let failures = any_failed.then(|| {
            NullBuffer::from((0..count).map(|row| !failed(group(row))).collect::<Vec<bool>>())
        });
        let ids = take(&drives.ids, &by_row(&|group| group.drive), None)?;
        let totals: Vec<f64> = (0..count).map(|row| group(row).total).collect();
        let total = Arc::new(Float64Array::new(totals.into(), failures.clone())) as ArrayRef;
        let text = |f: &dyn Fn(&Failure) -> &str| -> ArrayRef {
            if !any_failed {
                return Arc::new(StringArray::new_null(count));
            }
            let texts = (0..count).map(|row| group(row).failure.as_ref().map(f));
            Arc::new(texts.collect::<StringArray>())
        };
        let mut columns: Vec<ArrayRef> = Vec::with_capacity(schema.fields().len());
        let ranks = |nulls: Option<NullBuffer>| -> ArrayRef {
            let ranks: Vec<u32> = (0..count).map(|row| group(row).rank).collect();
            Arc::new(UInt32Array::new(ranks.into(), nulls))
        };
        let is_path = matches!(results.table, Table::Paths(_));
        let steps: Int64Array = if results.table == Table::Drives {
            (0..count).map(|row| group(row).steps as i64).collect()
        } else {
            Int64Array::from(Vec::<i64>::new())
        };
        let (error_kind, error) = (text(&|f| f.kind), text(&|f| &f.message));
        let error_steps =
            (0..count).map(|row| group(row).failure.as_ref().and_then(|failure| failure.step));
        let error_step: ArrayRef = if any_failed {
            Arc::new(error_steps.collect::<Int64Array>())
        } else {
            Arc::new(Int64Array::new_null(count))
        };
        let path_ranks = is_path.then(|| ranks(failures.clone()));
        let (number, wrong) =
            (drives.len() as u64, self.groups.iter().filter(|group| failed(group)).count() as u64);
        let (ends, is_valid) = (std::mem::take(&mut self.ends), failures.clone());
        columns.push(ids);
        if results.table == Table::Drives {
            columns.push(Arc::new(steps));
            columns.extend([total, error_kind, error_step, error]);
        } else if per_row {
            columns.extend(path_ranks);
            columns.extend(self.step_columns(results));
            if results.long_total().is_some() {
                columns.push(total);
            }
            columns.push(error_kind);
        } else {
            columns.extend(path_ranks);
            let fields = results.struct_fields();
            let items = self.step_columns(results);
            // Nested: the steps of group g are those from ends[g − 1] to ends[g], which are the
            // offsets of a list. The list of a failed drive is empty and null.
            let items = Arc::new(StructArray::try_new(fields.clone(), items, None)?);
            let starts = std::iter::once(0).chain(ends);
            let offsets: Vec<i32> = starts
                .map(i32::try_from)
                .collect::<Result<_, _>>()
                .map_err(|_| crate::error::FleetError::Settings(TOO_MANY.to_owned()))?;
            let item =
                Arc::new(arrow_schema::Field::new_list_field(DataType::Struct(fields), false));
            let offsets = OffsetBuffer::new(offsets.into());
            columns.push(Arc::new(ListArray::try_new(item, offsets, items, is_valid)?));
            columns.extend([total, error_kind, error_step, error]);
        }
        let rows = RecordBatch::try_new(schema.clone(), columns)?;
        Ok(Batch { rows, drives: number, steps: drives.elements() as u64, failed: wrong })
    }

    /// Columns of the steps, in the order of [`Results::step_fields`].
    fn step_columns(&mut self, results: &Results) -> Vec<ArrayRef> {
        let nulls = (!self.empty.is_empty()).then(|| {
            let mut valid = vec![true; self.step.len()];
            self.empty.iter().for_each(|&row| valid[row] = false);
            NullBuffer::from(valid)
        });
        let number = |values: &mut Vec<f64>| -> ArrayRef {
            Arc::new(Float64Array::new(std::mem::take(values).into(), nulls.clone()))
        };
        let counted = |values: &mut Vec<u32>| -> ArrayRef {
            Arc::new(UInt32Array::new(std::mem::take(values).into(), nulls.clone()))
        };
        // Not null in an empty row either: there it is the step of the error.
        let step = Int64Array::new(std::mem::take(&mut self.step).into(), None);
        let mut columns: Vec<ArrayRef> = vec![Arc::new(step)];
        if let Table::Best(_) = results.table {
            columns.push(counted(&mut self.rank));
        }
        columns.push(counted(&mut self.state));
        match results.table {
            Table::Steps => {
                columns.extend([number(&mut self.probability), number(&mut self.entropy)]);
            }
            Table::Best(_) => columns.push(number(&mut self.probability)),
            Table::Paths(_) | Table::Drives => {}
        }
        if results.has_step_logs() {
            columns.push(number(&mut self.log_likelihood));
        }
        columns
    }
}

const TOO_MANY: &str = "a batch has more than 2^31 results, which a list cannot hold; use the \
                        long form, or ask for fewer states or paths";
