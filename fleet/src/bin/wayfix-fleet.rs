//! Runs a model over a file of drives.
//!
//! ```text
//! wayfix-fleet smooth --model model.json --input drives.parquet --output smoothed.parquet
//! ```

use std::io::{self, Write};
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::thread;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use wayfix_fleet::input::{ColumnNames, Form};
use wayfix_fleet::inspect::ModelCommand;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::pool::{
    Control, LiveJob, LiveSummary, Notice, PoolOptions, ServiceJob, Timing, position, serve,
    signals,
};
use wayfix_fleet::{
    Course, FleetError, Job, LearnJob, Pack, Progress, SimulateCommand, Start, Summary, learn, run,
};

/// One wayfix model over any number of drives, from Parquet or CSV to Parquet. A run that was
/// interrupted goes on where it was when the same command is given again.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    routine: Routine,
}

#[derive(Debug, Subcommand)]
enum Routine {
    /// The distribution of every step given the whole drive.
    Smooth(Run),
    /// The distribution of every step given those up to it.
    Filter(Run),
    /// The most probable paths.
    Decode(Run),
    /// The log-likelihood of every drive.
    Score(Run),
    /// A model that fits the drives better, by expectation and maximisation.
    Learn(Learn),
    /// The rows of a query, with functions for the routines above.
    #[cfg(feature = "sql")]
    Sql(wayfix_fleet::sql::Command),
    /// The position of each of many vehicles, as they are seen: lines of JSON to standard output
    /// for those on standard input.
    Live(Live),
    /// Where the input of `live` goes on after a snapshot: a line of JSON.
    Position {
        /// Snapshot of a run of `live`.
        snapshot: PathBuf,
    },
    /// What the file of a model says, and whether it is valid.
    #[command(subcommand)]
    Model(ModelCommand),
    /// Drives that are drawn from a model, with their true states, for trying things.
    Simulate(SimulateCommand),
}

#[derive(Debug, Args)]
struct Files {
    /// Model, the JSON of a wayfix `Hmm`.
    #[arg(long)]
    model: PathBuf,
    /// Drives, a CSV file if its name ends so, else a Parquet file; a folder of files, or a
    /// pattern in quotes. May be given several times, but to learn.
    #[arg(long, required = true)]
    input: Vec<PathBuf>,
    /// Results; a folder for a file of results for each file of the input.
    #[arg(long)]
    output: PathBuf,
    /// Column with the id of the drive.
    #[arg(long, default_value = "trace_id")]
    trace_id: String,
    /// Column with the step.
    #[arg(long, default_value = "step")]
    step: String,
    /// Column with the observation.
    #[arg(long, default_value = "observation")]
    observation: String,
    /// Column with the likelihood of the states that a sparse list does not name.
    #[arg(long, default_value = "elsewhere")]
    elsewhere: String,
    /// Columns of positions.
    #[arg(long, num_args = 3, value_names = ["LATITUDE", "LONGITUDE", "DEVIATION"],
        default_values = ["latitude", "longitude", "deviation"])]
    position: Vec<String>,
    /// Threads; all cores by default.
    #[arg(long)]
    threads: Option<usize>,
    /// Replaces an output that exists.
    #[arg(long)]
    force: bool,
    /// Starts over, if an earlier run was interrupted.
    #[arg(long)]
    restart: bool,
    /// Shows no progress.
    #[arg(long)]
    quiet: bool,
}

