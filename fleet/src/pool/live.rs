//! The function behind the command `live` in its simplest form: updates as lines of JSON, answered
//! by such lines.

use std::io::{Read, Write};
use std::path::PathBuf;

use super::PoolOptions;
use super::service::{Control, Notice, ServiceJob, serve};
use crate::error::{FleetError, Outcome};

/// Settings of a run over lines of JSON.
#[derive(Debug, Clone)]
pub struct LiveJob {
    /// File of the model.
    pub model: PathBuf,
    /// Snapshot to start from. If the same file is also the snapshot of the end, and does not exist
    /// yet, the run starts without vehicles.
    pub restore: Option<PathBuf>,
    /// File for the snapshot at the end.
    pub snapshot: Option<PathBuf>,
    /// Threads and memory.
    pub options: PoolOptions,
}

/// Summary of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LiveSummary {
    /// Number of lines.
    pub lines: u64,
    /// Number of lines answered with an error.
    pub errors: u64,
    /// Number of vehicles in the pool at the end.
    pub vehicles: usize,
    /// Bytes of the snapshot, if one was written.
    pub snapshot: Option<u64>,
}

/// Answers every line of the input with a line, in order, until the input ends; then writes the
/// snapshot. Lines that are available are processed together, and answered without waiting for
/// more. [`serve`] does more.
///
/// `warn` is called if vehicles beyond the memory limit cannot be moved to disk, and stay in
/// memory.
///
/// # Errors
///
/// [`FleetError`] if the model, the snapshot or the input cannot be read, or the output or the
/// final snapshot cannot be written. A bad line is not an error.
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
