//! Options shared by all commands over files of drives.

use std::path::PathBuf;
use std::thread;

use clap::Args;
use wayfix_fleet::Start;
use wayfix_fleet::input::ColumnNames;

/// Input, output, column names, and how to treat existing output.
#[derive(Debug, Args)]
pub(crate) struct Files {
    /// Model, the JSON of a wayfix `Hmm`.
    #[arg(long)]
    pub(crate) model: PathBuf,
    /// Drives: a CSV file by its name, else a Parquet file; a folder of files, or a pattern in
    /// quotes. May be repeated, except for learn.
    #[arg(long, required = true)]
    pub(crate) input: Vec<PathBuf>,
    /// Results; a folder for one file of results per input file.
    #[arg(long)]
    pub(crate) output: PathBuf,
    /// Column of the drive id.
    #[arg(long, default_value = "trace_id")]
    pub(crate) trace_id: String,
    /// Column of the step.
    #[arg(long, default_value = "step")]
    pub(crate) step: String,
    /// Column of the observation.
    #[arg(long, default_value = "observation")]
    pub(crate) observation: String,
    /// Column of the likelihood of states that a sparse list does not name.
    #[arg(long, default_value = "elsewhere")]
    pub(crate) elsewhere: String,
    /// Columns of positions.
    #[arg(long, num_args = 3, value_names = ["LATITUDE", "LONGITUDE", "DEVIATION"],
        default_values = ["latitude", "longitude", "deviation"])]
    pub(crate) position: Vec<String>,
    /// Threads; by default one per core.
    #[arg(long)]
    pub(crate) threads: Option<usize>,
    /// Replaces an existing output.
    #[arg(long)]
    pub(crate) force: bool,
    /// Starts over if an earlier run was interrupted.
    #[arg(long)]
    pub(crate) restart: bool,
    /// Shows no progress.
    #[arg(long)]
    pub(crate) quiet: bool,
}

impl Files {
    pub(crate) fn names(&self) -> ColumnNames {
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

    pub(crate) fn start(&self) -> Start {
        Start { force: self.force, restart: self.restart }
    }

    pub(crate) fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| thread::available_parallelism().map_or(1, Into::into))
    }
}
