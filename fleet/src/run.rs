//! A routine over files of drives, batch by batch.
//!
//! Batches are read in order, worked on in parallel and written in order ([`pipeline::in_order`]);
//! part boundaries depend only on the rows, so an interrupted run that continues writes the same
//! bytes as one that was never interrupted.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_schema::Schema;
use serde_json::Value;

use crate::error::{FleetError, Outcome};
use crate::finished::Finished;
use crate::folder;
use crate::input::files::{InputFiles, find};
use crate::input::invalid::halves;
use crate::input::source::Source;
use crate::input::{Drives, Form, Invalid};
use crate::job::{Job, Progress, Summary, Target};
use crate::model::Model;
use crate::names::{hashes, named, with_file};
use crate::output::{self, Batch, Results, Table};
use crate::overwrite::{self, beside, is_same};
use crate::partial::{Opened, Partial, Plan};
use crate::pipeline;
use crate::properties::properties;
use crate::storage;

/// Batches per thread in flight or waiting to be written.
const AHEAD: usize = 4;

/// Runs a routine over files, or continues an interrupted run.
///
/// Results are in the order of the input. The output gets its name only when it is complete; until
/// then it ends in `.partial` and has a `.journal` beside it. After an error the same call
/// continues. If an output of these settings and this input already exists, nothing is done.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, or settings or input are invalid.
pub fn run(job: &Job, mut progress: impl FnMut(&Progress)) -> Outcome<Summary> {
    let results = || job.left_out.iter().chain([&job.output]);
    results().try_for_each(|path| storage::local(path))?;
    let model = Model::fetch(&job.model)?;
    let files = find(&job.inputs)?;
    results().try_for_each(|path| folder::outside(&files, path))?;
    if let Some(left_out) = &job.left_out
        && (is_same(left_out, &job.output)
            || (folder::is_folder(left_out) && !folder::is_folder(&job.output)))
    {
        let message = "--skip-invalid must name a file other than the output, and a folder only \
                       if the output is one";
        return Err(FleetError::Settings(message.to_owned()));
    }
    // A folder gets one output per input file, each with its own journal.
    if folder::is_folder(&job.output) {
        return folder::run(job, &files, &mut progress, |one, target, progress| {
            run_into(job, &model, one, target, progress)
        });
    }
    overwrite::refuse(results().map(PathBuf::as_path), files.read_with(&job.model))?;
    let has_names = !files.is_one;
    let out = Target { output: &job.output, left_out: job.left_out.as_deref(), has_names };
    run_into(job, &model, &files, out, &mut progress)
}

fn run_into(
    job: &Job,
    model: &Model,
    files: &InputFiles,
    target: Target<'_>,
    progress: &mut dyn FnMut(&Progress),
) -> Outcome<Summary> {
    let leave_out = target.left_out.is_some();
    let source = Source::new(files, &job.names, model.sensor(), leave_out)?;
    // Everything that decides the bytes of the output is fixed here, before the first row is read:
    // it goes into `settings`, which the journal compares.
    let form = job.form.unwrap_or(source.form);
    let results = Results::new(job.verb, job.table, form)?;
    let schema = Arc::new(results.schema(&source.id_type));
    let settings = job.settings(model, form, &source.id_type, target.has_names);
    // `names[k]` hashes the names of files 0..=k. Rows carry the name of their file, so finished
    // parts stay valid only as long as the files before them keep their names and order.
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
    // This locks the output: the journal is held open until `finish`.
    let mut out = match Partial::open(plan)? {
        Opened::Finished(counts) => return Ok(Summary::finished(counts)),
        Opened::Partial(out) => out,
    };
    let resumed = out.parts();
    // Checked before any new row is made: parts of changed input must not be extended.
    check(&out, &source, &names, target)?;
    // Rows before this position are in complete parts. A part always ends between drives, so
    // reading resumes at the first row of a drive.
    let (file, row) = out.position();
    let mut place = (file, row);
    let mut state = Progress {
        rows: source.rows_until(file, row),
        all_rows: source.rows,
        drives: out.counts()[0],
    };
    progress(&state);
    // Runs on worker threads: everything except writing.
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
            // Nested rows are whole drives, so count their steps instead: a part then holds about
            // as much in either form.
            let weight = if form == Form::Nested && job.table != Table::Drives {
                batch.steps as usize
            } else {
                batch.rows.num_rows()
            };
            out.write(&batch.rows, weight, [batch.drives, batch.steps, batch.failed, 0])?;
        }
        out.leave_out(&name, &invalid)?;
        // All rows up to `at` are now in the part under construction, so it may end here.
        place = at;
        if out.weight() >= job.part {
            out.end_part(at.0, at.1, names[at.0])?;
        }
        state.rows = source.rows_until(at.0, at.1);
        state.drives = out.counts()[0];
        progress(&state);
        Ok(())
    });
    // The last part is whatever is left, of any weight.
    let done = done.and_then(|()| out.end_part(place.0, place.1, names[place.0]));
    if let Err(error) = done {
        // Nothing to continue from: leave no files behind. Otherwise the journal stays, and the
        // same command resumes after its last part.
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

/// Computes results of drives. Drives that turn out to be invalid are an error, or are left out.
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
    // Some values are only rejected by the sensor (a NaN likelihood, say), once results are
    // computed. Bisecting finds them at a cost of O(log n) batches each, while a batch without any
    // costs nothing extra.
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

/// Checks that the input is the one that the finished parts were made from.
fn check(out: &Partial, source: &Source<'_>, names: &[u64], target: Target<'_>) -> Outcome<()> {
    let parts = out.made();
    for part in parts {
        if names.get(part.file) != Some(&part.names) {
            return Err(FleetError::Settings(format!(
                "the first {} input files are not those that parts of {} were made from; repeat that \
                 run, or start over with --restart",
                part.file + 1,
                target.output.display()
            )));
        }
    }
    source.check(parts.iter().flat_map(|part| &part.pieces))
}

/// Counts of the run that made an output, if it had these settings and this input.
fn finished(
    job: &Job,
    output: &Path,
    settings: &Value,
    source: &Source<'_>,
    names: u64,
) -> Outcome<Option<[u64; 4]>> {
    // With a journal beside it, the run that made the output was killed before it could remove the
    // journal, or another is about to replace the output: `Partial::open` tells them apart.
    if job.start.force || !output.is_file() || beside(output, ".journal").exists() {
        return Ok(None);
    }
    let found = Finished::read(output)?;
    let Some(found) = found.filter(|found| found.settings == *settings && found.names == names)
    else {
        return Ok(None);
    };
    // Compared last, because this reads the whole input.
    Ok((source.digest()?.text() == found.content).then_some(found.counts))
}
