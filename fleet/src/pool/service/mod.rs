//! Vehicles as a service: lines from an input or from connections, periodic snapshots, and an
//! orderly end.
//!
//! One thread runs everything that has state ([`run`]). Other threads only move bytes: they read
//! inputs into a queue of events ([`input`], [`listen`]) and send answers from an [`outbox`]. A
//! snapshot stores the [`position`] in the input along with the vehicles, so that a restarted
//! service takes each line exactly once.

mod connections;
mod control;
mod input;
mod listen;
mod metrics;
mod notice;
mod order;
mod outbox;
mod position;
mod run;
mod seats;
mod vehicles;
mod work;

use std::path::PathBuf;
use std::time::Duration;

pub use control::{Control, signals};
pub use notice::Notice;
pub use position::{Position, position};
pub use run::serve;

use super::{LiveJob, Timing};

/// Settings of an unattended run over lines of JSON.
#[derive(Debug, Clone)]
pub struct ServiceJob {
    /// Model, snapshots and memory.
    pub live: LiveJob,
    /// Time between two snapshots, if there is anything new to save. Without it, snapshots are only
    /// written at the end, or on request.
    pub every: Option<Duration>,
    /// File to read instead of the input. A run that continues from a snapshot starts at its
    /// position.
    pub input: Option<PathBuf>,
    /// Address at which to accept connections, whose lines are the input: `unix:PATH` or
    /// `HOST:PORT`. Each receives the answers to its own lines.
    pub listen: Option<String>,
    /// True if the input starts over from the first line of all runs: what the snapshot includes is
    /// skipped.
    pub replay: bool,
    /// File for the answers. A run that continues from a snapshot cuts off whatever follows the
    /// answers that it counts.
    pub output: Option<PathBuf>,
    /// Effects of the time of updates.
    pub timing: Timing,
    /// Updates are applied in the order of their times, provided they are at most this far behind
    /// the latest time; later ones are refused. Without it, they are applied in the order of their
    /// lines.
    pub lateness: Option<u64>,
    /// Folder of the models that a line may name.
    pub models: Option<PathBuf>,
    /// Address that serves metrics, such as `127.0.0.1:9100`.
    pub metrics: Option<String>,
}

impl ServiceJob {
    /// Creates settings without any of the options.
    #[must_use]
    pub fn new(live: LiveJob) -> Self {
        Self {
            live,
            every: None,
            input: None,
            listen: None,
            replay: false,
            output: None,
            timing: Timing::default(),
            lateness: None,
            models: None,
            metrics: None,
        }
    }
}
