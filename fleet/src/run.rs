//! A routine over files of drives, batch by batch.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow::datatypes::{DataType, Schema};
use serde_json::{Value, json};

use crate::error::{FleetError, Outcome};
use crate::finished::Finished;
use crate::folder;
use crate::input::files::{InputFiles, find};
use crate::input::invalid::halves;
use crate::input::source::Source;
use crate::input::{ColumnNames, Drives, Form, Invalid};
use crate::model::Model;
use crate::names::{hashes, named, with_file};
use crate::output::{self, Batch, Results, Table, Verb};
pub use crate::partial::Start;
use crate::partial::{Opened, Partial, Plan};
use crate::pipeline;
pub use crate::properties::Pack;
use crate::properties::properties;

/// Batches for each thread that are under way or wait to be written.
const AHEAD: usize = 4;

/// A routine over files of drives.
#[derive(Debug, Clone)]
pub struct Job {
    /// File of the model.
    pub model: PathBuf,
    /// Files of the drives, Parquet or CSV; folders of such files, or patterns.
    pub inputs: Vec<PathBuf>,
    /// File of the results, Parquet; or a folder, which exists or whose name ends with a slash,
    /// for a file for each one of the input.
    pub output: PathBuf,
    /// File (or folder, like the output) for drives that are no valid input; without it these end
    /// the run.
    pub left_out: Option<PathBuf>,
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
    /// Number of drives that were no valid input, and are left out.
    pub left_out: u64,
    /// Number of parts of the output.
    pub parts: usize,
    /// Number of these parts that were made by an earlier run.
    pub resumed: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// Number of these outputs that an earlier run has finished.
    pub finished: usize,
}

impl Summary {
    pub(crate) fn finished([drives, steps, failed, left_out]: [u64; 4]) -> Self {
        Self { drives, steps, failed, left_out, outputs: 1, finished: 1, ..Self::default() }
    }
}

/// Runs a routine over files, or continues a run that was interrupted.
///
/// Results are in the order of the input. Their file appears under its name when it is complete;
/// until then it has the ending `.partial`, beside a file with the ending `.journal`. After an
/// error the same call continues. If an output with these settings and this input exists already,
/// nothing is done.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, or settings or input are not valid.
pub fn run(job: &Job, mut progress: impl FnMut(&Progress)) -> Outcome<Summary> {
    let model = Model::load(&job.model)?;
    let files = find(&job.inputs)?;
    let results = job.left_out.iter().chain([&job.output]);
    results.into_iter().try_for_each(|path| folder::outside(&files, path))?;
    if let Some(left_out) = &job.left_out
        && (*left_out == job.output
            || (folder::is_folder(left_out) && !folder::is_folder(&job.output)))
    {
        let message = "the file of --skip-invalid must be another than the output, and a folder \
                       only if that is one";
        return Err(FleetError::Settings(message.to_owned()));
    }
    if folder::is_folder(&job.output) {
        return folder::run(job, &model, &files, &mut progress);
    }
    let has_names = !files.is_one;
    let out = Target { output: &job.output, left_out: job.left_out.as_deref(), has_names };
    run_into(job, &model, &files, out, &mut progress)
}

/// Files of the results of some files.
#[derive(Clone, Copy)]
pub(crate) struct Target<'a> {
    pub(crate) output: &'a Path,
    pub(crate) left_out: Option<&'a Path>,
    /// True if rows have the name of the file that they come from.
    pub(crate) has_names: bool,
}

