//! Vehicles as a service: lines from an input, snapshots while it runs, and an end in order.

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

/// A run over lines of JSON that is left alone.
#[derive(Debug, Clone)]
pub struct ServiceJob {
    /// Model, snapshots and memory.
    pub live: LiveJob,
    /// Time between two snapshots, if there is one to be written; none are written before the end
    /// otherwise, unless they are asked for.
    pub every: Option<Duration>,
    /// File that is read instead of the input. A run that goes on from a snapshot begins at its
    /// position.
    pub input: Option<PathBuf>,
    /// Address at which connections are taken, whose lines are the input: `unix:PATH` or
    /// `HOST:PORT`. Each has its answers back.
    pub listen: Option<String>,
    /// True if the input begins again from the first line of all runs: what the snapshot has is
    /// skipped.
    pub replay: bool,
    /// File for the answers. A run that goes on from a snapshot cuts off what follows its answers.
    pub output: Option<PathBuf>,
    /// What the time of updates does.
    pub timing: Timing,
    /// Updates are taken in the order of their times, if they are no more than this behind the
    /// latest time; those that are later are refused. In the order of their lines otherwise.
    pub lateness: Option<u64>,
    /// Folder of the models that a line may name.
    pub models: Option<PathBuf>,
    /// Address at which there are figures, as `127.0.0.1:9100`.
    pub metrics: Option<String>,
}

impl ServiceJob {
    /// Creates a run with none of the options.
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
