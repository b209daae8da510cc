//! Models, drives and files.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
#[cfg(target_os = "linux")]
use std::process::{Command, Stdio};
use std::sync::Arc;
#[cfg(target_os = "linux")]
use std::{thread, time::Duration};

use arrow::array::{
    Array, ArrayRef, AsArray, Float64Array, Int64Array, ListArray, RecordBatch, StringArray,
    StructArray, UInt32Array,
};
use arrow::buffer::OffsetBuffer;
use arrow::compute::concat_batches;
use arrow::datatypes::{DataType, Field, Float64Type, Int64Type, Schema, UInt32Type};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::file::properties::WriterProperties;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use tempfile::TempDir;
use wayfix::inference::{LearnedModel, LearningOptions};
use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
use wayfix_fleet::input::ColumnNames;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{Course, FleetError, Job, LearnJob, Pack, Start, Summary, run};

/// Number of states of the models.
pub(crate) const STATES: usize = 11;
/// A symbol that is only seen in state 0.
pub(crate) const RARE: u32 = 5;

pub(crate) type Drives = Vec<Vec<u32>>;
pub(crate) type Model = Hmm<SparseTransition, TableLikelihood>;

pub(crate) fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A ring with random moves ahead; place 0 is left at once and for good.
pub(crate) fn transition(rng: &mut ChaCha8Rng) -> SparseTransition {
    let mut entries = Vec::new();
    for from in 0..STATES {
        let stay = if from == 0 { 0.0 } else { rng.random_range(0.1..0.8) };
        let next = if from + 1 == STATES { 1 } else { from + 1 };
        entries.extend([(from, from, stay), (next, from, 1.0 - stay)]);
    }
    SparseTransition::from_triplets(STATES, entries).unwrap()
}

pub(crate) fn prior() -> Prior {
    Prior::AtFirstObservation(Belief::uniform(STATES).unwrap())
}

/// A model of six symbols.
pub(crate) fn model(seed: u64) -> Hmm<SparseTransition, TableLikelihood> {
    let mut rng = rng(seed);
    let transition = transition(&mut rng);
    let rows: Vec<Vec<f64>> = (0..STATES)
        .map(|state| {
            let mut row: Vec<f64> = (0..6).map(|_| rng.random_range(0.05..1.0)).collect();
            if state > 0 {
                row[RARE as usize] = 0.0;
            }
            let sum: f64 = row.iter().sum();
            row.iter().map(|p| p / sum).collect()
        })
        .collect();
    Hmm::new(prior(), transition, TableLikelihood::from_rows(&rows).unwrap()).unwrap()
}

/// Drives of up to `most` steps, in some of which a rare symbol makes the rest impossible.
pub(crate) fn drives(seed: u64, count: usize, least: usize, most: usize) -> Drives {
    let mut rng = rng(seed);
    let drive = |_| {
        let length = rng.random_range(least..=most);
        let rare = rng.random_bool(0.2);
        (0..length).map(|_| rng.random_range(0..if rare { 6 } else { 5 })).collect()
    };
    (0..count).map(drive).collect()
}

/// Step of a drive in the long form: they need not be 1, 2, …
pub(crate) fn step(index: usize) -> i64 {
    10 * index as i64 + 3
}

pub(crate) fn nested(drives: &[Vec<u32>]) -> RecordBatch {
    let item = Arc::new(Field::new_list_field(DataType::UInt32, false));
    let symbols = UInt32Array::from(drives.concat());
    let offsets = OffsetBuffer::from_lengths(drives.iter().map(Vec::len));
    let lists = ListArray::try_new(item, offsets, Arc::new(symbols), None).unwrap();
    let ids = (0..drives.len()).map(|drive| Some(format!("drive {drive:05}")));
    let columns: [(&str, ArrayRef); 2] =
        [("trace_id", Arc::new(ids.collect::<StringArray>())), ("observation", Arc::new(lists))];
    RecordBatch::try_from_iter(columns).unwrap()
}

pub(crate) fn long(drives: &[Vec<u32>]) -> RecordBatch {
    let rows = || {
        let of = |(drive, symbols): (usize, &Vec<u32>)| {
            symbols.iter().enumerate().map(|(k, &s)| (drive, k, s)).collect::<Vec<_>>()
        };
        drives.iter().enumerate().flat_map(of)
    };
    let columns: [(&str, ArrayRef); 3] = [
        ("trace_id", Arc::new(Int64Array::from_iter_values(rows().map(|row| row.0 as i64)))),
        ("step", Arc::new(Int64Array::from_iter_values(rows().map(|row| step(row.1))))),
        ("observation", Arc::new(UInt32Array::from_iter_values(rows().map(|row| row.2)))),
    ];
    RecordBatch::try_from_iter(columns).unwrap()
}

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

    /// Writes rows as Parquet, in row groups of so many.
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

    /// Runs in vain, and returns the error.
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

