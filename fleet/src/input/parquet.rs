//! Parquet files, read row group by row group.
//!
//! Each group is hashed before it is decoded. Batches never cross a group boundary, and have the
//! same number of rows in every run.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_schema::ArrowError;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader,
    ParquetRecordBatchReaderBuilder,
};
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;

use super::columns::{ColumnNames, Layout};
use super::pieces::Piece;
use super::{Batches, Reading, Rows, without};
use crate::error::{FleetError, Outcome, Replaced};
use crate::sensor::{Kind, Sensor};
use crate::storage::Stored;

/// Values in a batch if a step has one observation: some 30,000 steps.
const FEW_VALUES: u64 = 3 << 15;
/// Values in a batch if a step lists many: 8 MB.
const MANY_VALUES: u64 = 1 << 20;

/// Opens a file, and skips `skip` rows; also returns its number of rows.
pub(super) fn open(
    path: &Path,
    names: &ColumnNames,
    sensor: &Sensor,
    skip: u64,
    reading: &Reading,
) -> Outcome<(Batches, u64, Layout)> {
    let wrong = FleetError::parquet(path);
    let (stored, metadata, mask, layout) = layout(path, names, sensor)?;
    let file = FileOf { path: path.to_owned(), stored };
    let values = match sensor.kind() {
        Kind::Vector { .. } | Kind::Sparse(_) => MANY_VALUES,
        _ => FEW_VALUES,
    };
    let rows = rows_of_batch(&metadata, &mask, values);
    // Find the row group with the first wanted row, and the number of its rows to drop.
    let (mut left, mut first) = (skip, 0);
    for group in metadata.row_groups() {
        let rows = group.num_rows().max(0).cast_unsigned();
        // `left == 0` only matters for an empty group: it is also a piece, and has to be recorded.
        if left < rows || left == 0 {
            break;
        }
        (left, first) = (left - rows, first + 1);
    }
    // Each row group has a reader of its own, so where batches begin does not depend on where
    // reading begins.
    let arrow = ArrowReaderMetadata::try_new(metadata.clone(), ArrowReaderOptions::new())
        .map_err(&wrong)?;
    let all = metadata.file_metadata().num_rows().max(0).cast_unsigned();
    let (mut first_row, reading, count) = (skip - left, reading.clone(), metadata.num_row_groups());
    // Once more after the last group, to check that the file is still the same.
    let batches = (first..=count).flat_map(move |group| {
        let open = || {
            file.is_unchanged()?;
            if group == count {
                return Ok(None);
            }
            let wrong = FleetError::file(&file.path);
            let ranges = super::pieces::ranges(&metadata, &mask, group);
            let stored = file.stored.with(&ranges).map_err(&wrong)?;
            if let Some(pieces) = &reading.pieces {
                let hash =
                    super::pieces::group(&stored, &metadata, &mask, group).map_err(&wrong)?;
                // The piece is recorded before its rows are handed out, so a part can never end
                // with rows of an unrecorded piece.
                pieces.add(Piece { file: reading.file, number: group as u64, first_row, hash });
            }
            file.read(stored, &arrow, &mask, group, rows).map(Some)
        };
        let (batches, error) = match open() {
            Ok(batches) => (batches, None),
            Err(error) => (None, Some(Err(error))),
        };
        if group < count {
            first_row += metadata.row_group(group).num_rows().max(0).cast_unsigned();
        }
        let path = file.path.clone();
        let wrong = move |error| refused(&path, error);
        let batches = batches.into_iter().flatten();
        batches.map(move |batch| batch.map(Rows::from).map_err(&wrong)).chain(error)
    });
    Ok((without(batches, left), all, layout))
}

/// Opens a file, and finds the columns to read.
pub(super) fn columns(
    path: &Path,
    names: &ColumnNames,
    sensor: &Sensor,
) -> Outcome<(Stored, Arc<ParquetMetaData>, ProjectionMask)> {
    let (stored, metadata, mask, _) = layout(path, names, sensor)?;
    Ok((stored, metadata, mask))
}

fn layout(
    path: &Path,
    names: &ColumnNames,
    sensor: &Sensor,
) -> Outcome<(Stored, Arc<ParquetMetaData>, ProjectionMask, Layout)> {
    let stored = Stored::open(path)?;
    let builder = ParquetRecordBatchReaderBuilder::try_new(stored.clone())
        .map_err(FleetError::parquet(path))?;
    let layout = Layout::new(builder.schema(), names, sensor)?;
    let needed = layout.needed();
    let is_needed = |field: &&str| needed.contains(field);
    let fields = builder.schema().fields().iter().enumerate();
    let roots = fields.filter(|(_, field)| is_needed(&field.name().as_str()));
    let roots: Vec<usize> = roots.map(|(root, _)| root).collect();
    let mask = ProjectionMask::roots(builder.parquet_schema(), roots);
    Ok((stored, builder.metadata().clone(), mask, layout))
}

/// An open file with its path.
struct FileOf {
    path: PathBuf,
    stored: Stored,
}

impl FileOf {
    /// Row groups of a local file are hashed first and read again to be decoded. This detects a
    /// change in between.
    fn is_unchanged(&self) -> Outcome<()> {
        let wrong = FleetError::file(&self.path);
        if self.stored.is_unchanged().map_err(&wrong)? {
            return Ok(());
        }
        Err(wrong(std::io::Error::other(Replaced)))
    }

    /// Reads a row group.
    fn read(
        &self,
        stored: Stored,
        metadata: &ArrowReaderMetadata,
        mask: &ProjectionMask,
        group: usize,
        rows: usize,
    ) -> Outcome<ParquetRecordBatchReader> {
        ParquetRecordBatchReaderBuilder::new_with_metadata(stored, metadata.clone())
            .with_batch_size(rows)
            .with_projection(mask.clone())
            .with_row_groups(vec![group])
            .build()
            .map_err(FleetError::parquet(&self.path))
    }
}

/// Error of a batch. I/O errors keep their kind: a second run may succeed.
fn refused(path: &Path, error: ArrowError) -> FleetError {
    match error {
        ArrowError::ParquetError(message) => FleetError::format(path, message),
        ArrowError::ExternalError(cause) => {
            FleetError::parquet(path)(ParquetError::External(cause))
        }
        other => FleetError::format(path, other),
    }
}

/// Number of rows with about `values` values, by the row group with the most values per row.
fn rows_of_batch(metadata: &ParquetMetaData, mask: &ProjectionMask, values: u64) -> usize {
    let of_row = |group: &parquet::file::metadata::RowGroupMetaData| {
        let leaves = group.columns().iter().enumerate();
        let read = leaves.filter(|(leaf, _)| mask.leaf_included(*leaf));
        // `num_values` counts the elements of lists, so this is the mean number of values in a row.
        let all: i64 = read.map(|(_, column)| column.num_values()).sum();
        all.max(1).cast_unsigned().div_ceil(group.num_rows().max(1).cast_unsigned())
    };
    let most = metadata.row_groups().iter().map(of_row).max().unwrap_or(1);
    (values / most).clamp(1, values) as usize
}
