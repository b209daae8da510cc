//! A query by parts: over one range of a sorted table after another. Each leaves rows in the
//! output that survive an interruption.
//!
//! Several ranges are in flight at a time, each as a query with one partition whose rows go to an
//! unnamed temporary file, which vanishes with the process. Finished ones become row groups of the
//! output in the order of the table, and are recorded in its journal. On a cluster each range is a
//! task of its own: no executor needs the rows of another.

use std::fs::File;
use std::path::{Path, PathBuf};

use arrow::datatypes::SchemaRef;
use datafusion::logical_expr::LogicalPlan;
use datafusion::prelude::DataFrame;
use futures::{StreamExt, stream};
use serde_json::{Map, Value, json};

use super::files::Files;
use super::models::{Models, split};
use super::query::{ATTEMPTS, Query, QueryState, QuerySummary, is_lost, session};
use super::rows::{properties, rows, write};
use super::source::Source;
use super::{by_range, context};
use crate::error::{FleetError, Outcome};
use crate::finished::Finished;
use crate::input::pieces::Pieces;
use crate::overwrite::beside;
use crate::partial::{Opened, Partial, Plan, Start};
use crate::properties::Pack;

/// A query that can be run by parts.
#[derive(Debug)]
pub(super) struct ByParts<'a> {
    query: &'a Query,
    source: &'a Source,
    /// Models of the query and their hashes.
    models: Map<String, Value>,
}

impl<'a> ByParts<'a> {
    /// Creates it from a query and its plan; or returns what prevents running by parts, in words.
    pub(super) fn new(
        query: &'a Query,
        plan: &LogicalPlan,
        models: &Models,
    ) -> Outcome<Result<Self, String>> {
        if query.part == 0 {
            return Ok(Err("--part is 0".to_owned()));
        }
        let mut sorted = query.tables.iter().filter(|table| !table.key.is_empty());
        let Some(source) = sorted.next() else {
            return Ok(Err("no table has an --order".to_owned()));
        };
        let other = "more than one table has an --order".to_owned();
        let obstacle = sorted.next().map(|_| other).or_else(|| match source.key.first() {
            Some(key) => by_range::obstacle(plan, &source.name, key),
            None => None,
        });
        if let Some(obstacle) = obstacle {
            return Ok(Err(obstacle));
        }
        if source.is_csv() {
            return Ok(Err("a CSV file can only be read as a whole".to_owned()));
        }
        let mut hashes = Map::new();
        for name in by_range::models(plan)? {
            let hash = match split(&name) {
                (_, Some(hash)) => hash.to_ascii_lowercase(),
                _ => match models.model(&name) {
                    Ok(loaded) => loaded.model.hash().to_owned(),
                    // The model may exist on the executors only. If it is not a model, the query
                    // will report that better.
                    Err(_) => return Ok(Err(format!("the model {name} is given without a hash"))),
                },
            };
            hashes.insert(name, hash.into());
        }
        Ok(Ok(Self { query, source, models: hashes }))
    }

