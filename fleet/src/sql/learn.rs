//! Learning by queries, in this process or on a cluster: the E-step is an aggregate, the M-step
//! happens here.

use std::fs;
use std::path::Path;

use arrow::array::{AsArray, BinaryArray};
use datafusion::prelude::{DataFrame, SessionContext};
use futures::{StreamExt, stream};
use serde::Serialize;
use serde::de::DeserializeOwned;
use wayfix::Hmm;
use wayfix::transition::{LearnTransition, MoveCounts};

use super::expect::{NAME, Sent};
use super::files::Files;
use super::models::Models;
use super::query::{ATTEMPTS, context, is_lost, session};
use super::ranges::Range;
use super::source::Source;
use crate::error::{FleetError, Outcome};
use crate::expected::Expected;
use crate::input::{Form, Layout};
use crate::learn::{Course, LearnJob, inputs, iterate, save};
use crate::model::{Model, with_hmm};
use crate::overwrite::beside;
use crate::sensor::{Kind, Sensor};

/// Drives in a batch.
const BATCH: usize = 1024;
/// Parts of a long table per thread; several, as some take longer than others.
const PARTS: usize = 4;
/// Name of the table.
const TABLE: &str = "drives";

/// Learns like [`learn`](crate::learn), with the expectations of each iteration from a query with
/// the aggregate `wayfix_expect`: in this process, or on the executors of a scheduler at
/// `host:port` (in a build with the feature `ballista`).
///
/// A long Parquet table, which must be sorted by drive and step, is processed in parts of whole
/// drives, as many at a time as the job has threads; their sums are added in the order of the
/// table. Anything else is one query with that many tasks, whose sums are added as they arrive, so
/// results differ in the last digits, by a relative 1e-12 or less. Before each iteration its model
/// is written beside the output, where executors must also find it. `progress` is called before
/// each query with the number of re-estimations. An interrupted run continues after its last
/// re-estimation.
///
/// # Errors
///
/// [`FleetError`] as for [`learn`](crate::learn), or if a query fails.
pub fn learn(
    job: &LearnJob,
    scheduler: Option<&str>,
    progress: impl FnMut(usize),
) -> Outcome<Course> {
    inputs(job)?;
    let model = Model::load(&job.model)?;
    let path = beside(&job.output, ".iteration");
    let course = with_hmm!(model, hmm => run(hmm, &model, job, &path, scheduler, progress));
    if path.exists() {
        fs::remove_file(&path).map_err(FleetError::file(&path))?;
    }
    course
}

fn run<A>(
    hmm: &Hmm<A, Sensor>,
    model: &Model,
    job: &LearnJob,
    path: &Path,
    scheduler: Option<&str>,
    mut progress: impl FnMut(usize),
) -> Outcome<Course>
where
    A: LearnTransition<Control = (), Statistics = MoveCounts>
        + Clone
        + Sync
        + Serialize
        + DeserializeOwned,
{
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(job.threads.max(1))
        .enable_all()
        .build()
        .map_err(|error| FleetError::Settings(format!("no threads: {error}")))?;
    let input = runtime.block_on(Input::open(job, scheduler, hmm.likelihood()))?;
    iterate(hmm, model, job, |hmm, iteration| {
        progress(iteration);
        save(path, hmm)?;
        let loaded = Model::load(path)?;
        let place = fs::canonicalize(path).map_err(FleetError::file(path))?;
        let Some(place) = place.to_str() else {
            return Err(FleetError::format(path, "the path is not Unicode"));
        };
        // With the hash, an executor with another file under this path fails instead of using it.
        // Quotes are doubled for SQL.
        let name = format!("{place}#{}", loaded.hash()).replace('\'', "''");
        let mut sum = Expected::nothing(hmm);
        runtime.block_on(input.sums(&name, |sent| {
            sum.merge(hmm, &Expected::from_sums(hmm, sent.sums)?);
            Ok(())
        }))?;
        Ok(sum)
    })
}

/// The drives, read once per iteration.
struct Input {
    context: SessionContext,
    /// Columns of the observations, and the table expression.
    columns: String,
    table: String,
    /// Parts that are queries of their own, for a long table: no drive then has to be assembled
    /// from several tasks.
    parts: Option<(Source, Files, Vec<Range>)>,
    /// Parts at a time.
    threads: usize,
    attempts: usize,
}