/// Runs, if need be again: commands that other tests start hold the locks of this process for the
/// moment until they are loaded.
pub(crate) fn go_on(job: &Job) -> Result<Summary, FleetError> {
    loop {
        match run(job, |_| {}) {
            Err(error) if error.to_string().contains("another run has locked") => {}
            done => return done,
        }
    }
}

/// Reads a Parquet file.
pub(crate) fn read(path: &Path) -> RecordBatch {
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    // Without what the file says of its run.
    let schema = Arc::new(Schema::new(builder.schema().fields().clone()));
    let batches: Vec<RecordBatch> = builder.build().unwrap().map(Result::unwrap).collect();
    concat_batches(&schema, &batches).unwrap()
}

pub(crate) fn numbers(rows: &RecordBatch, name: &str) -> Vec<Option<f64>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_primitive::<Float64Type>().iter().collect()
}

pub(crate) fn integers(rows: &RecordBatch, name: &str) -> Vec<Option<i64>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_primitive::<Int64Type>().iter().collect()
}

pub(crate) fn states(rows: &RecordBatch, name: &str) -> Vec<Option<u32>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_primitive::<UInt32Type>().iter().collect()
}

pub(crate) fn texts(rows: &RecordBatch, name: &str) -> Vec<Option<String>> {
    let column = rows.column_by_name(name).unwrap();
    column.as_string::<i32>().iter().map(|text| text.map(str::to_owned)).collect()
}

/// Fields of the lists of a nested table, and the first element of each list.
pub(crate) fn items(rows: &RecordBatch, name: &str) -> (Vec<usize>, RecordBatch) {
    let lists = rows.column_by_name(name).unwrap().as_list::<i32>();
    let offsets = lists.value_offsets().iter().map(|&offset| offset as usize).collect();
    (offsets, RecordBatch::from(lists.values().as_struct()))
}

pub(crate) fn close(found: f64, expected: f64) {
    let tolerance = 1e-12 * expected.abs().max(1.0);
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
}

/// Ten iterations of learning from a file of the folder.
pub(crate) fn learn_job(folder: &Folder, input: &str, output: &str, threads: usize) -> LearnJob {
    LearnJob {
        model: folder.path("model.json"),
        input: folder.path(input),
        output: folder.path(output),
        names: ColumnNames::default(),
        iterations: 10,
        tolerance: 0.0,
        keep_prior: false,
        threads,
        start: Start::default(),
    }
}

/// Ten iterations of the library.
pub(crate) fn learned(
    model: &Model,
    drives: &Drives,
) -> LearnedModel<SparseTransition, TableLikelihood> {
    let seen: Vec<Vec<usize>> =
        drives.iter().map(|drive| drive.iter().map(|&symbol| symbol as usize).collect()).collect();
    let options = LearningOptions { iterations: 10, tolerance: 0.0, ..LearningOptions::default() };
    model.learn(&seen, &options).unwrap()
}

/// Compares the course of learning and its model with those of the library.
pub(crate) fn assert_learned(
    job: &LearnJob,
    course: &Course,
    expected: &LearnedModel<SparseTransition, TableLikelihood>,
) {
    assert_eq!(course.left_out, expected.left_out().len() as u64);
    assert_eq!(course.log_likelihoods.len(), 11);
    for (found, expected) in course.log_likelihoods.iter().zip(expected.objectives()) {
        assert!((found - expected).abs() < 1e-9 * expected.abs(), "{found}, {expected}");
    }
    let learned: Model = serde_json::from_slice(&fs::read(&job.output).unwrap()).unwrap();
    let near = |found: f64, expected: f64| {
        assert!((found - expected).abs() < 1e-9, "{found}, expected {expected}");
    };
    let expected = expected.model();
    for i in 0..STATES {
        near(learned.prior().belief().as_slice()[i], expected.prior().belief().as_slice()[i]);
        for j in 0..STATES {
            near(learned.transition().get(i, j), expected.transition().get(i, j));
        }
        for symbol in 0..6 {
            let p = |hmm: &Model| hmm.likelihood().probability(i, symbol).unwrap();
            near(p(&learned), p(expected));
        }
    }
}

/// Lists of states with their likelihoods.
pub(crate) fn lists_of_pairs<'a>(
    lists: impl Iterator<Item = &'a [(usize, f64)]> + Clone,
) -> ListArray {
    let all = || lists.clone().flatten();
    let states = Int64Array::from_iter_values(all().map(|(state, _)| *state as i64));
    let likelihoods = Float64Array::from_iter_values(all().map(|(_, p)| *p));
    let pairs = StructArray::from(vec![
        (Arc::new(Field::new("state", DataType::Int64, false)), Arc::new(states) as ArrayRef),
        (Arc::new(Field::new("likelihood", DataType::Float64, false)), Arc::new(likelihoods)),
    ]);
    let item = Arc::new(Field::new_list_field(pairs.data_type().clone(), false));
    let offsets = OffsetBuffer::from_lengths(lists.map(<[_]>::len));
    ListArray::try_new(item, offsets, Arc::new(pairs), None).unwrap()
}

/// Largest memory of a command, in bytes.
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
