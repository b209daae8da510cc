//! Parquet files.

use std::fs::File;
use std::path::{Path, PathBuf};

use arrow::error::ArrowError;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader,
    ParquetRecordBatchReaderBuilder,
};
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;

use super::columns::{ColumnNames, Layout};
use super::{Batches, without};
use crate::error::{FleetError, Outcome};
use crate::sensor::{Kind, Sensor};

/// Values of a batch, if a step has one observation: some 30,000 steps.
const FEW_VALUES: u64 = 3 << 15;
/// Values of a batch, if a step lists many: 8 MB.
const MANY_VALUES: u64 = 1 << 20;

/// Opens a file after rows to skip; also returns the number of its rows.
pub(super) fn open(
    path: &Path,
    names: &ColumnNames,
    sensor: &Sensor,
    skip: u64,
) -> Outcome<(Batches, u64, Layout)> {
    let file = File::open(path).map_err(FleetError::file(path))?;
    let wrong = FleetError::parquet(path);
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(&wrong)?;
    let layout = Layout::new(builder.schema(), names, sensor)?;
    let needed = layout.needed();
    let is_needed = |field: &&str| needed.contains(field);
    let fields = builder.schema().fields().iter().enumerate();
    let roots = fields.filter(|(_, field)| is_needed(&field.name().as_str()));
    let roots: Vec<usize> = roots.map(|(root, _)| root).collect();
    let mask = ProjectionMask::roots(builder.parquet_schema(), roots);
    let metadata = builder.metadata().clone();
    let values = match sensor.kind() {
        Kind::Vector { .. } | Kind::Sparse(_) => MANY_VALUES,
        _ => FEW_VALUES,
    };
    let rows = rows_of_batch(&metadata, &mask, values);
    // The row group that the first row is in, and rows of it that come before.
    let (mut left, mut first) = (skip, 0);
    for group in metadata.row_groups() {
        let rows = group.num_rows().max(0).cast_unsigned();
        if left < rows {
            break;
        }
        (left, first) = (left - rows, first + 1);
    }
    // Each row group by itself: where batches begin does not depend on where reading begins.
    let (file, arrow) = (
        FileOf::new(path)?,
        ArrowReaderMetadata::try_new(metadata.clone(), ArrowReaderOptions::new())
            .map_err(&wrong)?,
    );
    let batches = (first..metadata.num_row_groups()).flat_map(move |group| {
        let opened = file.read(&arrow, &mask, group, rows);
        let (batches, error) = match opened {
            Ok(batches) => (Some(batches), None),
            Err(error) => (None, Some(Err(error))),
        };
        let path = file.path.clone();
        let wrong = move |error| refused(&path, error);
        let batches = batches.into_iter().flatten();
        batches.map(move |batch| batch.map_err(&wrong)).chain(error)
    });
    let all = metadata.file_metadata().num_rows().max(0).cast_unsigned();
    Ok((without(batches, left), all, layout))
}

/// An open file, and its name.
struct FileOf {
    path: PathBuf,
    file: File,
}

impl FileOf {
    fn new(path: &Path) -> Outcome<Self> {
        let file = File::open(path).map_err(FleetError::file(path))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Reads a row group.
    fn read(
        &self,
        metadata: &ArrowReaderMetadata,
        mask: &ProjectionMask,
        group: usize,
        rows: usize,
    ) -> Outcome<ParquetRecordBatchReader> {
        let file = self.file.try_clone().map_err(FleetError::file(&self.path))?;
        ParquetRecordBatchReaderBuilder::new_with_metadata(file, metadata.clone())
            .with_batch_size(rows)
            .with_projection(mask.clone())
            .with_row_groups(vec![group])
            .build()
            .map_err(FleetError::parquet(&self.path))
    }
}

/// Error of a batch. Those of the system keep their kind: another run may succeed.
fn refused(path: &Path, error: ArrowError) -> FleetError {
    match error {
        ArrowError::ParquetError(message) => FleetError::format(path, message),
        ArrowError::ExternalError(cause) => {
            FleetError::parquet(path)(ParquetError::External(cause))
        }
        other => FleetError::format(path, other),
    }
}

/// Rows that have about so many values, in the row group where a row has most.
fn rows_of_batch(metadata: &ParquetMetaData, mask: &ProjectionMask, values: u64) -> usize {
    let of_row = |group: &parquet::file::metadata::RowGroupMetaData| {
        let leaves = group.columns().iter().enumerate();
        let read = leaves.filter(|(leaf, _)| mask.leaf_included(*leaf));
        let all: i64 = read.map(|(_, column)| column.num_values()).sum();
        all.max(1).cast_unsigned().div_ceil(group.num_rows().max(1).cast_unsigned())
    };
    let most = metadata.row_groups().iter().map(of_row).max().unwrap_or(1);
    (values / most).clamp(1, values) as usize
}
