//! Learning from a file of drives, which is read once for each iteration.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use wayfix::inference::Order;
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::{LearnTransition, MoveCounts};
use wayfix::{Belief, Hmm, InferenceError, Prior};

use crate::error::{FleetError, Outcome};
use crate::input::{self, ColumnNames, Drives};
use crate::model::{Model, with_hmm};
use crate::partial::beside;
use crate::pipeline;
use crate::run::{Progress, Start, stamp};
use crate::sensor::{Observation, Sensor};

/// Batches for each thread that are under way.
const AHEAD: usize = 2;

/// Learning from a file.
#[derive(Debug, Clone)]
pub struct LearnJob {
    /// File of the model to start from.
    pub model: PathBuf,
    /// File of the drives, Parquet or CSV.
    pub input: PathBuf,
    /// File of the learned model, JSON.
    pub output: PathBuf,
    /// Names of the columns of the input.
    pub names: ColumnNames,
    /// Largest number of re-estimations.
    pub iterations: usize,
    /// Gain of a re-estimation, in nats, below which learning stops.
    pub tolerance: f64,
    /// True to keep the prior.
    pub keep_prior: bool,
    /// Number of threads.
    pub threads: usize,
    /// Way to begin.
    pub start: Start,
}

/// Course of learning.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Course {
    /// Log-likelihood of all drives that are not left out, of the given model and after each
    /// re-estimation.
    pub log_likelihoods: Vec<f64>,
    /// Number of drives that the model rules out, which are left out.
    pub left_out: u64,
}

/// Expectations of drives.
struct Expected {
    first: Vec<f64>,
    moves: MoveCounts,
    sensor: Vec<f64>,
    log_likelihood: f64,
    drives: u64,
    left_out: u64,
}

/// State of an unfinished run.
#[derive(Serialize, Deserialize)]
struct State {
    settings: Value,
    course: Course,
    model: Value,
}

/// Learns prior, transitions and sensor by Baum–Welch, as `Hmm::learn` of the library without
/// pseudo-counts, or continues where a run was interrupted: after the last re-estimation.
///
/// Memory does not grow with the file; each iteration reads it, and passes each drive twice through
/// the smoother. Sums are in the order of the file: the result does not depend on the number of
/// threads. Only a table learns; other sensors stay as they are.
///
/// # Errors
///
/// [`FleetError`] if a file cannot be read or written, settings or input are not valid, or no drive
/// is possible under the model.
pub fn learn(job: &LearnJob, progress: impl FnMut(usize, &Progress)) -> Outcome<Course> {
    let model = Model::load(&job.model)?;
    with_hmm!(model, hmm => iterate(hmm, &model, job, progress))
}

fn iterate<A>(
    hmm: &Hmm<A, Sensor>,
    model: &Model,
    job: &LearnJob,
    mut progress: impl FnMut(usize, &Progress),
) -> Outcome<Course>
where
    A: LearnTransition<Control = ()> + Clone + Sync + Serialize + for<'de> Deserialize<'de>,
{
    if !(job.tolerance >= 0.0 && job.tolerance.is_finite()) {
        let message = format!("the tolerance is {}, expected a value of at least 0", job.tolerance);
        return Err(FleetError::Settings(message));
    }
    let path = beside(&job.output, ".partial");
    if job.output.exists() && !job.start.force {
        let message = format!("{} exists; replace it with --force", job.output.display());
        return Err(FleetError::Settings(message));
    }
    let [size, modified] = stamp(&job.input)?;
    let settings = json!({
        "version": env!("CARGO_PKG_VERSION"), "model": model.hash(), "input size": size,
        "input modified": modified, "keep prior": job.keep_prior,
    });
    let (mut hmm, mut course) = (hmm.clone(), Course::default());
    if path.exists() && !job.start.restart {
        let wrong = |error| FleetError::format(&path, error);
        let text = fs::read(&path).map_err(FleetError::file(&path))?;
        let state: State = serde_json::from_slice(&text).map_err(wrong)?;
        if state.settings != settings {
            let message = "is of an unfinished run with another model, input or prior; make that \
                           one again, or start over with --restart";
            return Err(FleetError::Settings(format!("{} {message}", path.display())));
        }
        (hmm, course) = (serde_json::from_value(state.model).map_err(wrong)?, state.course);
    }
    loop {
        let iteration = course.log_likelihoods.len();
        let expected = expect(&hmm, job, |done| progress(iteration, done))?;
        if expected.drives == expected.left_out {
            let message = format!("none of {} drives is possible", expected.drives);
            return Err(FleetError::Learning(message));
        }
        if iteration > 0 && expected.left_out != course.left_out {
            let message = format!(
                "{} drives are impossible after re-estimation {iteration}, before it were {}",
                expected.left_out, course.left_out
            );
            return Err(FleetError::Learning(message));
        }
        course.left_out = expected.left_out;
        let before = course.log_likelihoods.last().copied();
        course.log_likelihoods.push(expected.log_likelihood);
        let converged =
            before.is_some_and(|before| expected.log_likelihood - before < job.tolerance);
        if converged || iteration >= job.iterations {
            save(&job.output, &hmm)?;
            if path.exists() {
                fs::remove_file(&path).map_err(FleetError::file(&path))?;
            }
            return Ok(course);
        }
        hmm = maximize(&hmm, &expected, job.keep_prior)
            .map_err(|error| FleetError::Learning(error.to_string()))?;
        let value = serde_json::to_value(&hmm).map_err(|error| FleetError::format(&path, error))?;
        let state = State { settings: settings.clone(), course: course.clone(), model: value };
        save(&path, &state)?;
    }
}