pub(crate) fn run_into(
    job: &Job,
    model: &Model,
    files: &InputFiles,
    target: Target<'_>,
    progress: &mut dyn FnMut(&Progress),
) -> Outcome<Summary> {
    let leave_out = target.left_out.is_some();
    let source = Source::new(files, &job.names, model.sensor(), leave_out)?;
    let form = job.form.unwrap_or(source.form);
    let results = Results::new(job.verb, job.table, form)?;
    let schema = Arc::new(results.schema(&source.id_type));
    let settings = settings(job, model, form, &source.id_type, target.has_names);
    let names = if target.has_names { hashes(files) } else { vec![0; files.files.len()] };
    let all_names = names.last().copied().unwrap_or(0);
    if let Some(counts) = finished(job, target.output, &settings, &source, all_names)? {
        return Ok(Summary::finished(counts));
    }
    let schema_of_files = with_file(&schema);
    let plan = Plan {
        output: target.output,
        left_out: target.left_out,
        settings: &settings,
        schema: if target.has_names { &schema_of_files } else { &schema },
        properties: properties(job, model, &source.id_type, form),
        start: job.start,
        pieces: source.pieces.clone(),
    };
    let mut out = match Partial::open(plan)? {
        Opened::Finished(counts) => return Ok(Summary::finished(counts)),
        Opened::Partial(out) => out,
    };
    let resumed = out.parts();
    check(&out, &source, &names, target)?;
    let (file, row) = out.position();
    let mut place = (file, row);
    let mut state = Progress {
        rows: source.rows_until(file, row),
        all_rows: source.rows,
        drives: out.counts()[0],
    };
    progress(&state);
    let work = |(file, drives): (usize, Drives)| {
        let made = make(model, &results, &schema, &drives, leave_out);
        let (mut batches, invalid) = made.map_err(|error| source.name(file, error))?;
        let name = source.path(file).to_string_lossy();
        if target.has_names {
            for batch in &mut batches {
                batch.rows = named(&batch.rows, &schema_of_files, &name)?;
            }
        }
        Ok(Made { place: (file, drives.end_row), batches, invalid, name })
    };
    let drives = source.drives(file, row);
    let done = pipeline::in_order(drives, job.threads, AHEAD, work, |made: Outcome<Made<'_>>| {
        let Made { place: at, batches, invalid, name } = made?;
        for batch in &batches {
            let weight = if form == Form::Nested && job.table != Table::Drives {
                batch.steps as usize
            } else {
                batch.rows.num_rows()
            };
            out.write(&batch.rows, weight, [batch.drives, batch.steps, batch.failed, 0])?;
        }
        out.leave_out(&name, &invalid)?;
        place = at;
        if out.weight() >= job.part {
            out.end_part(at.0, at.1, names[at.0])?;
        }
        state.rows = source.rows_until(at.0, at.1);
        state.drives = out.counts()[0];
        progress(&state);
        Ok(())
    });
    let done = done.and_then(|()| out.end_part(place.0, place.1, names[place.0]));
    if let Err(error) = done {
        if out.parts() == 0 {
            out.discard()?;
        }
        return Err(error);
    }
    let parts = out.parts();
    let [drives, steps, failed, left_out] = out.finish(all_names)?;
    Ok(Summary { drives, steps, failed, left_out, parts, resumed, outputs: 1, finished: 0 })
}

/// Results of a batch of drives.
struct Made<'a> {
    place: (usize, u64),
    batches: Vec<Batch>,
    invalid: Vec<Invalid>,
    name: std::borrow::Cow<'a, str>,
}

/// Results of drives; those that turn out not to be valid are an error, or are left out.
fn make(
    model: &Model,
    results: &Results,
    schema: &Arc<Schema>,
    drives: &Drives,
    leave_out: bool,
) -> Outcome<(Vec<Batch>, Vec<Invalid>)> {
    if drives.is_empty() {
        return Ok((Vec::new(), drives.invalid.clone()));
    }
    let (mut batches, mut invalid) = (Vec::new(), drives.invalid.clone());
    let make = |drives: &Drives| output::results(model, results, schema, drives);
    match make(drives) {
        Err(FleetError::Value { .. }) if leave_out => halves(
            0..drives.len(),
            &mut |range| make(&drives.part(range)),
            &mut |_, batch| batches.push(batch),
            &mut |drive, error| {
                invalid.push(drives.invalid(drive, error)?);
                Ok(())
            },
        )?,
        done => batches.push(done?),
    }
    invalid.sort_by_key(|invalid| invalid.row);
    Ok((batches, invalid))
}

/// Checks that the input is the one that finished parts were made of.
fn check(out: &Partial, source: &Source<'_>, names: &[u64], target: Target<'_>) -> Outcome<()> {
    let parts = out.made();
    for part in parts {
        if names.get(part.file) != Some(&part.names) {
            return Err(FleetError::Settings(format!(
                "the files of the input up to number {} are not those that parts of {} were made \
                 of; make that run again, or start over with --restart",
                part.file + 1,
                target.output.display()
            )));
        }
    }
    source.check(parts.iter().flat_map(|part| &part.pieces))
}

/// Counts of the run that made an output, if it was this one.
fn finished(
    job: &Job,
    output: &Path,
    settings: &Value,
    source: &Source<'_>,
    names: u64,
) -> Outcome<Option<[u64; 4]>> {
    if job.start.force || !output.is_file() || crate::partial::beside(output, ".journal").exists() {
        return Ok(None);
    }
    let found = Finished::read(output)?;
    let Some(found) = found.filter(|found| found.settings == *settings && found.names == names)
    else {
        return Ok(None);
    };
    Ok((source.digest()?.text() == found.content).then_some(found.counts))
}

/// Settings that two runs must share for one to continue the other.
fn settings(job: &Job, model: &Model, form: Form, id_type: &DataType, has_names: bool) -> Value {
    let names = &job.names;
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "model": model.hash(),
        "columns": [
            names.trace_id, names.step, names.observation, names.elsewhere, names.latitude,
            names.longitude, names.deviation,
        ],
        "type of ids": format!("{id_type}"),
        "names of files": has_names,
        "routine": format!("{:?}", job.verb),
        "table": format!("{:?}", job.table),
        "form": format!("{form:?}"),
        "part": job.part,
        "compression": format!("{:?}", job.pack),
    })
}
