//! Results from objects equal those from files.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::thread;

use parquet::file::reader::{FileReader, SerializedFileReader};
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{FleetError, Job, learn, run};

use crate::kit::*;
use crate::shelf::Shelf;

/// Files of three kinds, in a folder and in a store, with the bytes of their results.
fn prepare() -> (Folder, Shelf, Vec<(&'static str, Vec<u8>)>) {
    let folder = Folder::new(&model(3));
    let drives = drives(33, 2000, 1, 40);
    folder.write("long.parquet", &long(&drives), 1500);
    folder.write("nested.parquet", &nested(&drives), 50);
    let mut text = String::from("trace_id,step,observation\n");
    for (id, drive) in drives.iter().enumerate() {
        for (k, symbol) in drive.iter().enumerate() {
            writeln!(text, "{id:04},{},{symbol}", step(k)).unwrap();
        }
    }
    fs::write(folder.path("drives.csv"), text).unwrap();
    let shelf = Shelf::new();
    shelf.copy(&folder, "model.json");
    let expected = ["long.parquet", "nested.parquet", "drives.csv"].map(|name| {
        shelf.copy(&folder, name);
        let job = folder.job(name, &format!("{name}.expected"), Verb::Smooth, Table::Steps);
        assert!(run(&job, |_| {}).unwrap().parts > 1);
        (name, fs::read(&job.output).unwrap())
    });
    (folder, shelf, expected.to_vec())
}

fn job(folder: &Folder, shelf: &Shelf, name: &str) -> Job {
    let mut job = folder.job(name, &format!("{name}.out"), Verb::Smooth, Table::Steps);
    job.inputs = vec![PathBuf::from(format!("{shelf}{name}"))];
    job.model = PathBuf::from(format!("{shelf}model.json"));
    job
}

#[test]
fn to_the_byte_also_after_an_interruption() {
    let (folder, shelf, expected) = prepare();
    for (name, expected) in &expected {
        let mut job = job(&folder, &shelf, name);
        go_on(&job).unwrap();
        assert!(fs::read(&job.output).unwrap() == *expected, "{name}");
        assert_eq!(go_on(&job).unwrap().finished, 1);
        // A file with the same contents is the same input.
        job.inputs = vec![folder.path(name)];
        assert_eq!(go_on(&job).unwrap().finished, 1);
        fs::remove_file(&job.output).unwrap();

        job.inputs = vec![PathBuf::from(format!("{shelf}{name}"))];
        let stopped = job.clone();
        let stopped =
            thread::spawn(move || run(&stopped, |done| assert!(done.drives < 1000, "interrupted")));
        assert!(stopped.join().is_err());
        assert!(go_on(&job).unwrap().resumed > 0, "{name}");
        assert!(fs::read(&job.output).unwrap() == *expected, "{name}");
    }
}

#[test]
fn learning_is_the_same() {
    let (folder, shelf, _) = prepare();
    for name in ["long.parquet", "drives.csv"] {
        let file = learn_job(&folder, name, "file.json", 2);
        let mut object = learn_job(&folder, name, "object.json", 2);
        object.input = PathBuf::from(format!("{shelf}{name}"));
        object.model = PathBuf::from(format!("{shelf}model.json"));
        assert_eq!(learn(&file, |_, _| {}).unwrap(), learn(&object, |_, _| {}).unwrap());
        assert!(fs::read(&file.output).unwrap() == fs::read(&object.output).unwrap());
        fs::remove_file(&file.output).unwrap();
        fs::remove_file(&object.output).unwrap();
    }
}

/// Required columns are fetched once, others never.
#[test]
fn no_byte_of_a_column_comes_twice() {
    let (folder, shelf, _) = prepare();
    // With a column that no routine reads.
    let some = long(&drives(33, 2000, 1, 40));
    let mut columns: Vec<(String, _)> = Vec::new();
    for (field, column) in some.schema().fields().iter().zip(some.columns()) {
        columns.push((field.name().clone(), column.clone()));
        columns.push((format!("not {}", field.name()), column.clone()));
    }
    let rows = arrow::array::RecordBatch::try_from_iter(columns).unwrap();
    folder.write("long.parquet", &rows, 7000);
    shelf.copy(&folder, "long.parquet");
    shelf.read.lock().unwrap().clear();
    go_on(&job(&folder, &shelf, "long.parquet")).unwrap();

    let file = fs::File::open(folder.path("long.parquet")).unwrap();
    let file = SerializedFileReader::new(file).unwrap();
    let mut times = vec![0; fs::metadata(folder.path("long.parquet")).unwrap().len() as usize];
    for (name, range) in shelf.read.lock().unwrap().iter() {
        if name == "long.parquet" {
            times[range.start as usize..range.end as usize].iter_mut().for_each(|n| *n += 1);
        }
    }
    assert!(file.metadata().num_row_groups() > 3);
    for group in file.metadata().row_groups() {
        for column in group.columns() {
            let (start, length) = column.byte_range();
            let wanted = usize::from(!column.column_path().string().starts_with("not "));
            let found = &times[start as usize..(start + length) as usize];
            assert!(found.iter().all(|times| *times == wanted), "{}", column.column_path());
        }
    }
}

#[test]
fn an_object_that_is_replaced_is_noticed() {
    let (folder, shelf, expected) = prepare();
    let others = drives(34, 2000, 1, 40);
    folder.write("others.parquet", &long(&others), 1500);
    let others = fs::read(folder.path("others.parquet")).unwrap();
    for (name, expected) in &expected[..2] {
        let mut job = job(&folder, &shelf, name);
        let bytes = fs::read(folder.path(name)).unwrap();
        // While it is read, even by the same bytes: the tag differs.
        for other in [&others, &bytes] {
            let mut is_replaced = false;
            job.start.restart = true;
            let done = run(&job, |done| {
                if done.rows > 0 && !is_replaced {
                    is_replaced = true;
                    shelf.put(name, other.clone());
                }
            });
            let error = done.unwrap_err();
            assert!(matches!(error, FleetError::Changed { .. }), "{error:?}");
            let said = format!("{shelf}{name}: was written to while it was read");
            assert_eq!(error.to_string(), said);
            shelf.put(name, bytes.clone());
        }
        job.start.restart = false;
        // Between two runs: changed contents are refused, the same contents continue.
        assert!(folder.has_leftovers());
        let mut other = bytes.clone();
        other[30] ^= 1;
        shelf.put(name, other);
        let error = go_on(&job).unwrap_err().to_string();
        assert!(error.contains(&format!("{shelf}{name}: row group 0 (rows 0 to ")), "{error}");
        shelf.put(name, bytes);
        assert!(go_on(&job).unwrap().resumed > 0);
        assert!(fs::read(&job.output).unwrap() == *expected);
    }
}

/// The command with a URL of the local file system, and its memory.
#[test]
#[cfg(target_os = "linux")]
fn memory_is_flat() {
    let folder = Folder::new(&model(2));
    let some = drives(22, 30_000, 40, 60);
    folder.write("few.parquet", &nested(&some[..15_000]), 4000);
    let many: Drives = some.iter().cycle().take(120_000).cloned().collect();
    folder.write("many.parquet", &nested(&many), 4000);
    let peak = |input: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
        command.args(["smooth", "--quiet", "--threads", "2", "--part", "50000"]);
        command.arg("--model").arg(format!("file://{}", folder.path("model.json").display()));
        command.arg("--input").arg(format!("file://{}", folder.path(input).display()));
        command.arg("--output").arg(folder.path(&format!("{input}.out")));
        peak_memory(&mut command)
    };
    let (few, many) = (peak("few.parquet"), peak("many.parquet"));
    // Buffers of the object store and of the allocator vary by some 30 MB from run to run; to hold
    // the results in memory would take as much again as their file.
    let results = fs::metadata(folder.path("many.parquet.out")).unwrap().len();
    assert!(results > 80 << 20, "{results} bytes are too few to show in the peak");
    assert!(few > 5 << 20 && many < few + results * 2 / 3, "{few} bytes, then {many}");
    let job = folder.job("many.parquet", "many.file.out", Verb::Smooth, Table::Steps);
    let job = Job { part: 50_000, ..job };
    run(&job, |_| {}).unwrap();
    let object = fs::read(folder.path("many.parquet.out")).unwrap();
    assert!(object == fs::read(&job.output).unwrap());
}