/// Writes a file under a temporary name first.
fn save(path: &Path, value: &impl Serialize) -> Outcome<()> {
    let written = beside(path, ".new");
    let text = serde_json::to_vec(value).map_err(|error| FleetError::format(path, error))?;
    let wrong = FleetError::file(&written);
    fs::write(&written, text).map_err(&wrong)?;
    fs::File::open(&written).and_then(|file| file.sync_all()).map_err(&wrong)?;
    fs::rename(&written, path).map_err(FleetError::file(path))
}

/// Adds up the expectations of all drives of the file.
fn expect<A>(
    hmm: &Hmm<A, Sensor>,
    job: &LearnJob,
    mut progress: impl FnMut(&Progress),
) -> Outcome<Expected>
where
    A: LearnTransition<Control = ()> + Sync,
{
    let found = input::open(&job.input, &job.names, hmm.likelihood(), 0)?;
    let mut sum = nothing(hmm);
    let mut state = Progress { all_rows: found.rows, ..Progress::default() };
    let work = |drives: Drives| Ok((of_batch(hmm, &drives)?, drives.end_row));
    pipeline::in_order(found.batches, job.threads, AHEAD, work, |done: Outcome<_>| {
        let (some, end_row) = done?;
        add(hmm, &mut sum, &some);
        state = Progress { rows: end_row, drives: sum.drives, ..state };
        progress(&state);
        Ok(())
    })?;
    Ok(sum)
}

fn nothing<A: LearnTransition<Control = ()>>(hmm: &Hmm<A, Sensor>) -> Expected {
    Expected {
        first: vec![0.0; hmm.states()],
        moves: MoveCounts::default(),
        sensor: hmm.likelihood().statistics(),
        log_likelihood: 0.0,
        drives: 0,
        left_out: 0,
    }
}

fn add<A: LearnTransition<Control = ()>>(
    hmm: &Hmm<A, Sensor>,
    sum: &mut Expected,
    other: &Expected,
) {
    sum.first.iter_mut().zip(&other.first).for_each(|(sum, p)| *sum += p);
    sum.moves.merge(&other.moves);
    hmm.likelihood().merge(&mut sum.sensor, &other.sensor);
    sum.log_likelihood += other.log_likelihood;
    sum.drives += other.drives;
    sum.left_out += other.left_out;
}

/// Expectations of a batch. Drives that the model rules out are left out; what is not valid is an
/// error.
fn of_batch<A>(hmm: &Hmm<A, Sensor>, drives: &Drives) -> Outcome<Expected>
where
    A: LearnTransition<Control = ()> + Sync,
{
    let all = drives.observations()?;
    let mut sum = nothing(hmm);
    for drive in drives.offsets.windows(2) {
        let seen = &all[drive[0]..drive[1]];
        sum.drives += 1;
        if seen.is_empty() {
            continue;
        }
        match of_drive(hmm, seen) {
            Ok(expected) => add(hmm, &mut sum, &expected),
            Err(InferenceError::Likelihood { step, source }) => {
                return Err(drives.refuse(drive[0] + step - 1, &source.to_string()));
            }
            Err(_) => sum.left_out += 1,
        }
    }
    Ok(sum)
}

fn of_drive<A>(hmm: &Hmm<A, Sensor>, seen: &[Observation]) -> Result<Expected, InferenceError>
where
    A: LearnTransition<Control = ()> + Sync,
{
    let mut expected = nothing(hmm);
    expected.log_likelihood = hmm.smooth_each(seen, Order::Backward, |step| {
        let posterior = step.smoothed();
        if step.step() == 0 {
            expected.first.copy_from_slice(posterior.as_slice());
        } else {
            let observation = &seen[step.step() - 1];
            hmm.likelihood().add(&mut expected.sensor, observation, posterior.as_slice());
        }
    })?;
    expected.moves = hmm.expected_moves(seen)?;
    Ok(expected)
}

/// Returns the model that fits the expectations best.
fn maximize<A: LearnTransition<Control = ()>>(
    hmm: &Hmm<A, Sensor>,
    expected: &Expected,
    keep_prior: bool,
) -> Result<Hmm<A, Sensor>, Box<dyn std::error::Error + Send + Sync>> {
    let prior = if keep_prior {
        hmm.prior().clone()
    } else {
        let belief = Belief::from_weights(expected.first.clone())?;
        match hmm.prior() {
            Prior::BeforeFirstTransition(_) => Prior::BeforeFirstTransition(belief),
            Prior::AtFirstObservation(_) => Prior::AtFirstObservation(belief),
        }
    };
    let transition = hmm.transition().reestimate(std::slice::from_ref(&expected.moves), 0.0)?;
    let sensor = hmm.likelihood().reestimate(&expected.sensor, 0.0)?;
    let learned = Hmm::new(prior, transition, sensor)?;
    Ok(if hmm.rounds_tails() { learned.with_rounded_tails() } else { learned })
}
