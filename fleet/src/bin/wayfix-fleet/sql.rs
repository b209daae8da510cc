//! The command `sql`.

use std::io::{self, Write};
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::ProgressBar;
use wayfix_fleet::sql::{Query, QueryState, QuerySummary, Source, query};
use wayfix_fleet::{FleetError, Pack};

use crate::bar::{bar, show_rows};

/// Default number of tasks of a query on a cluster: a compromise between tasks that run long and
/// many that take time to hand out.
const TASKS: usize = 16;

const SECOND: Duration = Duration::from_secs(1);

/// Options of a query over tables.
#[derive(Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "flags of a command")]
pub(crate) struct Sql {
    /// Table and its file, Parquet or CSV; may be repeated.
    #[arg(long = "table", value_name = "NAME=PATH", required = true)]
    tables: Vec<String>,
    /// Columns by which the rows of the table are sorted and which identify them, such as
    /// `trace_id,step`. With several tables, put the name of one first: `drives=trace_id,step`.
    #[arg(long = "order", value_name = "[NAME=]COLUMN,…")]
    orders: Vec<String>,
    /// Query.
    #[arg(long)]
    query: String,
    /// Output, Parquet.
    #[arg(long)]
    output: PathBuf,
    /// Compression of the output.
    #[arg(long, default_value = "none")]
    compression: Pack,
    /// Threads; by default one per core. On a cluster the number of tasks, by default 16.
    #[arg(long)]
    threads: Option<usize>,
    /// Scheduler of a cluster to run the query (in a build with the feature `ballista`). Its
    /// executors must find tables and models under the same paths.
    #[arg(long, value_name = "HOST:PORT")]
    scheduler: Option<String>,
    /// Folder of the models: names in the query are relative to it, and no file outside can be
    /// named. Without it, a query can open any file. On a cluster, this is an option of its
    /// processes instead.
    #[arg(long, value_name = "FOLDER")]
    models: Option<PathBuf>,
    /// Rows in a batch: drives, if the table has one row per drive.
    #[arg(long, default_value_t = 1024)]
    batch: usize,
    /// Minimum values (steps) in a part of a table with `--order`. An interruption loses only
    /// incomplete parts; 0 runs the query as a whole, which starts over after an interruption.
    #[arg(long, default_value_t = 1 << 20)]
    part: u64,
    /// Replaces an existing output.
    #[arg(long)]
    force: bool,
    /// Starts over if an earlier run was interrupted.
    #[arg(long)]
    restart: bool,
    /// Reports progress in lines on standard error, even if that is not a terminal.
    #[arg(long)]
    lines: bool,
    /// Shows no progress.
    #[arg(long, conflicts_with = "lines")]
    quiet: bool,
}

impl Sql {
    pub(crate) fn run(&self) -> Result<String, FleetError> {
        let query_of = self.query()?;
        let bar = bar(self.quiet || self.lines);
        let mut last = Instant::now();
        let done = query(&query_of, |state| match state {
            _ if self.quiet => {}
            _ if self.lines => show_line(state, &mut last),
            state => show(&bar, state),
        });
        bar.finish_and_clear();
        let QuerySummary { rows, parts, resumed, finished } = done?;
        let mut text = format!("{rows} rows");
        if finished {
            text += "; finished already";
        } else if resumed > 0 {
            text += &format!("; {resumed} of {parts} parts were there already");
        }
        Ok(text)
    }

    fn query(&self) -> Result<Query, FleetError> {
        let wrong = |message: String| Err(FleetError::Settings(message));
        let mut tables: Vec<Source> = Vec::with_capacity(self.tables.len());
        for table in &self.tables {
            let Some((name, path)) = table.split_once('=') else {
                return wrong(format!("--table {table}: expected NAME=PATH"));
            };
            if tables.iter().any(|known| known.name == name) {
                return wrong(format!("--table {name} is given twice"));
            }
            tables.push(Source { name: name.to_owned(), path: path.into(), key: Vec::new() });
        }
        for order in &self.orders {
            let (name, columns) = match order.split_once('=') {
                Some((name, columns)) => (Some(name), columns),
                None => (None, order.as_str()),
            };
            let only = tables.len() == 1;
            let table = tables.iter_mut().find(|table| match name {
                Some(name) => table.name == name,
                None => only,
            });
            let Some(table) = table else {
                return wrong(format!("--order {order}: expected the name of a table in front"));
            };
            table.key = columns.split(',').map(|column| column.trim().to_owned()).collect();
        }
        Ok(Query {
            tables,
            sql: self.query.clone(),
            output: self.output.clone(),
            pack: self.compression,
            threads: self.threads.unwrap_or_else(|| match self.scheduler {
                Some(_) => TASKS,
                None => thread::available_parallelism().map_or(1, Into::into),
            }),
            scheduler: self.scheduler.clone(),
            models: self.models.clone(),
            batch: self.batch,
            part: self.part,
            force: self.force,
            restart: self.restart,
        })
    }
}

fn show(bar: &ProgressBar, state: &QueryState) {
    match state {
        QueryState::Whole(reason) => bar.suspend(|| say(&whole(reason))),
        QueryState::Rows { done, all, made } => {
            show_rows(bar, *done, *all, format!("{made} rows made"));
        }
        // States added in later versions.
        _ => {}
    }
}

/// Reports progress: a line per part, or per second without parts.
fn show_line(state: &QueryState, last: &mut Instant) {
    match state {
        QueryState::Whole(reason) => say(&whole(reason)),
        QueryState::Rows { done, all: Some(all), made } => {
            say(&format!("{done} of {all} rows, {made} rows made"));
        }
        QueryState::Rows { made, .. } if last.elapsed() >= SECOND => {
            say(&format!("{made} rows made"));
            *last = Instant::now();
        }
        _ => {}
    }
}

fn whole(reason: &str) -> String {
    format!("this query starts over if interrupted: {reason}")
}

fn say(line: &str) {
    // Standard error may be closed.
    _ = writeln!(io::stderr(), "{line}");
}
