//! A query over files, with its rows in a Parquet file.

use std::fs::{self, File};
use std::io::Seek;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow::datatypes::{DataType, Schema};
use datafusion::common::TableReference;
use datafusion::error::DataFusionError;
use datafusion::execution::SendableRecordBatchStream;
use datafusion::execution::context::SQLOptions;
use datafusion::physical_plan::sorts::sort_preserving_merge::SortPreservingMergeExec;
use datafusion::physical_plan::{ExecutionPlan, ExecutionPlanProperties, execute_stream};
use datafusion::prelude::{
    CsvReadOptions, DataFrame, ParquetReadOptions, SessionConfig, SessionContext, ident,
};
use futures::StreamExt;
use parquet::arrow::ArrowWriter;
use parquet::basic::Encoding;
use parquet::file::properties::{EnabledStatistics, WriterProperties};

use super::{Models, key, register_with};
use crate::error::{FleetError, Outcome};
use crate::journal::open_locked;
use crate::partial::beside;
use crate::properties::Pack;

/// Times that a query is given to a cluster, if executors are lost after its last task.
pub(super) const ATTEMPTS: usize = 3;
/// Bytes of a row group of the output, at most.
const GROUP: usize = 16 << 20;
/// Rows of a batch when the order of a table is checked.
const CHECKED: usize = 1 << 16;

/// A file that is a table of a query.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Name of the table.
    pub name: String,
    /// File, CSV if its name ends so, else Parquet; or a folder of Parquet files.
    pub path: PathBuf,
    /// Columns by which the rows are sorted, and which tell them apart; none if they are not
    /// sorted. This is checked before the query.
    pub key: Vec<String>,
}

/// A query over files.
#[derive(Debug, Clone)]
pub struct Query {
    /// Tables.
    pub tables: Vec<Source>,
    /// Text of the query.
    pub sql: String,
    /// File of the rows, Parquet.
    pub output: PathBuf,
    /// Compression of the output.
    pub pack: Pack,
    /// Number of threads, or of tasks on a cluster.
    pub threads: usize,
    /// Scheduler of a cluster, `host:port`, that runs the query; needs the feature `ballista`.
    pub scheduler: Option<String>,
    /// Folder of the models, if only its files can be named; see [`Models::in_folder`]. Executors
    /// of a cluster have an option of their own.
    pub models: Option<PathBuf>,
    /// Rows of a batch.
    pub batch: usize,
    /// Replaces an output that exists.
    pub force: bool,
}

/// Context with the functions, for queries that work on batches in the order of their tables with
/// so many threads.
///
/// Files are read one after the other, since only then a merge that keeps the order does not wait
/// for one half of a file while the other is read.
#[must_use]
pub fn context(threads: usize, batch: usize) -> SessionContext {
    context_with(threads, batch, &Models::default())
}

/// As [`context`], with models from a folder.
fn context_with(threads: usize, batch: usize, models: &Models) -> SessionContext {
    let mut config = SessionConfig::new()
        .with_target_partitions(threads.max(1))
        .with_batch_size(batch.max(1))
        .with_repartition_file_scans(false);
    // Texts of the output as other tools have them.
    config.options_mut().execution.parquet.schema_force_view_types = false;
    let context = SessionContext::new_with_config(config);
    register_with(&context, models);
    context
}

/// Runs a query, and returns the number of rows.
///
/// The output appears under its name when it is complete; until then it has the ending
/// `.unfinished`, and is locked: a second run with the same output is refused. Rows have an order if
/// the query has one, or the table and all that is done to it.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, another run writes the same output, a table
/// is not sorted as it should be, or the query fails; without an output then.
pub fn query(query: &Query) -> Outcome<u64> {
    let unfinished = beside(&query.output, ".unfinished");
    query.check_output()?;
    let file = open_locked(&unfinished)?;
    // Another run may have ended in between.
    let done = query.check_output().and_then(|()| run(query, &file, &unfinished));
    let done = done.and_then(|rows| {
        fs::rename(&unfinished, &query.output).map_err(FleetError::file(&query.output))?;
        Ok(rows)
    });
    if done.is_err() {
        // The first error says more. The lock is still held: it is no other run's file.
        _ = fs::remove_file(&unfinished);
    }
    done
}

/// Writes the rows to a file.
fn run(query: &Query, file: &File, path: &Path) -> Outcome<u64> {
    let models = match &query.models {
        Some(_) if query.scheduler.is_some() => {
            let message = "--models is an option of executors and scheduler if they run the query";
            return Err(FleetError::Settings(message.to_owned()));
        }
        Some(folder) => Models::in_folder(folder)?,
        None => Models::default(),
    };
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(query.threads.max(1))
        .enable_all()
        .build()
        .map_err(|error| FleetError::Settings(format!("no threads: {error}")))?;
    runtime.block_on(async {
        let context =
            session(query.scheduler.as_deref(), query.threads, query.batch, &models).await?;
        for table in &query.tables {
            table.check().await?;
            table.register(&context, true).await?;
        }
        let options = SQLOptions::new()
            .with_allow_ddl(false)
            .with_allow_dml(false)
            .with_allow_statements(false);
        let frame = context.sql_with_options(&query.sql, options).await?;
        let mut left = if query.scheduler.is_some() { ATTEMPTS } else { 1 };
        loop {
            left -= 1;
            let done = write(rows(frame.clone()).await?, file, path, query.pack).await;
            match done {
                Err(FleetError::Query(error)) if left > 0 && is_lost(&error) => {}
                done => return done,
            }
        }
    })
}

