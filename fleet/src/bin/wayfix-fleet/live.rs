//! The commands `live` and `position`.

use std::io::{self, Write};
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, ValueEnum};
use wayfix_fleet::FleetError;
use wayfix_fleet::pool::{
    Control, LiveJob, LiveSummary, Notice, PoolOptions, ServiceJob, Timing, position, serve,
    signals,
};

/// Options of the service for live vehicles.
#[derive(Debug, Args)]
pub(crate) struct Live {
    /// Model, the JSON of a wayfix `Hmm`.
    #[arg(long)]
    model: PathBuf,
    /// Snapshot to continue from.
    #[arg(long)]
    restore: Option<PathBuf>,
    /// Snapshot to write at the end of the input, on SIGTERM, SIGINT and SIGUSR1, and as often as
    /// `--every` says.
    #[arg(long)]
    snapshot: Option<PathBuf>,
    /// Seconds between snapshots while lines come in.
    #[arg(long, value_parser = seconds, requires = "snapshot")]
    every: Option<Duration>,
    /// File to read instead of standard input, starting at the position of the snapshot.
    #[arg(long, conflicts_with = "replay")]
    input: Option<PathBuf>,
    /// Takes lines from connections at unix:PATH or HOST:PORT instead, and answers them there.
    #[arg(long, value_name = "ADDRESS", conflicts_with_all = ["input", "replay"])]
    listen: Option<String>,
    /// Standard input starts over from the very first line: what the snapshot includes is skipped.
    #[arg(long)]
    replay: bool,
    /// File for the answers instead of standard output. What follows the answers counted by the
    /// snapshot is cut off.
    #[arg(long)]
    output: Option<PathBuf>,
    /// Forgets vehicles last seen more than this many units of `time` before the latest update.
    #[arg(long, value_name = "UNITS")]
    forget_after: Option<u64>,
    /// Duration of a step of the model, in units of `time`; by default every update is one step.
    #[arg(long, value_name = "UNITS")]
    step: Option<NonZeroU64>,
    /// Maximum steps of an update with `--step`.
    #[arg(long, default_value = "1000", requires = "step")]
    most_steps: NonZeroU64,
    /// Applies updates in the order of their times if they are at most this many units of `time`
    /// behind the latest; refuses later ones.
    #[arg(long, value_name = "UNITS")]
    lateness: Option<u64>,
    /// Takes as the latest time the largest that this many vehicles have reached, so that one clock
    /// far ahead makes no other vehicle late or forgotten.
    #[arg(long, value_name = "VEHICLES", default_value = "1")]
    agree: NonZeroUsize,
    /// Folder of the models that a line may name.
    #[arg(long)]
    models: Option<PathBuf>,
    /// Address that serves `/metrics` and `/health`, such as 127.0.0.1:9100.
    #[arg(long, value_name = "HOST:PORT")]
    metrics: Option<String>,
    /// Format of the log on standard error.
    #[arg(long, default_value = "text")]
    log: Log,
    /// Memory for vehicles, in bytes, or with K, M or G (powers of 1024); by default unlimited.
    #[arg(long, value_parser = bytes, requires = "spill")]
    memory: Option<usize>,
    /// Folder for vehicles beyond that memory, for one run at a time.
    #[arg(long)]
    spill: Option<PathBuf>,
    /// Threads; by default one per core.
    #[arg(long)]
    threads: Option<usize>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Log {
    /// Warnings and a summary.
    Text,
    /// Everything, as lines of JSON.
    Json,
}

/// Parses a number of seconds.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|error| format!("{error}"))?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

/// Parses a number of bytes.
fn bytes(text: &str) -> Result<usize, String> {
    let (number, unit) = match text.char_indices().last() {
        Some((at, 'K' | 'k')) => (&text[..at], 1 << 10),
        Some((at, 'M' | 'm')) => (&text[..at], 1 << 20),
        Some((at, 'G' | 'g')) => (&text[..at], 1 << 30),
        _ => (text, 1_usize),
    };
    let number: usize = number.parse().map_err(|error| format!("{error}"))?;
    number.checked_mul(unit).ok_or_else(|| "too many bytes".to_owned())
}

impl Live {
    pub(crate) fn run(self) -> Result<String, FleetError> {
        let all = PoolOptions::default();
        let threads = self.threads.unwrap_or(all.threads);
        let job = ServiceJob {
            every: self.every,
            input: self.input,
            listen: self.listen,
            replay: self.replay,
            output: self.output,
            timing: Timing {
                forget_after: self.forget_after,
                step: self.step,
                most_steps: Some(self.most_steps),
                agree: Some(self.agree),
            },
            lateness: self.lateness,
            models: self.models,
            metrics: self.metrics,
            ..ServiceJob::new(LiveJob {
                model: self.model,
                restore: self.restore,
                snapshot: self.snapshot,
                options: PoolOptions { threads, memory: self.memory, spill: self.spill },
            })
        };
        let control = Control::new();
        signals(&control)
            .map_err(|error| FleetError::Settings(format!("cannot handle signals: {error}")))?;
        let is_json = self.log == Log::Json;
        let say = |notice: &Notice| {
            // Standard output is for answers.
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
}

pub(crate) fn show_position(snapshot: &Path) -> Result<String, FleetError> {
    match position(snapshot)? {
        Some(position) => serde_json::to_string(&position)
            .map_err(|error| FleetError::Settings(format!("no position: {error}"))),
        None => Err(FleetError::Settings(format!("{}: has no position", snapshot.display()))),
    }
}
