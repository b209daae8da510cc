//! Files of a table, as DataFusion lists them.

use std::borrow::Cow;
use std::fs::{self, File};
use std::hash::Hasher;
use std::io::{self, Read};
use std::ops::Range;
use std::path::PathBuf;
use std::time::SystemTime;

use datafusion::common::TableReference;
use datafusion::datasource::listing::ListingTable;
use datafusion::datasource::physical_plan::FileGroup;
use datafusion::object_store::local::LocalFileSystem;
use datafusion::prelude::SessionContext;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaDataReader};
use twox_hash::XxHash3_64;

use super::source::Source;
use super::starts::Starts;
use crate::error::{FleetError, Outcome};

/// Bytes read at a time.
const BUFFER: usize = 1 << 20;

/// Parquet files of a table, in the order they are read.
#[derive(Debug)]
pub(super) struct Files {
    paths: Vec<PathBuf>,
    /// First row of each file in the table, and at the end the number of rows.
    borders: Vec<u64>,
    /// Values and rows of the row groups of each file.
    groups: Vec<Vec<(u64, u64)>>,
}

impl Files {
    /// Finds the files of a table registered with `context`, which must read it as one sequence of
    /// rows.
    pub(super) async fn of(source: &Source, context: &SessionContext) -> Outcome<Self> {
        let table = context.table_provider(TableReference::bare(source.name.as_str())).await?;
        let Some(table) = table.downcast_ref::<ListingTable>() else {
            return Err(FleetError::format(&source.path, "is not a table of files"));
        };
        let state = context.state();
        let listed = table.list_files_for_scan(&state, &[], None).await?;
        let system = LocalFileSystem::new();
        let files = listed.file_groups.iter().flat_map(FileGroup::files);
        let paths = files.map(|file| system.path_to_filesystem(&file.object_meta.location));
        let paths = paths.collect::<Result<Vec<_>, _>>();
        let paths = paths.map_err(|error| FleetError::format(&source.path, error))?;
        let (mut borders, mut groups) = (vec![0], Vec::with_capacity(paths.len()));
        for path in &paths {
            let file = File::open(path).map_err(FleetError::file(path))?;
            let metadata = ParquetMetaDataReader::new().parse_and_finish(&file);
            let metadata = metadata.map_err(FleetError::parquet(path))?;
            let of = metadata.row_groups().iter().map(|group| {
                // The number of steps, in either form: the values of the column with the most.
                let values = group.columns().iter().map(ColumnChunkMetaData::num_values).max();
                (
                    values.unwrap_or(0).max(0).cast_unsigned(),
                    group.num_rows().max(0).cast_unsigned(),
                )
            });
            groups.push(of.collect::<Vec<_>>());
            let rows = groups[groups.len() - 1].iter().map(|group| group.1).sum::<u64>();
            borders.push(borders[borders.len() - 1] + rows);
        }
        Ok(Self { paths, borders, groups })
    }

    /// Number of values (steps).
    pub(super) fn values(&self) -> u64 {
        self.groups.iter().flatten().map(|group| group.0).sum()
    }

    /// Rows at which ranges may begin: the ends of row groups once `part` values have come
    /// together, and the beginnings of files.
    pub(super) fn starts(&self, part: u64) -> Starts {
        let mut wanted = Vec::new();
        for (groups, &first) in self.groups.iter().zip(&self.borders) {
            let (mut row, mut sum) = (first, 0);
            for (values, rows) in groups {
                row += rows;
                sum += values;
                if sum >= part {
                    wanted.push(row);
                    sum = 0;
                }
            }
        }
        Starts::new(wanted, self.borders[1..].to_vec())
    }

    /// Paths of the files that contain some of these rows; of all files, if the range is empty.
    pub(super) fn with_rows(&self, rows: &Range<u64>) -> impl Iterator<Item = Cow<'_, str>> {
        let borders = self.borders.windows(2);
        let here =
            borders.map(|file| rows.is_empty() || (file[0] < rows.end && file[1] > rows.start));
        self.paths.iter().zip(here).filter(|file| file.1).map(|file| file.0.to_string_lossy())
    }

    /// Hash of the contents of all files in order (XXH3).
    pub(super) fn hash(&self) -> Outcome<String> {
        let mut hash = XxHash3_64::default();
        let mut buffer = vec![0; BUFFER];
        for path in &self.paths {
            let wrong = FleetError::file(path);
            let mut file = File::open(path).map_err(&wrong)?;
            // The length separates files: bytes moved from one to the next change the hash.
            hash.write(&file.metadata().map_err(&wrong)?.len().to_le_bytes());
            loop {
                match file.read(&mut buffer) {
                    Ok(0) => break,
                    Ok(count) => hash.write(&buffer[..count]),
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => return Err(wrong(error)),
                }
            }
        }
        Ok(format!("{:016x}", hash.finish()))
    }

    /// Sizes and times of modification of all files, which change when one is written to.
    pub(super) fn stamps(&self) -> Outcome<Vec<(u64, Option<SystemTime>)>> {
        let stamp = |path: &PathBuf| {
            let found = fs::metadata(path).map_err(FleetError::file(path))?;
            Ok((found.len(), found.modified().ok()))
        };
        self.paths.iter().map(stamp).collect()
    }

    /// Refuses files that were written to since `since` was taken.
    pub(super) fn unchanged(&self, since: &[(u64, Option<SystemTime>)]) -> Outcome<()> {
        for ((path, now), before) in self.paths.iter().zip(self.stamps()?).zip(since) {
            if now != *before {
                return Err(FleetError::changed(path, "changed while the query was reading it"));
            }
        }
        Ok(())
    }
}