impl Query {
    fn check_output(&self) -> Outcome<()> {
        if self.output.exists() && !self.force {
            let message = format!("{} exists; replace it with --force", self.output.display());
            return Err(FleetError::Settings(message));
        }
        Ok(())
    }
}

/// True if rows did not arrive, though the cluster did not say that the query failed: it lost an
/// executor that had some of them.
pub(super) fn is_lost(error: &DataFusionError) -> bool {
    let message = error.to_string();
    !(message.contains("Job ") && message.contains(" failed: "))
}

/// Context for queries in this process, or on the cluster of a scheduler.
pub(super) async fn session(
    scheduler: Option<&str>,
    threads: usize,
    batch: usize,
    models: &Models,
) -> Outcome<SessionContext> {
    match scheduler {
        None => Ok(context_with(threads, batch, models)),
        Some(scheduler) => on_cluster(scheduler, threads, batch).await,
    }
}

#[cfg(feature = "ballista")]
async fn on_cluster(scheduler: &str, tasks: usize, batch: usize) -> Outcome<SessionContext> {
    crate::cluster::context(scheduler, tasks, batch).await
}

#[cfg(not(feature = "ballista"))]
async fn on_cluster(_: &str, _: usize, _: usize) -> Outcome<SessionContext> {
    let message = "queries on a cluster need a build with the feature `ballista`";
    std::future::ready(Err(FleetError::Settings(message.to_owned()))).await
}

impl Source {
    /// Registers the table, with its order if that is known to be right.
    pub(super) async fn register(&self, context: &SessionContext, sorted: bool) -> Outcome<()> {
        let wrong = FleetError::file(&self.path);
        let is_folder = fs::metadata(&self.path).map_err(&wrong)?.is_dir();
        let path = fs::canonicalize(&self.path).map_err(&wrong)?;
        let Some(path) = path.to_str() else {
            return Err(FleetError::format(&self.path, "its path is not Unicode"));
        };
        let name = TableReference::bare(self.name.as_str());
        let order: Vec<_> = self.key.iter().map(|column| ident(column).sort(true, false)).collect();
        let file_sort_order = if sorted && !order.is_empty() { vec![order] } else { Vec::new() };
        let ending = path.rsplit_once('.').map_or("", |(_, ending)| ending);
        if ending.eq_ignore_ascii_case("csv") {
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

    /// Checks the order of the rows.
    async fn check(&self) -> Outcome<()> {
        if self.key.is_empty() {
            return Ok(());
        }
        let context = context(1, CHECKED);
        self.register(&context, false).await?;
        let table = context.table(TableReference::bare(self.name.as_str())).await?;
        let columns = self.key.iter().map(ident).collect::<Vec<_>>();
        key::check(table.select(columns)?.execute_stream().await?).await
    }
}

/// Runs a plan; if its partitions have an order each, so do all rows.
async fn rows(frame: DataFrame) -> Outcome<SendableRecordBatchStream> {
    let task = Arc::new(frame.task_ctx());
    let mut plan = frame.create_physical_plan().await?;
    if plan.output_partitioning().partition_count() > 1
        && let Some(order) = plan.output_ordering().cloned()
    {
        plan = Arc::new(SortPreservingMergeExec::new(order, plan)) as Arc<dyn ExecutionPlan>;
    }
    Ok(execute_stream(plan, task)?)
}

/// Writes rows to a file, from the beginning.
async fn write(
    mut rows: SendableRecordBatchStream,
    file: &File,
    path: &Path,
    pack: Pack,
) -> Outcome<u64> {
    let (wrong, failed) = (FleetError::file(path), FleetError::parquet(path));
    let mut file = file.try_clone().map_err(&wrong)?;
    file.set_len(0).and_then(|()| file.rewind()).map_err(&wrong)?;
    let schema = rows.schema();
    let mut writer = ArrowWriter::try_new(file, schema.clone(), Some(properties(&schema, pack)))
        .map_err(&failed)?;
    let mut count = 0;
    while let Some(batch) = rows.next().await {
        let batch = batch?;
        count += batch.num_rows() as u64;
        writer.write(&batch).map_err(&failed)?;
    }
    writer.finish().map_err(&failed)?;
    writer.inner().sync_all().map_err(&wrong)?;
    Ok(count)
}

/// Encodings: integers as differences, doubles as they are, texts in dictionaries.
fn properties(schema: &Schema, pack: Pack) -> WriterProperties {
    let mut properties = WriterProperties::builder()
        .set_compression(pack.into())
        .set_dictionary_enabled(false)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_max_row_group_row_count(None)
        .set_max_row_group_bytes(Some(GROUP));
    let Ok(leaves) = parquet::arrow::ArrowSchemaConverter::new().convert(schema) else {
        return properties.build(); // the writer will say why
    };
    for leaf in leaves.columns() {
        use parquet::basic::Type;
        let path = leaf.path().clone();
        properties = match leaf.physical_type() {
            Type::INT32 | Type::INT64 => {
                properties.set_column_encoding(path, Encoding::DELTA_BINARY_PACKED)
            }
            Type::BYTE_ARRAY => properties.set_column_dictionary_enabled(path, true),
            _ => properties,
        };
    }
    for field in schema.fields() {
        if !matches!(field.data_type(), DataType::List(_) | DataType::Struct(_)) {
            let column = parquet::schema::types::ColumnPath::from(field.name().as_str());
            properties = properties.set_column_statistics_enabled(column, EnabledStatistics::Chunk);
        }
    }
    properties.build()
}
