//! A routine over a file of drives, batch by batch.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow::datatypes::DataType;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use serde_json::{Value, json};

use crate::error::{FleetError, Outcome};
use crate::input::{self, ColumnNames, Form};
use crate::model::Model;
use crate::output::{self, Results, Table, Verb};
pub use crate::partial::Start;
use crate::partial::{Opened, Partial};
use crate::pipeline;

/// Batches for each thread that are under way or wait to be written.
const AHEAD: usize = 4;

/// Compression of the pages of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Pack {
    /// As they are: doubles with all their digits hardly get smaller.
    None,
    /// Fast.
    Lz4,
    /// Fast, and read everywhere.
    Snappy,
    /// Small.
    Zstd,
}

impl From<Pack> for Compression {
    fn from(pack: Pack) -> Self {
        match pack {
            Pack::None => Self::UNCOMPRESSED,
            Pack::Lz4 => Self::LZ4_RAW,
            Pack::Snappy => Self::SNAPPY,
            Pack::Zstd => Self::ZSTD(ZstdLevel::default()),
        }
    }
}

/// A routine over a file of drives.
#[derive(Debug, Clone)]
pub struct Job {
    /// File of the model.
    pub model: PathBuf,
    /// File of the drives, Parquet or CSV.
    pub input: PathBuf,
    /// File of the results, Parquet.
    pub output: PathBuf,
    /// Names of the columns of the input.
    pub names: ColumnNames,
    /// Routine.
    pub verb: Verb,
    /// Content of the output.
    pub table: Table,
    /// Form of the output; `None` for that of the input.
    pub form: Option<Form>,
    /// Rows of a part of the output (steps, if it is nested), at least: a row group, which an
    /// interruption loses if it is not complete. It is kept in memory.
    pub part: usize,
    /// Compression of the output.
    pub pack: Pack,
    /// Number of threads.
    pub threads: usize,
    /// Way to begin.
    pub start: Start,
}

/// State of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Rows of the input that are done.
    pub rows: u64,
    /// Rows of the input, if they are known.
    pub all_rows: Option<u64>,
    /// Drives that are done.
    pub drives: u64,
}

/// Outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Summary {
    /// Number of drives.
    pub drives: u64,
    /// Number of steps.
    pub steps: u64,
    /// Number of drives that have an error.
    pub failed: u64,
    /// Number of parts of the output.
    pub parts: usize,
    /// Number of these parts that were made by an earlier run.
    pub resumed: usize,
}

/// Runs a routine over a file, or continues a run that was interrupted.
///
/// Results are in the order of the input. Their file appears under its name when it is complete;
/// until then it has the ending `.partial`, beside a file with the ending `.journal`. An error of
/// the input removes both; after any other error the same call continues.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, or settings or input are not valid.
pub fn run(job: &Job, mut progress: impl FnMut(&Progress)) -> Outcome<Summary> {
    let model = Model::load(&job.model)?;
    let found = input::open(&job.input, &job.names, model.sensor(), 0)?;
    let form = job.form.unwrap_or(found.form);
    let results = Results::new(job.verb, job.table, form)?;
    let schema = Arc::new(results.schema(&found.id_type));
    let settings = settings(job, &model, form)?;
    let properties = properties(job, &model, &found.id_type, form);
    let mut out = match Partial::open(&job.output, &settings, &schema, properties, job.start)? {
        Opened::Finished([drives, steps, failed]) => {
            return Ok(Summary { drives, steps, failed, parts: 0, resumed: 0 });
        }
        Opened::Partial(out) => out,
    };
    let (resumed, all_rows) = (out.parts(), found.rows);
    let mut state = Progress { rows: out.end_row(), all_rows, drives: out.counts()[0] };
    progress(&state);
    let batches = match state.rows {
        0 => found.batches,
        rows => input::open(&job.input, &job.names, model.sensor(), rows)?.batches,
    };
    let work = |drives: input::Drives| {
        let done = output::results(&model, &results, &schema, &drives)?;
        Ok((done, drives.end_row))
    };
    let done = pipeline::in_order(batches, job.threads, AHEAD, work, |done: Outcome<_>| {
        let (batch, end_row) = done?;
        let weight = if form == Form::Nested && job.table != Table::Drives {
            batch.steps as usize
        } else {
            batch.rows.num_rows()
        };
        out.write(&batch.rows, weight, [batch.drives, batch.steps, batch.failed])?;
        if out.weight() >= job.part {
            out.end_part(end_row)?;
        }
        state = Progress { rows: end_row, drives: out.counts()[0], ..state };
        progress(&state);
        Ok(())
    });
    let done = done.and_then(|()| out.end_part(state.rows));
    if let Err(error) = done {
        if error.is_of_input() {
            out.discard()?;
        }
        return Err(error);
    }
    let parts = out.parts();
    let [drives, steps, failed] = out.finish()?;
    Ok(Summary { drives, steps, failed, parts, resumed })
}

