//! A query over files, whose rows go to a Parquet file.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use datafusion::error::DataFusionError;
use datafusion::execution::context::SQLOptions;
use datafusion::prelude::{DataFrame, SessionConfig, SessionContext};

use super::by_range;
use super::models::split;
use super::parts::ByParts;
use super::rows::{rows, write};
use super::starts::Starts;
use super::{Models, Source, register_with};
use crate::error::{FleetError, Outcome};
use crate::folder;
use crate::input::files::find;
use crate::journal::open_locked;
use crate::overwrite::{self, beside};
use crate::properties::Pack;

/// Number of times a query is submitted to a cluster, if executors are lost after its last task.
pub(super) const ATTEMPTS: usize = 3;

/// A query over files.
#[derive(Debug, Clone)]
pub struct Query {
    /// Tables.
    pub tables: Vec<Source>,
    /// Text of the query.
    pub sql: String,
    /// Output file, Parquet.
    pub output: PathBuf,
    /// Compression of the output.
    pub pack: Pack,
    /// Number of threads, or of tasks on a cluster.
    pub threads: usize,
    /// Scheduler of a cluster, `host:port`, to run the query; needs the feature `ballista`.
    pub scheduler: Option<String>,
    /// Folder of the models, if only its files may be named; see [`Models::in_folder`]. Executors
    /// of a cluster have an option of their own.
    pub models: Option<PathBuf>,
    /// Rows in a batch.
    pub batch: usize,
    /// Minimum number of values (steps, also in nested tables) in a part of a sorted table: once in
    /// the output, its rows are not lost by an interruption. 0 for no parts.
    pub part: u64,
    /// Replaces an existing output.
    pub force: bool,
    /// Discards what an unfinished run has done.
    pub restart: bool,
}

/// Progress of a query.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum QueryState {
    /// The query cannot be run by parts, for this reason: an interruption starts it over.
    Whole(String),
    /// Rows so far.
    Rows {
        /// Rows of the table done.
        done: u64,
        /// All rows of the table, if the number of rows done is known.
        all: Option<u64>,
        /// Rows of the output.
        made: u64,
    },
}

/// Outcome of a query.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct QuerySummary {
    /// Number of rows.
    pub rows: u64,
    /// Number of parts, if the query was run by parts.
    pub parts: usize,
    /// Number of these parts made by an earlier run.
    pub resumed: usize,
    /// True if an earlier run finished the output.
    pub finished: bool,
}

impl QuerySummary {
    pub(super) fn finished(rows: u64) -> Self {
        Self { rows, finished: true, ..Self::default() }
    }
}

/// Context with the functions, for queries that process batches in the order of their tables, with
/// `threads` threads.
///
/// Files are not split: a merge that keeps the order would otherwise wait for one half of a file
/// while the other is being read.
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
    // Plain strings in the output, as other tools expect.
    config.options_mut().execution.parquet.schema_force_view_types = false;
    let context = SessionContext::new_with_config(config);
    register_with(&context, models);
    context
}

/// Runs a query, or continues one that was interrupted.
///
/// If the plan makes each row from the rows of one drive of a table with a key, in order, and
/// `part` is above 0, the query is run by parts: over ranges of the table, several at a time. Then
/// rows are in the order of the table, the output ends in `.partial` with a `.journal` beside it
/// until it is complete, and the same call continues after the last complete part. All other
/// queries start over after an interruption, which [`QueryState::Whole`] reports; their rows are in
/// the order of the query, if it has one, or else in that of the table, if every operation keeps
/// it.
///
/// The output gets its name when it is complete. Until then a file ending in `.unfinished` is
/// locked: a second run with the same output is refused.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, another run writes the same output, a table
/// is not sorted as declared, or the query fails; there is then no output.
pub fn query(query: &Query, mut progress: impl FnMut(&QueryState)) -> Outcome<QuerySummary> {
    // Checked before the lock file is created, which could itself land in a folder of the input.
    query.keep_tables()?;
    let unfinished = beside(&query.output, ".unfinished");
    let file = open_locked(&unfinished)?;
    let done = run(query, &file, &unfinished, &mut progress);
    if unfinished.exists() {
        // The first error says more than one from here. The lock is still held, so this is our own
        // file.
        _ = fs::remove_file(&unfinished);
    }
    done
}

