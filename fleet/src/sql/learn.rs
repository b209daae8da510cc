//! Learning by queries, in this process or on a cluster.

use std::fs;
use std::path::Path;

use arrow::array::{AsArray, BinaryArray};
use datafusion::prelude::SessionContext;
use serde::Serialize;
use serde::de::DeserializeOwned;
use wayfix::Hmm;
use wayfix::transition::{LearnTransition, MoveCounts};

use super::expect::{NAME, Sent};
use super::models::Models;
use super::query::{ATTEMPTS, is_lost, session};
use super::source::Source;
use crate::error::{FleetError, Outcome};
use crate::expected::Expected;
use crate::input::{Form, Layout};
use crate::learn::{Course, LearnJob, iterate, save};
use crate::model::{Model, with_hmm};
use crate::partial::beside;
use crate::sensor::{Kind, Sensor};

/// Drives of a batch.
const BATCH: usize = 1024;
/// Name of the table.
const TABLE: &str = "drives";

/// Learns as [`learn`](crate::learn), with the expectations of each iteration from a query with
/// the aggregate `wayfix_expect`: in this process, or by the executors of a scheduler at
/// `host:port` (in a build with the feature `ballista`).
///
/// The query is cut into as many tasks as the job has threads. Before each iteration its model is
/// written beside the output, where executors must find it, too. Sums of tasks are added up in the
/// order in which they come, so that results differ in the last digits, by 1e-12 of a number or
/// less. `progress` is called with the number of re-estimations before each query. An interrupted
/// run goes on after its last re-estimation.
///
/// # Errors
///
/// [`FleetError`] as [`learn`](crate::learn), or if a query fails.
pub fn learn(
    job: &LearnJob,
    scheduler: Option<&str>,
    progress: impl FnMut(usize),
) -> Outcome<Course> {
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
    let (context, (columns, table)) = runtime.block_on(async {
        let context = session(scheduler, job.threads, BATCH, &Models::default()).await?;
        let source = Source { name: TABLE.to_owned(), path: job.input.clone(), key: Vec::new() };
        source.register(&context, false).await?;
        let table = drives(&context, job, hmm.likelihood()).await?;
        Ok::<_, FleetError>((context, table))
    })?;
    iterate(hmm, model, job, |hmm, iteration| {
        progress(iteration);
        save(path, hmm)?;
        let loaded = Model::load(path)?;
        let place = fs::canonicalize(path).map_err(FleetError::file(path))?;
        let Some(place) = place.to_str() else {
            return Err(FleetError::format(path, "its path is not Unicode"));
        };
        let name = format!("{place}#{}", loaded.hash()).replace('\'', "''");
        let query = format!("SELECT {NAME}('{name}', {columns}) FROM {table}");
        let mut left = if scheduler.is_some() { ATTEMPTS } else { 1 };
        loop {
            left -= 1;
            return match runtime.block_on(sums(&context, &query)) {
                Ok(Some(sent)) => Expected::from_sums(hmm, sent.sums),
                Ok(None) => Ok(Expected::nothing(hmm)),
                Err(FleetError::Query(error)) if left > 0 && is_lost(&error) => continue,
                Err(error) => Err(error),
            };
        }
    })
}

/// Columns of a query for the sums, and their table. Steps of a long table are gathered first.
async fn drives(
    context: &SessionContext,
    job: &LearnJob,
    sensor: &Sensor,
) -> Outcome<(String, String)> {
    let table = context.table(TABLE).await?;
    let layout = Layout::new(table.schema().as_arrow(), &job.names, sensor)?;
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
    Ok((list, table))
}

/// Runs a query for sums, of which one row comes.
async fn sums(context: &SessionContext, query: &str) -> Outcome<Option<Sent>> {
    for batch in context.sql(query).await?.collect().await? {
        let sums: &BinaryArray = batch.column(0).as_binary();
        if let Some(text) = sums.iter().flatten().next() {
            let sent = serde_json::from_slice(text);
            return Ok(Some(sent.map_err(|error| FleetError::Learning(error.to_string()))?));
        }
    }
    Ok(None)
}
