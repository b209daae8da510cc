//! Drives from files, in batches.
//!
//! A batch holds whole drives only. Where batches begin depends on the rows of the file and not on
//! where reading began, so a run that continues cuts the same batches.

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

/// A batch of whole drives, in the order of the input.
///
/// The elements are the steps of all drives, drive after drive.
#[derive(Debug)]
pub struct Drives {
    /// Trace id of each drive, `Int64` or `Utf8`, without nulls.
    pub ids: ArrayRef,
    /// First element of each drive, and at the end the number of elements.
    pub offsets: Vec<usize>,
    /// Step of each element as given in the input; `None` for 1, 2, … in each drive.
    pub steps: Option<Int64Array>,
    /// Observations of the elements.
    pub observed: Observed,
    /// Form of the input.
    pub form: Form,
    /// First input row of these drives, from 0.
    pub first_row: u64,
    /// Input row after the last one of these drives.
    pub end_row: u64,
    /// Invalid drives before that row and after the previous batch.
    pub invalid: Vec<Invalid>,
}

impl Drives {
    /// Number of drives.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// True without drives.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Number of elements: the steps of all drives.
    #[must_use]
    pub fn elements(&self) -> usize {
        self.offsets.last().copied().unwrap_or(0)
    }

    /// Step of element `index` of a drive, as given in the input.
    #[must_use]
    pub fn step(&self, drive: usize, index: usize) -> i64 {
        let element = self.offsets[drive] + index;
        self.steps.as_ref().map_or(index as i64 + 1, |steps| steps.value(element))
    }

    /// Returns the observations of all elements.
    ///
    /// # Errors
    ///
    /// [`FleetError::Value`] for an observation that the sensor cannot take.
    pub fn observations(&self) -> Outcome<Vec<Observation>> {
        if let Some(symbols) = self.observed.symbols() {
            // Symbols were checked when they were read. This is the most frequent sensor, and needs
            // no test per element.
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

    /// A range of the drives.
    pub(crate) fn part(&self, drives: std::ops::Range<usize>) -> Self {
        let elements = self.offsets[drives.start]..self.offsets[drives.end];
        let (first, count) = (elements.start, elements.len());
        let offsets = &self.offsets[drives.start..=drives.end];
        // A batch covers consecutive rows: one per element, or one per drive.
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

    /// Returns the error for the observation of an element.
    #[must_use]
    pub fn refuse(&self, element: usize, message: &str) -> FleetError {
        let (row, message) = locate(self.form, self.first_row, &self.offsets, element, message);
        FleetError::value(self.observed.column(), row, message)
    }
}

/// Returns the row of an element, and the message, with the position in the list if a row holds
/// several elements.
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
            // The last drive that begins at or before the element; this passes over empty drives,
            // which share its offset.
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
    /// Number of rows of the file, if known.
    pub rows: Option<u64>,
    /// Type of trace ids, `Int64` or `Utf8`.
    pub id_type: DataType,
    /// Form of the file.
    pub form: Form,
}

/// Opens a file, and skips `skip` rows, which must end with a drive.
///
/// A name that ends in `.csv` means CSV, any other Parquet. Memory grows with the longest drive and
/// the size of a row group, not with the number of row groups.
///
/// # Errors
///
/// [`FleetError`] if the file cannot be read, is damaged, or lacks a column that the sensor needs.
pub fn open(path: &Path, names: &ColumnNames, sensor: &Sensor, skip: u64) -> Outcome<Input> {
    open_with(path, names, sensor, skip, &Reading::default())
}

/// Options for reading a file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Reading {
    /// Number of the file.
    file: usize,
    /// Where to record the pieces that are read.
    pieces: Option<Pieces>,
    /// True if invalid drives are left out, false if they are an error.
    leave_out: bool,
}

/// True if the name is that of a CSV file.
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

/// Reads the drives of a record batch in the nested form, whose first row is number `first_row`.
///
/// # Errors
///
/// [`FleetError`] for a value that the sensor of the layout cannot take.
pub fn drives(batch: &RecordBatch, layout: &Layout, first_row: u64) -> Outcome<Drives> {
    nested::drives(batch, layout, first_row)
}

/// Drops the first `rows` rows. Readers start at the batch boundary before the wanted row, a
/// boundary that is the same in every run.
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
        // `checked_sub` drops the errors of rows that are cut off.
        rows -= cut as u64;
        let after = |(row, error): (usize, FleetError)| Some((row.checked_sub(cut)?, error));
        let wrong = wrong.into_iter().filter_map(after).collect();
        (cut < all).then(|| Ok(Rows { batch: batch.slice(cut, all - cut), wrong }))
    }))
}

/// Rows as a reader delivers them.
#[derive(Debug)]
struct Rows {
    batch: RecordBatch,
    /// Rows with unreadable text, in order; the value itself is null.
    wrong: VecDeque<(usize, FleetError)>,
}

impl From<RecordBatch> for Rows {
    fn from(batch: RecordBatch) -> Self {
        Self { batch, wrong: VecDeque::new() }
    }
}

/// Batches of rows as a reader delivers them.
type Batches = Box<dyn Iterator<Item = Outcome<Rows>> + Send>;