/// Writes the rows to the output by way of a temporary file.
fn run(
    query: &Query,
    file: &File,
    path: &Path,
    progress: &mut dyn FnMut(&QueryState),
) -> Outcome<QuerySummary> {
    let models = match &query.models {
        Some(_) if query.scheduler.is_some() => {
            let message =
                "--models is an option of the executors and the scheduler when they run the query";
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
        let scheduler = query.scheduler.as_deref();
        let context = session(scheduler, query.threads, query.batch, &models).await?;
        let frame = query.frame(&context).await?;
        // Models are inputs as well, but only the plan tells which.
        let named = by_range::models(frame.logical_plan())?;
        let named = named.iter().filter_map(|name| models.path(split(name).0).ok());
        let named = named.collect::<Vec<_>>();
        overwrite::refuse([query.output.as_path()], named.iter().map(PathBuf::as_path))?;
        match ByParts::new(query, frame.logical_plan(), &models)? {
            Ok(parts) => return parts.run(&models, progress).await,
            Err(reason) => progress(&QueryState::Whole(reason)),
        }
        query.check_output()?;
        for table in &query.tables {
            table.check(&mut Starts::default()).await?;
        }
        let mut left = if query.scheduler.is_some() { ATTEMPTS } else { 1 };
        let rows = loop {
            left -= 1;
            let rows = rows(frame.clone()).await?;
            let schema = rows.schema();
            let say = |made| progress(&QueryState::Rows { done: 0, all: None, made });
            match write(rows, &schema, file, path, query.pack, say).await {
                Err(FleetError::Query(error)) if left > 0 && is_lost(&error) => {}
                done => break done?,
            }
        };
        let wrong = FleetError::file(&query.output);
        file.sync_all().and_then(|()| fs::rename(path, &query.output)).map_err(wrong)?;
        Ok(QuerySummary { rows, ..QuerySummary::default() })
    })
}

impl Query {
    /// The plan of the query over its tables.
    pub(super) async fn frame(&self, context: &SessionContext) -> Outcome<DataFrame> {
        for table in &self.tables {
            table.register(context, true).await?;
        }
        // Queries read; they must not create tables or write files.
        let options = SQLOptions::new()
            .with_allow_ddl(false)
            .with_allow_dml(false)
            .with_allow_statements(false);
        Ok(context.sql_with_options(&self.sql, options).await?)
    }

    /// Refuses an output that is also a table, or inside one.
    fn keep_tables(&self) -> Outcome<()> {
        for table in &self.tables {
            // A missing table is reported when it is opened.
            let Ok(files) = find(std::slice::from_ref(&table.path)) else { continue };
            folder::outside(&files, &self.output)?;
            overwrite::refuse([self.output.as_path()], files.read_with(&table.path))?;
        }
        Ok(())
    }

    /// Refuses an output that exists, or that another query has begun.
    fn check_output(&self) -> Outcome<()> {
        let refuse = |message| Err(FleetError::Settings(message));
        if self.output.exists() && !self.force {
            return refuse(format!("{} exists; replace it with --force", self.output.display()));
        }
        for ending in [".journal", ".partial"] {
            let path = beside(&self.output, ending);
            if path.exists() && !self.restart {
                let path = path.display();
                return refuse(format!(
                    "{path} is from an unfinished run; start over with --restart"
                ));
            } else if path.exists() {
                fs::remove_file(&path).map_err(FleetError::file(&path))?;
            }
        }
        Ok(())
    }
}

/// True if rows did not arrive although the cluster did not report that the query failed: it lost
/// an executor that held some of them.
pub(super) fn is_lost(error: &DataFusionError) -> bool {
    let message = error.to_string();
    !(message.contains("Job ") && message.contains(" failed: "))
}

/// Context for queries in this process or on the cluster of a scheduler.
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
