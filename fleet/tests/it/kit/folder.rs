//! Folders with a model and inputs, and runs on them.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
#[cfg(target_os = "linux")]
use std::process::{Command, Stdio};
use std::sync::Arc;
#[cfg(target_os = "linux")]
use std::{thread, time::Duration};

use arrow::array::RecordBatch;
use arrow::compute::concat_batches;
use arrow::datatypes::Schema;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::file::properties::WriterProperties;
use tempfile::TempDir;
use wayfix_fleet::input::ColumnNames;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{FleetError, Job, Pack, Start, Summary, run};

/// A folder with a model and an input.
pub(crate) struct Folder {
    pub(crate) dir: TempDir,
}

impl Folder {
    pub(crate) fn new(model: &impl serde::Serialize) -> Self {
        let folder = Self { dir: TempDir::new().unwrap() };
        fs::write(folder.path("model.json"), serde_json::to_vec(model).unwrap()).unwrap();
        folder
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Writes rows as Parquet, in row groups of a given size.
    pub(crate) fn write(&self, name: &str, rows: &RecordBatch, group: usize) {
        let properties =
            WriterProperties::builder().set_max_row_group_row_count(Some(group)).build();
        let file = File::create(self.path(name)).unwrap();
        let mut writer = ArrowWriter::try_new(file, rows.schema(), Some(properties)).unwrap();
        writer.write(rows).unwrap();
        writer.close().unwrap();
    }

    /// A run on `input` with small parts.
    pub(crate) fn job(&self, input: &str, output: &str, verb: Verb, table: Table) -> Job {
        Job {
            model: self.path("model.json"),
            inputs: vec![self.path(input)],
            output: self.path(output),
            left_out: None,
            names: ColumnNames::default(),
            verb,
            table,
            form: None,
            part: 300,
            pack: Pack::None,
            threads: 2,
            start: Start::default(),
        }
    }

    /// Runs on an input, and returns the results.
    pub(crate) fn results(&self, job: &Job) -> (Summary, RecordBatch) {
        let summary = go_on(job).unwrap();
        assert!(!self.has_leftovers());
        (summary, read(&job.output))
    }

    /// Runs, expects an error, and returns it.
    pub(crate) fn error(&self, input: &str) -> FleetError {
        let job = self.job(input, "none.parquet", Verb::Smooth, Table::Steps);
        let error = run(&job, |_| {}).unwrap_err();
        assert!(!job.output.exists());
        error
    }

    /// True if there are files of an unfinished run.
    pub(crate) fn has_leftovers(&self) -> bool {
        let names = fs::read_dir(self.dir.path()).unwrap().map(|entry| entry.unwrap().path());
        names.into_iter().any(|name| {
            name.extension().is_some_and(|ending| ending == "partial" || ending == "journal")
        })
    }
}

/// Runs, repeatedly if need be: commands started by other tests inherit the locks of this process
/// until they have been loaded.
pub(crate) fn go_on(job: &Job) -> Result<Summary, FleetError> {
    loop {
        match run(job, |_| {}) {
            Err(error) if error.to_string().contains("another run holds the lock on") => {}
            done => return done,
        }
    }
}

/// Reads a Parquet file.
pub(crate) fn read(path: &Path) -> RecordBatch {
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    // Without the record of the run in the file.
    let schema = Arc::new(Schema::new(builder.schema().fields().clone()));
    let batches: Vec<RecordBatch> = builder.build().unwrap().map(Result::unwrap).collect();
    concat_batches(&schema, &batches).unwrap()
}

/// Peak memory of a command, in bytes.
#[cfg(target_os = "linux")]
pub(crate) fn peak_memory(command: &mut Command) -> u64 {
    let mut child = command.stdout(Stdio::null()).spawn().unwrap();
    let mut most = 0;
    let status = format!("/proc/{}/status", child.id());
    while child.try_wait().unwrap().is_none() {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        most = most.max(kilobytes.unwrap_or(0) * 1024);
        thread::sleep(Duration::from_millis(2));
    }
    assert!(child.wait().unwrap().success());
    most
}
