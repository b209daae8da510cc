//! Drives from files, in batches.

mod columns;
mod csv;
pub(crate) mod files;
pub(crate) mod invalid;
mod lists;
mod long;
mod nested;
mod observed;
mod parquet;
pub(crate) mod pieces;
pub(crate) mod source;
mod strays;
mod text;

use std::collections::VecDeque;
use std::path::Path;

use arrow_array::{Array, ArrayRef, Int64Array, RecordBatch};
use arrow_schema::DataType;

use crate::error::{FleetError, Outcome};
use crate::sensor::{Observation, Sensor};
pub use columns::{ColumnNames, Form, Layout};
pub use invalid::Invalid;
pub use lists::Id as TraceId;
pub use observed::Observed;
use pieces::Pieces;

/// Whole drives, in the order of the input.
///
/// Elements are the steps of all drives, one drive after the other.
#[derive(Debug)]
pub struct Drives {
    /// Trace id of each drive, `Int64` or `Utf8`, without nulls.
    pub ids: ArrayRef,
    /// First element of each drive, and the number of elements.
    pub offsets: Vec<usize>,
    /// Step of each element as the input has it; `None` for 1, 2, … in each drive.
    pub steps: Option<Int64Array>,
    /// Observations of the elements.
    pub observed: Observed,
    /// Form of the input.
    pub form: Form,
    /// First row of the input that these drives come from, from 0.
    pub first_row: u64,
    /// Row of the input after the last that these drives come from.
    pub end_row: u64,
    /// Drives before that row that are no valid input, and after those of the last batch.
    pub invalid: Vec<Invalid>,
}

impl Drives {
    /// Number of drives.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// True without any drive.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Number of elements: the steps of all drives.
    #[must_use]
    pub fn elements(&self) -> usize {
        self.offsets.last().copied().unwrap_or(0)
    }

    /// Step of element `offset + index` of a drive, as the input has it.
    #[must_use]
    pub fn step(&self, drive: usize, index: usize) -> i64 {
        let element = self.offsets[drive] + index;
        self.steps.as_ref().map_or(index as i64 + 1, |steps| steps.value(element))
    }

    /// Returns the observations of all elements.
    ///
    /// # Errors
    ///
    /// [`FleetError::Value`] for one that the sensor cannot have.
    pub fn observations(&self) -> Outcome<Vec<Observation>> {
        if let Some(symbols) = self.observed.symbols() {
            return Ok(symbols
                .iter()
                .map(|&symbol| Observation::Symbol(symbol as usize))
                .collect());
        }
        let observation = |element| {
            let refused = |message: String| self.refuse(element, &message);
            self.observed.get(element).map_err(refused)
        };
        (0..self.elements()).map(observation).collect()
    }

    /// Some of the drives, one after the other.
    pub(crate) fn part(&self, drives: std::ops::Range<usize>) -> Self {
        let elements = self.offsets[drives.start]..self.offsets[drives.end];
        let (first, count) = (elements.start, elements.len());
        let offsets = &self.offsets[drives.start..=drives.end];
        let rows = match self.form {
            Form::Long => elements.clone(),
            Form::Nested => drives.clone(),
        };
        Self {
            ids: self.ids.slice(drives.start, drives.len()),
            offsets: offsets.iter().map(|offset| offset - first).collect(),
            steps: self.steps.as_ref().map(|steps| steps.slice(first, count)),
            observed: self.observed.part(elements),
            form: self.form,
            first_row: self.first_row + rows.start as u64,
            end_row: self.first_row + rows.end as u64,
            invalid: Vec::new(),
        }
    }

    /// Error about the observation of an element.
    #[must_use]
    pub fn refuse(&self, element: usize, message: &str) -> FleetError {
        let (row, message) = locate(self.form, self.first_row, &self.offsets, element, message);
        FleetError::value(self.observed.column(), row, message)
    }
}

/// Row of an element, and a message that names its step if a row has several.
fn locate(
    form: Form,
    first_row: u64,
    offsets: &[usize],
    element: usize,
    message: &str,
) -> (u64, String) {
    match form {
        Form::Long => (first_row + element as u64, message.to_owned()),
        Form::Nested => {
            let drive = offsets.partition_point(|&offset| offset <= element).saturating_sub(1);
            let index = element - offsets.get(drive).copied().unwrap_or(0);
            (first_row + drive as u64, format!("element {index} of the list: {message}"))
        }
    }
}

