//! Baum–Welch learning from files of drives, which are read once per iteration.
//!
//! After each M-step the model and the course so far are saved, so an interrupted run repeats at
//! most one pass. Sums are added in the order of the input; with the input the same (its hash is
//! compared in every pass), the result is the same to the bit.

mod kept;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::json;
use wayfix::Hmm;
use wayfix::transition::{LearnTransition, MoveCounts};

use crate::error::{FleetError, Outcome};
use crate::expected::Expected;
use crate::folder;
use crate::input::files::{InputFiles, find};
use crate::input::pieces::Digest;
use crate::input::source::Source;
use crate::input::{ColumnNames, Drives};
use crate::job::Progress;
use crate::model::{Model, with_hmm};
use crate::overwrite;
use crate::partial::Start;
use crate::pipeline;
use crate::sensor::Sensor;
use crate::storage;
#[cfg(feature = "sql")]
pub(crate) use kept::save;
use kept::{Kept, State};

/// Batches per thread in flight.
const AHEAD: usize = 2;

/// Settings of learning.
#[derive(Debug, Clone)]
pub struct LearnJob {
    /// File of the initial model.
    pub model: PathBuf,
    /// File of drives, Parquet or CSV; a folder of such files, or a pattern.
    pub input: PathBuf,
    /// File of the learned model, JSON.
    pub output: PathBuf,
    /// Names of the columns of the input.
    pub names: ColumnNames,
    /// Maximum number of re-estimations.
    pub iterations: usize,
    /// Learning stops once a re-estimation gains less than this, in nats.
    pub tolerance: f64,
    /// True to keep the prior.
    pub keep_prior: bool,
    /// Number of threads.
    pub threads: usize,
    /// How to treat existing output.
    pub start: Start,
}

/// Record of a run of learning.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Course {
    /// Log-likelihood of all drives that are not left out, under the initial model and after each
    /// re-estimation.
    pub log_likelihoods: Vec<f64>,
    /// Number of drives that the model rules out, which are left out.
    pub left_out: u64,
    /// True if an earlier run finished the output.
    #[serde(skip)]
    pub finished: bool,
}

/// Learns prior, transitions and sensor by Baum–Welch, like `Hmm::learn` of the library without
/// pseudo-counts, or continues an interrupted run after its last re-estimation.
///
/// If an output of these settings and this input already exists, nothing is done.
///
/// Each iteration reads the whole input, but memory does not grow with it. Sums are added in the
/// order of the input, so the result does not depend on the number of threads. Only a table is
/// learned; other sensors stay as they are.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, settings or input are invalid, or no drive
/// is possible under the model.
pub fn learn(job: &LearnJob, mut progress: impl FnMut(usize, &Progress)) -> Outcome<Course> {
    storage::local(&job.output)?;
    let model = Model::fetch(&job.model)?;
    with_hmm!(model, hmm => iterate_checked(hmm, &model, job, |hmm, iteration, content| {
        expect(hmm, job, content, |done| progress(iteration, done))
    }))
}

/// Iterates with expectations computed elsewhere; `expect` gets the model and the number of
/// re-estimations before it.
#[cfg(feature = "sql")]
pub(crate) fn iterate<A>(
    hmm: &Hmm<A, Sensor>,
    model: &Model,
    job: &LearnJob,
    mut expect: impl FnMut(&Hmm<A, Sensor>, usize) -> Outcome<Expected>,
) -> Outcome<Course>
where
    A: LearnTransition<Control = (), Statistics = MoveCounts>
        + Clone
        + Sync
        + Serialize
        + for<'de> Deserialize<'de>,
{
    iterate_checked(hmm, model, job, |hmm, iteration, _| expect(hmm, iteration))
}

