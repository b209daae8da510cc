//! A query over files, with its rows in a Parquet file.

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

/// Times that a query is given to a cluster, if executors are lost after its last task.
pub(super) const ATTEMPTS: usize = 3;

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
    /// Values of a part of a sorted table, at least (steps, also if it is nested): its rows are not
    /// lost by an interruption once they are in the output. 0 for no parts.
    pub part: u64,
    /// Replaces an output that exists.
    pub force: bool,
    /// Forgets what an unfinished run has done.
    pub restart: bool,
}

/// State of a query.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum QueryState {
    /// The query cannot be run by parts, for this reason: an interruption starts it over.
    Whole(String),
    /// Rows so far.
    Rows {
        /// Rows of the table that are done.
        done: u64,
        /// Rows of the table, if a part of them is known to be done.
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
    /// Number of these parts that were made by an earlier run.
    pub resumed: usize,
    /// True if an earlier run has finished the output.
    pub finished: bool,
}

impl QuerySummary {
    pub(super) fn finished(rows: u64) -> Self {
        Self { rows, finished: true, ..Self::default() }
    }
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

/// Runs a query, or goes on with one that was interrupted.
///
/// If the plan makes each row from the rows of one drive of a table with a key, in their order, and
/// `part` is above 0, the query is run by parts: over ranges of the table, of which several are
/// under way at a time. Then rows are in the order of the table, the output has the endings
/// `.partial` and `.journal` until it is complete, and the same call goes on after the last part
/// that is complete. All other queries start over after an interruption, which
/// [`QueryState::Whole`] says; they have an order if the query has one, or the table and all that
/// is done to it.
///
/// The output appears under its name when it is complete. Until then a file with the ending
/// `.unfinished` is locked: a second run with the same output is refused.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, another run writes the same output, a table
/// is not sorted as it should be, or the query fails; without an output then.
pub fn query(query: &Query, mut progress: impl FnMut(&QueryState)) -> Outcome<QuerySummary> {
    query.keep_tables()?;
    let unfinished = beside(&query.output, ".unfinished");
    let file = open_locked(&unfinished)?;
    let done = run(query, &file, &unfinished, &mut progress);
    if unfinished.exists() {
        // The first error says more. The lock is still held: it is no other run's file.
        _ = fs::remove_file(&unfinished);
    }
    done
}

/// Writes the rows to the output, by way of a file.
fn run(
    query: &Query,
    file: &File,
    path: &Path,
    progress: &mut dyn FnMut(&QueryState),
) -> Outcome<QuerySummary> {
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
        let scheduler = query.scheduler.as_deref();
        let context = session(scheduler, query.threads, query.batch, &models).await?;
        let frame = query.frame(&context).await?;
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
    /// The query over its tables.
    pub(super) async fn frame(&self, context: &SessionContext) -> Outcome<DataFrame> {
        for table in &self.tables {
            table.register(context, true).await?;
        }
        let options = SQLOptions::new()
            .with_allow_ddl(false)
            .with_allow_dml(false)
            .with_allow_statements(false);
        Ok(context.sql_with_options(&self.sql, options).await?)
    }

    /// Refuses an output that is also a table, or would be part of one.
    fn keep_tables(&self) -> Outcome<()> {
        for table in &self.tables {
            // That there is none is said when it is opened.
            let Ok(files) = find(std::slice::from_ref(&table.path)) else { continue };
            folder::outside(&files, &self.output)?;
            overwrite::refuse([self.output.as_path()], files.read_with(&table.path))?;
        }
        Ok(())
    }

    /// Refuses an output that exists, or that another query has parts of.
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
                    "{path} is of an unfinished run; start over with --restart"
                ));
            } else if path.exists() {
                fs::remove_file(&path).map_err(FleetError::file(&path))?;
            }
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
