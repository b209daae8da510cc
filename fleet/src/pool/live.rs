//! The command `live`: updates as lines of JSON, and answers as such lines.

use std::io::{Read, Write};
use std::path::PathBuf;

use super::PoolOptions;
use super::service::{Control, Notice, ServiceJob, serve};
use crate::error::{FleetError, Outcome};

/// A run over lines of JSON.
#[derive(Debug, Clone)]
pub struct LiveJob {
    /// Model, a file.
    pub model: PathBuf,
    /// Snapshot to begin with. If it is also that at the end, and not there yet, there are no
    /// vehicles at first.
    pub restore: Option<PathBuf>,
    /// File for the snapshot at the end.
    pub snapshot: Option<PathBuf>,
    /// Threads and memory.
    pub options: PoolOptions,
}

/// What a run has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LiveSummary {
    /// Number of lines.
    pub lines: u64,
    /// Number of lines that were answered with an error.
    pub errors: u64,
    /// Number of vehicles in the pool at the end.
    pub vehicles: usize,
    /// Bytes of the snapshot, if there is one.
    pub snapshot: Option<u64>,
}

/// Answers every line of the input with a line, in order, until the input ends; then writes the
/// snapshot. Lines that have come are worked on together, and answered without waiting for more.
/// [`serve`] does more.
///
/// `warn` is told that vehicles beyond the limit of memory cannot be moved to the disk, and stay
/// in memory.
///
/// # Errors
///
/// [`FleetError`] if the model or the snapshot cannot be read, the input cannot be read, the output
/// or the snapshot at the end cannot be written. A bad line is none.
pub fn live(
    job: &LiveJob,
    input: impl Read + Send + 'static,
    output: impl Write,
    mut warn: impl FnMut(&FleetError),
) -> Outcome<LiveSummary> {
    serve(&ServiceJob::new(job.clone()), &Control::new(), input, output, |notice| {
        if let Notice::Spill(error) = notice {
            warn(error);
        }
    })
}