/// The same; `expect` also gets the hash of the input that it should read.
fn iterate_checked<A>(
    hmm: &Hmm<A, Sensor>,
    model: &Model,
    job: &LearnJob,
    mut expect: impl FnMut(&Hmm<A, Sensor>, usize, &str) -> Outcome<Expected>,
) -> Outcome<Course>
where
    A: LearnTransition<Control = (), Statistics = MoveCounts>
        + Clone
        + Sync
        + Serialize
        + for<'de> Deserialize<'de>,
{
    if !(job.tolerance >= 0.0 && job.tolerance.is_finite()) {
        let message = format!("the tolerance is {}, expected a value of at least 0", job.tolerance);
        return Err(FleetError::Settings(message));
    }
    let files = inputs(job)?;
    // Locks the output, before anything about it is read.
    let kept = Kept::open(&job.output)?;
    let content = Source::new(&files, &job.names, hmm.likelihood(), false)?.digest()?.text();
    let settings = json!({
        "version": env!("CARGO_PKG_VERSION"), "model": model.hash(), "input": content,
        "columns": job.names.all(), "keep prior": job.keep_prior,
    });
    // The number of iterations and the tolerance only decide when to stop, so an unfinished run may
    // continue with different ones. A finished output must also match them.
    let end = json!({"run": settings, "iterations": job.iterations, "tolerance": job.tolerance});
    if job.output.exists() && !job.start.force {
        let exists = || {
            let message = format!("{} exists; replace it with --force", job.output.display());
            FleetError::Settings(message)
        };
        return kept.finished(&end)?.ok_or_else(exists);
    }
    let (mut hmm, mut course) = (hmm.clone(), Course::default());
    // A saved state holds the model after the M-step, and log-likelihoods of all models before it.
    let state = if job.start.restart { None } else { kept.state(&settings)? };
    if let Some(state) = state {
        let done = state.course.log_likelihoods.len();
        if done > job.iterations {
            let message = format!(
                "the unfinished run made {done} re-estimations already, but --iterations is {}; raise \
                 it, or start over with --restart",
                job.iterations
            );
            return Err(FleetError::Settings(message));
        }
        let model = serde_json::from_value(state.model);
        hmm = model.map_err(|error| FleetError::format(&job.output, error))?;
        course = state.course;
    }
    loop {
        let iteration = course.log_likelihoods.len();
        // The E-step also gives the log-likelihood of the current model, so the loop ends with an
        // E-step.
        let expected = expect(&hmm, iteration, &content)?;
        if expected.drives == expected.left_out {
            let message =
                format!("none of the {} drives is possible under the model", expected.drives);
            return Err(FleetError::Learning(message));
        }
        // An M-step cannot rule out a drive that it was estimated from. If the count changes all
        // the same, log-likelihoods are of different drives and cannot be compared.
        if iteration > 0 && expected.left_out != course.left_out {
            let message = format!(
                "{} drives are impossible after re-estimation {iteration}, but {} were before it",
                expected.left_out, course.left_out
            );
            return Err(FleetError::Learning(message));
        }
        course.left_out = expected.left_out;
        let before = course.log_likelihoods.last().copied();
        course.log_likelihoods.push(expected.log_likelihood());
        // EM never lowers the log-likelihood, so a small gain means convergence. NaN does not
        // occur: at least one drive is possible.
        let converged =
            before.is_some_and(|before| expected.log_likelihood() - before < job.tolerance);
        // The model returned is the one that was just measured.
        if converged || iteration >= job.iterations {
            kept.finish(&hmm, &course, end)?;
            return Ok(course);
        }
        hmm = expected.maximize(&hmm, job.keep_prior)?;
        let model =
            serde_json::to_value(&hmm).map_err(|error| FleetError::format(&job.output, error))?;
        kept.write(&State { settings: settings.clone(), course: course.clone(), model })?;
    }
}

/// Input files; the output may not overwrite any of them.
pub(crate) fn inputs(job: &LearnJob) -> Outcome<InputFiles> {
    let files = find(std::slice::from_ref(&job.input))?;
    folder::outside(&files, &job.output)?;
    overwrite::refuse([job.output.as_path()], files.read_with(&job.model))?;
    Ok(files)
}

/// Adds up the expectations of all drives, and checks that the input has the hash `content`.
fn expect<A>(
    hmm: &Hmm<A, Sensor>,
    job: &LearnJob,
    content: &str,
    mut progress: impl FnMut(&Progress),
) -> Outcome<Expected>
where
    A: LearnTransition<Control = (), Statistics = MoveCounts> + Sync,
{
    let files = find(std::slice::from_ref(&job.input))?;
    let source = Source::new(&files, &job.names, hmm.likelihood(), false)?;
    let mut sum = Expected::nothing(hmm);
    let mut state = Progress { all_rows: source.rows, ..Progress::default() };
    let mut digest = Digest::default();
    let work = |(file, drives): (usize, Drives)| {
        let some = Expected::of(hmm, &drives).map_err(|error| source.name(file, error))?;
        Ok((some, file, drives.end_row))
    };
    let drives = source.drives(0, 0);
    pipeline::in_order(drives, job.threads, AHEAD, work, |done: Outcome<_>| {
        let (some, file, end_row) = done?;
        sum.merge(hmm, &some);
        // Pieces are hashed as they are read, so the comparison costs no second pass.
        source.pieces.take(file, end_row).iter().for_each(|piece| digest.add(piece));
        state = Progress { rows: source.rows_until(file, end_row), drives: sum.drives, ..state };
        progress(&state);
        Ok(())
    })?;
    source.pieces.take(usize::MAX, u64::MAX).iter().for_each(|piece| digest.add(piece));
    // Only now is all of the input read. Nothing has been saved from these sums.
    if digest.text() != content {
        let message = "has changed since learning began; start over with --restart";
        return Err(FleetError::changed(&job.input, message));
    }
    Ok(sum)
}
