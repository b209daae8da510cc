//! Files of a table, as their readers find them.

use std::fs::{self, File};
use std::hash::Hasher;
use std::io::{self, Read};
use std::path::PathBuf;
use std::time::SystemTime;

use datafusion::common::TableReference;
use datafusion::datasource::listing::ListingTable;
use datafusion::object_store::local::LocalFileSystem;
use datafusion::prelude::SessionContext;
use parquet::file::metadata::ParquetMetaDataReader;
use twox_hash::XxHash3_64;

use super::source::Source;
use crate::error::{FleetError, Outcome};

/// Bytes that are read at a time.
const BUFFER: usize = 1 << 20;

/// Parquet files of a table, in the order in which they are read.
#[derive(Debug)]
pub(super) struct Files {
    paths: Vec<PathBuf>,
}

impl Files {
    /// Files of a table that is registered with a context that reads it as one sequence of rows.
    pub(super) async fn of(source: &Source, context: &SessionContext) -> Outcome<Self> {
        let table = context.table_provider(TableReference::bare(source.name.as_str())).await?;
        let Some(table) = table.downcast_ref::<ListingTable>() else {
            return Err(FleetError::format(&source.path, "is not a table of files"));
        };
        let state = context.state();
        let listed = table.list_files_for_scan(&state, &[], None).await?;
        let system = LocalFileSystem::new();
        let files = listed.file_groups.iter().flat_map(|group| group.files());
        let paths = files.map(|file| system.path_to_filesystem(&file.object_meta.location));
        let paths = paths.collect::<Result<Vec<_>, _>>();
        Ok(Self { paths: paths.map_err(|error| FleetError::format(&source.path, error))? })
    }

    /// Rows after which row groups of `part` values together end, of the column with the most:
    /// steps, of a long table and of a nested one.
    pub(super) fn groups_of(&self, part: u64) -> Outcome<Vec<u64>> {
        let (mut ends, mut row, mut values) = (Vec::new(), 0, 0);
        for path in &self.paths {
            let file = File::open(path).map_err(FleetError::file(path))?;
            let metadata = ParquetMetaDataReader::new().parse_and_finish(&file);
            for group in metadata.map_err(FleetError::parquet(path))?.row_groups() {
                let most = group.columns().iter().map(|column| column.num_values()).max();
                row += group.num_rows().max(0).cast_unsigned();
                values += most.unwrap_or(0).max(0).cast_unsigned();
                if values >= part {
                    ends.push(row);
                    values = 0;
                }
            }
        }
        Ok(ends)
    }

    /// Hash of the content of all files in their order (XXH3).
    pub(super) fn hash(&self) -> Outcome<String> {
        let mut hash = XxHash3_64::default();
        let mut buffer = vec![0; BUFFER];
        for path in &self.paths {
            let wrong = FleetError::file(path);
            let mut file = File::open(path).map_err(&wrong)?;
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

    /// Sizes and times of all files, which change when one is written to.
    pub(super) fn stamps(&self) -> Outcome<Vec<(u64, Option<SystemTime>)>> {
        let stamp = |path: &PathBuf| {
            let found = fs::metadata(path).map_err(FleetError::file(path))?;
            Ok((found.len(), found.modified().ok()))
        };
        self.paths.iter().map(stamp).collect()
    }

    /// Refuses files that were written to since.
    pub(super) fn unchanged(&self, since: &[(u64, Option<SystemTime>)]) -> Outcome<()> {
        for ((path, now), before) in self.paths.iter().zip(self.stamps()?).zip(since) {
            if now != *before {
                return Err(FleetError::changed(path, "changes while the query reads it"));
            }
        }
        Ok(())
    }
}