/// Drives of a file.
#[expect(missing_debug_implementations, reason = "readers have none")]
pub struct Input {
    /// Batches of drives.
    pub batches: Box<dyn Iterator<Item = Outcome<Drives>> + Send>,
    /// Number of rows of the file, if it is known.
    pub rows: Option<u64>,
    /// Type of trace ids, `Int64` or `Utf8`.
    pub id_type: DataType,
    /// Form of the file.
    pub form: Form,
}

/// Opens a file, and skips rows that end with a drive.
///
/// A name that ends in `.csv` is of a CSV file, any other of a Parquet file. Memory grows with the
/// longest drive and with the row groups of a file, not with their number.
///
/// # Errors
///
/// [`FleetError`] if the file cannot be read, is damaged, or lacks a column that the sensor needs.
pub fn open(path: &Path, names: &ColumnNames, sensor: &Sensor, skip: u64) -> Outcome<Input> {
    open_with(path, names, sensor, skip, &Reading::default())
}

/// Way to read a file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Reading {
    /// Number of the file.
    file: usize,
    /// Takes note of the pieces that are read.
    pieces: Option<Pieces>,
    /// True if drives that are not valid are left out, false if they are an error.
    leave_out: bool,
}

/// True for a CSV file, by its name.
fn is_csv(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
}

fn open_with(
    path: &Path,
    names: &ColumnNames,
    sensor: &Sensor,
    skip: u64,
    reading: &Reading,
) -> Outcome<Input> {
    let (batches, rows, layout) = if is_csv(path) {
        let (batches, layout) = csv::open(path, names, sensor, skip, reading)?;
        (batches, None, layout)
    } else {
        let (batches, rows, layout) = parquet::open(path, names, sensor, skip, reading)?;
        (batches, Some(rows), layout)
    };
    let (id_type, form) = (layout.id_type.clone(), layout.form);
    let leave_out = reading.leave_out;
    let batches: Box<dyn Iterator<Item = Outcome<Drives>> + Send> = match form {
        Form::Long => Box::new(long::LongDrives::new(batches, layout, skip, leave_out)),
        Form::Nested => Box::new(nested::nested(batches, layout, skip, leave_out)),
    };
    Ok(Input { batches, rows, id_type, form })
}

/// Reads drives of a record batch in the nested form, of which the first row has a number.
///
/// # Errors
///
/// [`FleetError`] for a value that the layout's sensor cannot have.
pub fn drives(batch: &RecordBatch, layout: &Layout, first_row: u64) -> Outcome<Drives> {
    nested::drives(batch, layout, first_row)
}

/// Leaves out rows before those that are wanted: readers begin where a batch begins that is the
/// same in every run.
fn without(
    batches: impl Iterator<Item = Outcome<Rows>> + Send + 'static,
    mut rows: u64,
) -> Batches {
    Box::new(batches.filter_map(move |batch| {
        let Rows { batch, wrong } = match batch {
            Ok(batch) => batch,
            Err(error) => return Some(Err(error)),
        };
        let all = batch.num_rows();
        let cut = usize::try_from(rows).unwrap_or(usize::MAX).min(all);
        rows -= cut as u64;
        let after = |(row, error): (usize, FleetError)| Some((row.checked_sub(cut)?, error));
        let wrong = wrong.into_iter().filter_map(after).collect();
        (cut < all).then(|| Ok(Rows { batch: batch.slice(cut, all - cut), wrong }))
    }))
}

/// Rows as a reader has them.
#[derive(Debug)]
struct Rows {
    batch: RecordBatch,
    /// Rows with text that cannot be read, in their order; its place has a null.
    wrong: VecDeque<(usize, FleetError)>,
}

impl From<RecordBatch> for Rows {
    fn from(batch: RecordBatch) -> Self {
        Self { batch, wrong: VecDeque::new() }
    }
}

/// Batches of rows as a reader has them.
type Batches = Box<dyn Iterator<Item = Outcome<Rows>> + Send>;