impl Input {
    async fn open(job: &LearnJob, scheduler: Option<&str>, sensor: &Sensor) -> Outcome<Self> {
        let models = Models::default();
        let mut source = Source { name: TABLE.to_owned(), path: job.input.clone(), key: vec![] };
        let local = context(1, BATCH);
        source.register(&local, false).await?;
        let table = local.table(TABLE).await?;
        let layout = Layout::new(table.schema().as_arrow(), &job.names, sensor)?;
        let (columns, table) = drives(&layout, sensor);
        let mut parts = None;
        if layout.form == Form::Long && !source.is_csv() {
            source.key = vec![layout.names.trace_id.clone(), layout.names.step.clone()];
            let files = Files::of(&source, &local).await?;
            let mut starts = files.starts(files.values() / (PARTS * job.threads.max(1)) as u64);
            source.check(&mut starts).await?;
            parts = Some((source.clone(), files, starts.ranges()));
        }
        let tasks = if parts.is_some() { 1 } else { job.threads };
        let context = session(scheduler, tasks, BATCH, &models).await?;
        source.register(&context, true).await?;
        let attempts = if scheduler.is_some() { ATTEMPTS } else { 1 };
        Ok(Self { context, columns, table, parts, threads: job.threads.max(1), attempts })
    }

    /// Passes the sums of all parts under a model to `take`, in the order of the table.
    async fn sums(&self, model: &str, mut take: impl FnMut(Sent) -> Outcome<()>) -> Outcome<()> {
        let query = format!("SELECT {NAME}('{model}', {}) FROM {}", self.columns, self.table);
        let (state, plan) = self.context.sql(&query).await?.into_parts();
        let plans = match &self.parts {
            None => vec![Ok(plan)],
            Some((source, files, ranges)) => {
                ranges.iter().map(|range| range.of(plan.clone(), source, files)).collect()
            }
        };
        let running = plans.into_iter().map(|plan| {
            let frame = plan.map(|plan| DataFrame::new(state.clone(), plan));
            let attempts = self.attempts;
            async move {
                // Spawned to run in parallel; `buffered` yields them in order.
                let done = tokio::spawn(sums(frame?, attempts)).await;
                done.map_err(|error| FleetError::Learning(error.to_string()))?
            }
        });
        let mut done = stream::iter(running).buffered(self.threads);
        while let Some(sent) = done.next().await {
            sent?.map_or(Ok(()), &mut take)?;
        }
        Ok(())
    }
}

/// Columns of a query for the sums, and their table. Steps of a long table are gathered into lists
/// first.
fn drives(layout: &Layout, sensor: &Sensor) -> (String, String) {
    let names = &layout.names;
    let mut columns = match sensor.kind() {
        Kind::Places(_) => vec![&names.latitude, &names.longitude, &names.deviation],
        Kind::Sparse(_) => vec![&names.observation, &names.elsewhere],
        _ => vec![&names.observation],
    };
    columns.retain(|name| !name.is_empty());
    let quoted = |name: &str| format!("\"{}\"", name.replace('"', "\"\""));
    let list = columns.iter().map(|name| quoted(name)).collect::<Vec<_>>().join(", ");
    let table = match layout.form {
        Form::Nested => TABLE.to_owned(),
        Form::Long => {
            let (id, step) = (quoted(&names.trace_id), quoted(&names.step));
            let gathered = columns
                .iter()
                .map(|name| format!("array_agg({0} ORDER BY {step}) AS {0}", quoted(name)))
                .collect::<Vec<_>>()
                .join(", ");
            format!("(SELECT {gathered} FROM {TABLE} GROUP BY {id}) AS drives")
        }
    };
    (list, table)
}

/// Runs a query for sums, which returns one row; again, if an executor is lost on the way.
async fn sums(frame: DataFrame, attempts: usize) -> Outcome<Option<Sent>> {
    let mut left = attempts;
    let batches = loop {
        left -= 1;
        match frame.clone().collect().await {
            Err(error) if left > 0 && is_lost(&error) => {}
            done => break done?,
        }
    };
    for batch in batches {
        let sums: &BinaryArray = batch.column(0).as_binary();
        if let Some(text) = sums.iter().flatten().next() {
            let sent = serde_json::from_slice(text);
            return Ok(Some(sent.map_err(|error| FleetError::Learning(error.to_string()))?));
        }
    }
    Ok(None)
}