#[derive(Debug, Args)]
struct Run {
    #[command(flatten)]
    files: Files,
    /// Table of the results: steps or best (smooth, filter), paths (decode), or drives.
    #[arg(long)]
    table: Option<Content>,
    /// Number of states for each step (best) or of paths for each drive (paths).
    #[arg(long, default_value_t = 1)]
    count: usize,
    /// A row for each step, or for each drive; as the input by default.
    #[arg(long)]
    form: Option<FormOf>,
    /// Rows (steps) of a row group of the output, at least. An interruption loses one that is not
    /// complete.
    #[arg(long, default_value_t = 1 << 19)]
    part: usize,
    /// Compression of the output.
    #[arg(long, default_value = "none")]
    compression: Pack,
    /// Leaves out drives that are no valid input, and writes them into a file: a line of JSON with
    /// file, row, trace_id, column and reason. A folder if the output is one.
    #[arg(long, value_name = "FILE")]
    skip_invalid: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct Learn {
    #[command(flatten)]
    files: Files,
    /// Most re-estimations.
    #[arg(long, default_value_t = 100)]
    iterations: usize,
    /// Gain in log-likelihood below which learning stops.
    #[arg(long, default_value_t = 1e-3)]
    tolerance: f64,
    /// Keeps the prior.
    #[arg(long)]
    keep_prior: bool,
    /// Scheduler of a cluster that works through the drives, in so many tasks as there are
    /// `--threads`. Its executors find the input and the folder of the output under the same paths.
    #[cfg(feature = "ballista")]
    #[arg(long, value_name = "HOST:PORT")]
    scheduler: Option<String>,
}

#[derive(Debug, Args)]
struct Live {
    /// Model, the JSON of a wayfix `Hmm`.
    #[arg(long)]
    model: PathBuf,
    /// Snapshot to go on from.
    #[arg(long)]
    restore: Option<PathBuf>,
    /// Snapshot that is written at the end of the input, on SIGTERM, SIGINT and SIGUSR1, and as
    /// `--every` says.
    #[arg(long)]
    snapshot: Option<PathBuf>,
    /// Seconds between two snapshots while lines come.
    #[arg(long, value_parser = seconds, requires = "snapshot")]
    every: Option<Duration>,
    /// File that is read instead of standard input, from the position of the snapshot on.
    #[arg(long, conflicts_with = "replay")]
    input: Option<PathBuf>,
    /// Takes lines from connections at unix:PATH or HOST:PORT instead, and answers them there.
    #[arg(long, value_name = "ADDRESS", conflicts_with_all = ["input", "replay"])]
    listen: Option<String>,
    /// Standard input begins again from the first line of all: what the snapshot has is skipped.
    #[arg(long)]
    replay: bool,
    /// File for the answers instead of standard output. What follows those of the snapshot is cut
    /// off.
    #[arg(long)]
    output: Option<PathBuf>,
    /// Forgets vehicles that were last seen so many units of `time` before the latest update.
    #[arg(long, value_name = "UNITS")]
    forget_after: Option<u64>,
    /// Units of `time` of a step of the model; every update is one step by default.
    #[arg(long, value_name = "UNITS")]
    step: Option<NonZeroU64>,
    /// Most steps of an update with `--step`.
    #[arg(long, default_value = "1000", requires = "step")]
    most_steps: NonZeroU64,
    /// Takes updates in the order of their times, if they are so many units of `time` behind the
    /// latest at most; refuses others.
    #[arg(long, value_name = "UNITS")]
    lateness: Option<u64>,
    /// Takes the largest `time` that so many vehicles have reached for the latest, so that one clock
    /// that is far ahead makes no other vehicle late or forgotten.
    #[arg(long, value_name = "VEHICLES", default_value = "1")]
    agree: NonZeroUsize,
    /// Folder of the models that a line may name.
    #[arg(long)]
    models: Option<PathBuf>,
    /// Address at which `/metrics` and `/health` are answered, as 127.0.0.1:9100.
    #[arg(long, value_name = "HOST:PORT")]
    metrics: Option<String>,
    /// Form of the log on standard error.
    #[arg(long, default_value = "text")]
    log: Log,
    /// Memory for vehicles, in bytes, or with K, M or G (of 1024); no limit by default.
    #[arg(long, value_parser = bytes, requires = "spill")]
    memory: Option<usize>,
    /// Folder for vehicles beyond that memory, for one run at a time.
    #[arg(long)]
    spill: Option<PathBuf>,
    /// Threads; all cores by default.
    #[arg(long)]
    threads: Option<usize>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Log {
    /// What is wrong, and a summary.
    Text,
    /// All, as lines of JSON.
    Json,
}

/// Reads a number of seconds.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|error| format!("{error}"))?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

/// Reads a number of bytes.
fn bytes(text: &str) -> Result<usize, String> {
    let (number, unit) = match text.char_indices().last() {
        Some((at, 'K' | 'k')) => (&text[..at], 1 << 10),
        Some((at, 'M' | 'm')) => (&text[..at], 1 << 20),
        Some((at, 'G' | 'g')) => (&text[..at], 1 << 30),
        _ => (text, 1_usize),
    };
    let number: usize = number.parse().map_err(|error| format!("{error}"))?;
    number.checked_mul(unit).ok_or_else(|| "more bytes than there are".to_owned())
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Content {
    Steps,
    Best,
    Paths,
    Drives,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FormOf {
    Long,
    Nested,
}

impl Files {
    fn names(&self) -> ColumnNames {
        let position = |axis: usize| self.position.get(axis).cloned().unwrap_or_default();
        ColumnNames {
            trace_id: self.trace_id.clone(),
            step: self.step.clone(),
            observation: self.observation.clone(),
            elsewhere: self.elsewhere.clone(),
            latitude: position(0),
            longitude: position(1),
            deviation: position(2),
        }
    }

    fn start(&self) -> Start {
        Start { force: self.force, restart: self.restart }
    }

    fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| thread::available_parallelism().map_or(1, Into::into))
    }
}

fn main() -> ExitCode {
    let done = match Arguments::parse().routine {
        Routine::Smooth(options) => start(Verb::Smooth, &options),
        Routine::Filter(options) => start(Verb::Filter, &options),
        Routine::Decode(options) => start(Verb::Decode, &options),
        Routine::Score(options) => start(Verb::Score, &options),
        Routine::Learn(options) => start_learning(&options),
        #[cfg(feature = "sql")]
        Routine::Sql(command) => command.run(),
        Routine::Live(options) => start_live(options),
        Routine::Position { snapshot } => show_position(&snapshot),
        Routine::Model(command) => command.run(),
        Routine::Simulate(command) => command.run(),
    };
    match done {
        Ok(text) => {
            if !text.is_empty() {
                // Standard output may be closed.
                let _ = writeln!(io::stdout(), "{text}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            let _ = writeln!(io::stderr(), "error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn start(verb: Verb, options: &Run) -> Result<String, FleetError> {
    let files = &options.files;
    let content = options.table.unwrap_or(match verb {
        Verb::Smooth | Verb::Filter => Content::Steps,
        Verb::Decode => Content::Paths,
        Verb::Score => Content::Drives,
    });
    let job = Job {
        model: files.model.clone(),
        inputs: files.input.clone(),
        output: files.output.clone(),
        left_out: options.skip_invalid.clone(),
        names: files.names(),
        verb,
        table: match content {
            Content::Steps => Table::Steps,
            Content::Best => Table::Best(options.count),
            Content::Paths => Table::Paths(options.count),
            Content::Drives => Table::Drives,
        },
        form: options.form.map(|form| match form {
            FormOf::Long => Form::Long,
            FormOf::Nested => Form::Nested,
        }),
        part: options.part,
        pack: options.compression,
        threads: files.threads(),
        start: files.start(),
    };
    let bar = bar(files.quiet);
    let done = run(&job, |progress| show(&bar, progress));
    bar.finish_and_clear();
    let Summary { drives, steps, failed, left_out, parts, resumed, outputs, finished } = done?;
    let mut text = format!("{drives} drives, {steps} steps, {failed} drives with an error");
    if left_out > 0 {
        text += &format!(", {left_out} drives left out");
    }
    if finished == outputs {
        text += "; finished already";
    } else if finished > 0 {
        text += &format!("; {finished} of {outputs} outputs were finished already");
    }
    if resumed > 0 {
        text += &format!("; {resumed} of {parts} parts were there already");
    }
    Ok(text)
}

fn start_learning(options: &Learn) -> Result<String, FleetError> {
    let files = &options.files;
    let [input] = &files.input[..] else {
        let message = "learning has one --input: a file, a folder or a pattern";
        return Err(FleetError::Settings(message.to_owned()));
    };
    let job = LearnJob {
        model: files.model.clone(),
        input: input.clone(),
        output: files.output.clone(),
        names: files.names(),
        iterations: options.iterations,
        tolerance: options.tolerance,
        keep_prior: options.keep_prior,
        threads: files.threads(),
        start: files.start(),
    };
    let bar = bar(files.quiet);
    #[cfg(feature = "ballista")]
    let scheduler = options.scheduler.as_deref();
    #[cfg(not(feature = "ballista"))]
    let scheduler = None;
    let done = iterations(&job, scheduler, &bar);
    bar.finish_and_clear();
    let course = done?;
    let last = course.log_likelihoods.last().copied().unwrap_or(0.0);
    let (count, left_out) = (course.log_likelihoods.len().saturating_sub(1), course.left_out);
    Ok(format!("log-likelihood {last} after {count} re-estimations, {left_out} drives left out"))
}

/// Learns on a cluster, or else from the file.
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

fn start_live(options: Live) -> Result<String, FleetError> {
    let all = PoolOptions::default();
    let threads = options.threads.unwrap_or(all.threads);
    let job = ServiceJob {
        every: options.every,
        input: options.input,
        listen: options.listen,
        replay: options.replay,
        output: options.output,
        timing: Timing {
            forget_after: options.forget_after,
            step: options.step,
            most_steps: Some(options.most_steps),
            agree: Some(options.agree),
        },
        lateness: options.lateness,
        models: options.models,
        metrics: options.metrics,
        ..ServiceJob::new(LiveJob {
            model: options.model,
            restore: options.restore,
            snapshot: options.snapshot,
            options: PoolOptions { threads, memory: options.memory, spill: options.spill },
        })
    };
    let control = Control::new();
    signals(&control)
        .map_err(|error| FleetError::Settings(format!("signals cannot be taken: {error}")))?;
    let is_json = options.log == Log::Json;
    let say = |notice: &Notice| {
        // Standard output has answers.
        let _ = if is_json {
            writeln!(io::stderr(), "{}", notice.to_json())
        } else if notice.is_warning() || matches!(notice, Notice::Model { .. }) {
            writeln!(io::stderr(), "{notice}")
        } else {
            Ok(())
        };
    };
    let LiveSummary { lines, errors, vehicles, snapshot } =
        serve(&job, &control, io::stdin(), io::stdout().lock(), say)?;
    let mut text = format!("{lines} lines, {errors} with an error, {vehicles} vehicles");
    if let Some(bytes) = snapshot {
        text += &format!(", snapshot of {bytes} bytes");
    }
    if is_json {
        text = format!(
            r#"{{"level":"info","event":"end","lines":{lines},"errors":{errors},"vehicles":{vehicles}}}"#
        );
    }
    let _ = writeln!(io::stderr(), "{text}");
    Ok(String::new())
}

fn show_position(snapshot: &Path) -> Result<String, FleetError> {
    match position(snapshot)? {
        Some(position) => serde_json::to_string(&position)
            .map_err(|error| FleetError::Settings(format!("no position: {error}"))),
        None => Err(FleetError::Settings(format!("{}: has no position", snapshot.display()))),
    }
}

fn bar(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::no_length();
    let style = "{wide_bar} {pos}/{len} rows, {msg}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(style) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

fn show(bar: &ProgressBar, progress: &Progress) {
    if let Some(rows) = progress.all_rows {
        bar.set_length(rows);
    }
    bar.set_position(progress.rows);
    bar.set_message(format!("{} drives", progress.drives));
}
