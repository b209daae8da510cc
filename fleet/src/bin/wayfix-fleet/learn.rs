//! The command `learn`.

use clap::Args;
use indicatif::ProgressBar;
use wayfix_fleet::{Course, FleetError, LearnJob, learn};

use crate::bar::{bar, show};
use crate::files::Files;

/// Options of learning.
#[derive(Debug, Args)]
pub(crate) struct Learn {
    #[command(flatten)]
    files: Files,
    /// Maximum number of re-estimations.
    #[arg(long, default_value_t = 100)]
    iterations: usize,
    /// Learning stops once a re-estimation gains less log-likelihood than this.
    #[arg(long, default_value_t = 1e-3)]
    tolerance: f64,
    /// Keeps the prior.
    #[arg(long)]
    keep_prior: bool,
    /// Scheduler of a cluster to process the drives, in as many tasks as `--threads`. Its executors
    /// must find the input and the folder of the output under the same paths.
    #[cfg(feature = "ballista")]
    #[arg(long, value_name = "HOST:PORT")]
    scheduler: Option<String>,
}

impl Learn {
    pub(crate) fn run(&self) -> Result<String, FleetError> {
        let files = &self.files;
        let [input] = &files.input[..] else {
            let message = "learn takes one --input: a file, a folder or a pattern";
            return Err(FleetError::Settings(message.to_owned()));
        };
        let job = LearnJob {
            model: files.model.clone(),
            input: input.clone(),
            output: files.output.clone(),
            names: files.names(),
            iterations: self.iterations,
            tolerance: self.tolerance,
            keep_prior: self.keep_prior,
            threads: files.threads(),
            start: files.start(),
        };
        let bar = bar(files.quiet);
        #[cfg(feature = "ballista")]
        let scheduler = self.scheduler.as_deref();
        #[cfg(not(feature = "ballista"))]
        let scheduler = None;
        let done = iterations(&job, scheduler, &bar);
        bar.finish_and_clear();
        let course = done?;
        let last = course.log_likelihoods.last().copied().unwrap_or(0.0);
        let (count, left_out) = (course.log_likelihoods.len().saturating_sub(1), course.left_out);
        let finished = if course.finished { "; finished already" } else { "" };
        Ok(format!(
            "log-likelihood {last} after {count} re-estimations, {left_out} drives left out{finished}"
        ))
    }
}

/// Learns on a cluster if there is a scheduler, or else in this process.
fn iterations(
    job: &LearnJob,
    scheduler: Option<&str>,
    bar: &ProgressBar,
) -> Result<Course, FleetError> {
    let say = |iteration| bar.set_message(format!("{iteration} re-estimations"));
    #[cfg(feature = "ballista")]
    if scheduler.is_some() {
        return wayfix_fleet::sql::learn(job, scheduler, say);
    }
    #[cfg(not(feature = "ballista"))]
    let _: Option<&str> = scheduler;
    learn(job, |iteration, progress| {
        show(bar, progress);
        say(iteration);
    })
}