    /// Runs the query, or continues it.
    pub(super) async fn run(
        &self,
        models: &Models,
        progress: &mut dyn FnMut(&QueryState),
    ) -> Outcome<QuerySummary> {
        let (query, output) = (self.query, &self.query.output);
        let local = context(1, query.batch);
        self.source.register(&local, false).await?;
        let files = Files::of(self.source, &local).await?;
        // Before hashing: a later change shows in the stamps, an earlier one in the hash.
        let stamps = files.stamps()?;
        let settings = self.settings(&files.hash()?);
        if output.is_file() && !query.force && !beside(output, ".journal").exists() {
            let made = Finished::read(output)?.filter(|made| made.settings == settings);
            if let Some(made) = made {
                return Ok(QuerySummary::finished(made.counts[0]));
            }
        }
        // The check reads the key columns of the whole table, and finds the ranges on the way.
        let mut starts = files.starts(query.part);
        self.source.check(&mut starts).await?;
        let ranges = starts.ranges();
        // With one partition, a plan over a range contains no exchange of rows between tasks.
        let context = session(query.scheduler.as_deref(), 1, query.batch, models).await?;
        let (state, plan) = query.frame(&context).await?.into_parts();
        // The schema of the whole query: that of a range could differ in nullability.
        let whole = DataFrame::new(state.clone(), plan.clone());
        let schema = whole.create_physical_plan().await?.schema();
        let opened = Partial::open(Plan {
            output,
            left_out: None,
            settings: &settings,
            schema: &schema,
            properties: properties(&schema, query.pack),
            start: Start { force: query.force, restart: query.restart },
            pieces: Pieces::default(),
        })?;
        let mut out = match opened {
            Opened::Finished(counts) => return Ok(QuerySummary::finished(counts[0])),
            Opened::Partial(out) => out,
        };
        let (resumed, all_rows) = (out.parts(), ranges.last().map(|range| range.rows.end));
        let mut state_of = |out: &Partial| {
            let state =
                QueryState::Rows { done: out.position().1, all: all_rows, made: out.counts()[0] };
            progress(&state);
        };
        state_of(&out);
        // One part of the output per range, in order. The ranges are those of the earlier run, as
        // table, `part` and version are in the settings.
        let todo = ranges.get(resumed..).unwrap_or_default();
        let making = todo.iter().map(|range| {
            let part = range.of(plan.clone(), self.source, &files).map(|plan| Part {
                frame: DataFrame::new(state.clone(), plan),
                schema: schema.clone(),
                output: output.clone(),
                pack: query.pack,
                attempts: if query.scheduler.is_some() { ATTEMPTS } else { 1 },
            });
            let end_row = range.rows.end;
            async move {
                // Spawned, or polling would run all parts on one thread.
                let made = tokio::spawn(part?.make()).await;
                let (file, rows) =
                    made.map_err(|error| FleetError::Settings(format!("a part: {error}")))??;
                Ok((file, rows, end_row))
            }
        });
        let mut made = stream::iter(making).buffered(query.threads.max(1));
        while let Some(part) = made.next().await {
            let added = part.and_then(|(file, rows, end_row)| {
                // Checked after the rows were made, so a part never mixes two versions of a file.
                files.unchanged(&stamps)?;
                out.add_part(&file, rows, end_row)
            });
            if let Err(error) = added {
                if out.parts() == 0 {
                    out.discard()?;
                }
                return Err(error);
            }
            state_of(&out);
        }
        let parts = out.parts();
        let [rows, ..] = out.finish(0)?;
        Ok(QuerySummary { rows, parts, resumed, finished: false })
    }

    /// Settings that two runs must share for one to continue the other.
    fn settings(&self, content: &str) -> Value {
        let query = self.query;
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "query": query.sql,
            "table": self.source.name,
            "order": self.source.key,
            "content of the table": content,
            "models": self.models,
            "part": query.part,
            "batch": query.batch,
            "compression": format!("{:?}", query.pack),
        })
    }
}

/// The query over one range.
struct Part {
    frame: DataFrame,
    schema: SchemaRef,
    output: PathBuf,
    pack: Pack,
    attempts: usize,
}

impl Part {
    /// Returns a Parquet file with the rows, and their number.
    async fn make(self) -> Outcome<(File, u64)> {
        let folder = self.output.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        let file = tempfile::tempfile_in(folder).map_err(FleetError::file(folder))?;
        let mut left = self.attempts;
        loop {
            left -= 1;
            // `write` truncates the file first, so a second attempt starts afresh.
            let rows = rows(self.frame.clone()).await?;
            match write(rows, &self.schema, &file, &self.output, self.pack, |_| {}).await {
                Err(FleetError::Query(error)) if left > 0 && is_lost(&error) => {}
                done => return Ok((file, done?)),
            }
        }
    }
}
