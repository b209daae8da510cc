//! A routine over files of drives: its settings, its state and its outcome.

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
    /// Files of the drives, Parquet or CSV; folders of such files, or patterns.
    pub inputs: Vec<PathBuf>,
    /// File of the results, Parquet; or a folder, which exists or whose name ends with a slash,
    /// for a file for each one of the input.
    pub output: PathBuf,
    /// File (or folder, like the output) for drives that are no valid input; without it these end
    /// the run.
    pub left_out: Option<PathBuf>,
    /// Names of the columns of the input.
    pub names: ColumnNames,
    /// Routine.
    pub verb: Verb,
    /// Content of the output.
    pub table: Table,
    /// Form of the output; `None` for that of the input.
    pub form: Option<Form>,
    /// Rows of a part of the output (steps, if it is nested), at least: a row group, which an
    /// interruption loses if it is not complete. It is kept in memory.
    pub part: usize,
    /// Compression of the output.
    pub pack: Pack,
    /// Number of threads.
    pub threads: usize,
    /// Way to begin.
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

/// Files of the results of some files.
#[derive(Clone, Copy)]
pub(crate) struct Target<'a> {
    pub(crate) output: &'a Path,
    pub(crate) left_out: Option<&'a Path>,
    /// True if rows have the name of the file that they come from.
    pub(crate) has_names: bool,
}

/// State of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Rows of the input that are done.
    pub rows: u64,
    /// Rows of the input, if they are known.
    pub all_rows: Option<u64>,
    /// Drives that are done.
    pub drives: u64,
}

/// Outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Summary {
    /// Number of drives.
    pub drives: u64,
    /// Number of steps.
    pub steps: u64,
    /// Number of drives that have an error.
    pub failed: u64,
    /// Number of drives that were no valid input, and are left out.
    pub left_out: u64,
    /// Number of parts of the output.
    pub parts: usize,
    /// Number of these parts that were made by an earlier run.
    pub resumed: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// Number of these outputs that an earlier run has finished.
    pub finished: usize,
}

impl Summary {
    pub(crate) fn finished([drives, steps, failed, left_out]: [u64; 4]) -> Self {
        Self { drives, steps, failed, left_out, outputs: 1, finished: 1, ..Self::default() }
    }
}
