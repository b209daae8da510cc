//! A routine over files of drives: its settings, progress and outcome.

use std::path::{Path, PathBuf};

use arrow_schema::DataType;
use serde_json::{Value, json};

use crate::input::{ColumnNames, Form};
use crate::model::Model;
use crate::output::{Table, Verb};
use crate::partial::Start;
use crate::properties::Pack;

/// A routine over files of drives.
#[derive(Debug, Clone)]
pub struct Job {
    /// File of the model.
    pub model: PathBuf,
    /// Files of drives, Parquet or CSV; folders of such files, or patterns.
    pub inputs: Vec<PathBuf>,
    /// File of the results, Parquet; or a folder (one that exists, or a name ending in a slash)
    /// that gets one file for each input file.
    pub output: PathBuf,
    /// File (or folder, like the output) for invalid drives, which are then left out; without it,
    /// an invalid drive ends the run.
    pub left_out: Option<PathBuf>,
    /// Names of the columns of the input.
    pub names: ColumnNames,
    /// Routine.
    pub verb: Verb,
    /// Contents of the output.
    pub table: Table,
    /// Form of the output; `None` for the form of the input.
    pub form: Option<Form>,
    /// Minimum rows (steps, if nested) of a part of the output: a row group, kept in memory until
    /// it is complete. An interruption loses only the part under construction.
    pub part: usize,
    /// Compression of the output.
    pub pack: Pack,
    /// Number of threads.
    pub threads: usize,
    /// How to treat existing output.
    pub start: Start,
}

impl Job {
    /// Settings that two runs must share for one to continue the other.
    pub(crate) fn settings(
        &self,
        model: &Model,
        form: Form,
        id_type: &DataType,
        has_names: bool,
    ) -> Value {
        json!({
            // Whatever changes the bytes of the output or the boundaries of its parts. The number
            // of threads does not.
            "version": env!("CARGO_PKG_VERSION"),
            "model": model.hash(),
            "columns": self.names.all(),
            "type of ids": format!("{id_type}"),
            "names of files": has_names,
            "routine": format!("{:?}", self.verb),
            "table": format!("{:?}", self.table),
            "form": format!("{form:?}"),
            "part": self.part,
            "compression": format!("{:?}", self.pack),
        })
    }
}

/// Where the results of some input files go.
#[derive(Clone, Copy)]
pub(crate) struct Target<'a> {
    pub(crate) output: &'a Path,
    pub(crate) left_out: Option<&'a Path>,
    /// True if each row carries the name of its input file.
    pub(crate) has_names: bool,
}

/// Progress of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Input rows done.
    pub rows: u64,
    /// All input rows, if known.
    pub all_rows: Option<u64>,
    /// Drives done.
    pub drives: u64,
}

/// Outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Summary {
    /// Number of drives.
    pub drives: u64,
    /// Number of steps.
    pub steps: u64,
    /// Number of drives that ended with an error.
    pub failed: u64,
    /// Number of invalid drives, which are left out.
    pub left_out: u64,
    /// Number of parts of the output.
    pub parts: usize,
    /// Number of these parts made by an earlier run.
    pub resumed: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// Number of these outputs finished by an earlier run.
    pub finished: usize,
}

impl Summary {
    pub(crate) fn finished([drives, steps, failed, left_out]: [u64; 4]) -> Self {
        Self { drives, steps, failed, left_out, outputs: 1, finished: 1, ..Self::default() }
    }
}