/// Settings that two runs must share for one to continue the other.
fn settings(job: &Job, model: &Model, form: Form) -> Outcome<Value> {
    let [size, modified] = stamp(&job.input)?;
    let names = &job.names;
    Ok(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "model": model.hash(),
        "input size": size,
        "input modified": modified,
        "columns": [
            names.trace_id, names.step, names.observation, names.elsewhere, names.latitude,
            names.longitude, names.deviation,
        ],
        "routine": format!("{:?}", job.verb),
        "table": format!("{:?}", job.table),
        "form": format!("{form:?}"),
        "part": job.part,
        "compression": format!("{:?}", job.pack),
    }))
}

/// Size of a file, and nanoseconds since 1970 of its last change.
pub(crate) fn stamp(path: &Path) -> Outcome<[String; 2]> {
    let wrong = FleetError::file(path);
    let metadata = std::fs::metadata(path).map_err(&wrong)?;
    let modified = metadata.modified().map_err(&wrong)?;
    let since = modified.duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    Ok([metadata.len().to_string(), since.as_nanos().to_string()])
}

/// Encodings: integers as differences, doubles as they are.
fn properties(job: &Job, model: &Model, id_type: &DataType, form: Form) -> WriterProperties {
    let about = |key: &str, value: String| KeyValue::new(format!("wayfix.{key}"), value);
    let mut properties = WriterProperties::builder()
        .set_compression(job.pack.into())
        .set_dictionary_enabled(false)
        // Their place is after all parts, so that they would have to be kept until then.
        .set_offset_index_disabled(true)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_max_row_group_row_count(None)
        .set_key_value_metadata(Some(vec![
            about("model", model.hash().to_owned()),
            about("routine", format!("{:?}", job.verb).to_lowercase()),
        ]));
    let path = |list: &[&str], name: &str| {
        let parts = list.iter().copied().chain([name]);
        ColumnPath::new(parts.map(str::to_owned).collect())
    };
    for list in [
        &[][..],
        &["results", "list", "item"],
        &["best", "list", "item"],
        &["path", "list", "item"],
    ] {
        for name in ["step", "steps", "rank", "state", "error_step"] {
            let column = path(list, name);
            properties = properties.set_column_encoding(column, Encoding::DELTA_BINARY_PACKED);
        }
    }
    let id = path(&[], "trace_id");
    properties = if *id_type == DataType::Int64 {
        properties.set_column_encoding(id.clone(), Encoding::DELTA_BINARY_PACKED)
    } else {
        properties.set_column_dictionary_enabled(id.clone(), true)
    };
    properties = properties.set_column_dictionary_enabled(path(&[], "error_kind"), true);
    if form == Form::Long && job.table != Table::Drives {
        // The same in all rows of a drive.
        for name in ["log_likelihood", "log_probability"] {
            let is_of_step = job.verb == Verb::Filter;
            properties = properties.set_column_dictionary_enabled(path(&[], name), !is_of_step);
        }
    }
    properties.set_column_statistics_enabled(id, EnabledStatistics::Chunk).build()
}
