//! Tables of a query: their files and their order.

use std::fs;
use std::path::PathBuf;

use datafusion::common::TableReference;
use datafusion::prelude::{CsvReadOptions, ParquetReadOptions, SessionContext, ident};

use super::key;
use super::query::context;
use super::starts::Starts;
use crate::error::{FleetError, Outcome};

/// Rows in a batch when the order of a table is checked.
const CHECKED: usize = 1 << 16;

/// A table of a query.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Name of the table.
    pub name: String,
    /// File: CSV by its name, else Parquet; or a folder of Parquet files.
    pub path: PathBuf,
    /// Columns by which the rows are sorted and which identify them; empty if they are not sorted.
    /// The order is checked before the query.
    pub key: Vec<String>,
}

impl Source {
    /// True for a CSV file, by its name.
    pub(super) fn is_csv(&self) -> bool {
        self.path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"))
    }

    /// Registers the table; with its order if `sorted`, which must be known to hold.
    pub(super) async fn register(&self, context: &SessionContext, sorted: bool) -> Outcome<()> {
        let wrong = FleetError::file(&self.path);
        let is_folder = fs::metadata(&self.path).map_err(&wrong)?.is_dir();
        let path = fs::canonicalize(&self.path).map_err(&wrong)?;
        let Some(path) = path.to_str() else {
            return Err(FleetError::format(&self.path, "the path is not Unicode"));
        };
        let name = TableReference::bare(self.name.as_str());
        let order: Vec<_> = self.key.iter().map(|column| ident(column).sort(true, false)).collect();
        let file_sort_order = if sorted && !order.is_empty() { vec![order] } else { Vec::new() };
        if self.is_csv() {
            let options =
                CsvReadOptions { file_sort_order, file_extension: "", ..Default::default() };
            context.register_csv(name, path, options).await?;
        } else {
            let file_extension = if is_folder { ".parquet" } else { "" };
            let options =
                ParquetReadOptions { file_sort_order, file_extension, ..Default::default() };
            context.register_parquet(name, path, options).await?;
        }
        Ok(())
    }

    /// Checks the order of the rows, and passes their keys to `starts` on the way.
    pub(super) async fn check(&self, starts: &mut Starts) -> Outcome<()> {
        if self.key.is_empty() {
            return Ok(());
        }
        let context = context(1, CHECKED);
        self.register(&context, false).await?;
        let table = context.table(TableReference::bare(self.name.as_str())).await?;
        let columns = self.key.iter().map(ident).collect::<Vec<_>>();
        key::check(table.select(columns)?.execute_stream().await?, starts).await
    }
}
