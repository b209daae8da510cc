//! Inputs of many files.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::Instant;

use arrow::array::{Array, ArrayRef, AsArray, Int64Array, RecordBatch, StringArray};
use arrow::compute::cast;
use arrow::datatypes::DataType;
use rand::RngExt;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{Job, run};

use crate::kit::*;

/// A folder of a few days with some drives each, and files that other tools write beside them.
fn days(folder: &Folder) -> Vec<(&'static str, Drives)> {
    let files = [
        ("days/day=1/part-0.parquet", 50),
        ("days/day=1/part-1.parquet", 1),
        ("days/day=10/part-0.parquet", 40),
        ("days/day=2/part-0.parquet", 0),
        ("days/day=2/part-1.parquet", 60),
    ];
    for day in ["day=1", "day=10", "day=2"] {
        fs::create_dir_all(folder.path("days").join(day)).unwrap();
    }
    for name in ["_SUCCESS", "_metadata", ".part-0.crc", "day=1/.hidden.parquet"] {
        fs::write(folder.path("days").join(name), "no drives").unwrap();
    }
    let all = files.into_iter().enumerate().map(|(seed, (name, count))| {
        let drives = drives(seed as u64, count, 1, 40);
        folder.write(name, &nested(&drives), 16);
        (name, drives)
    });
    all.collect()
}

fn job(folder: &Folder, inputs: &[&str], output: &str) -> Job {
    let mut job = folder.job("", output, Verb::Smooth, Table::Steps);
    job.inputs = inputs.iter().map(|input| folder.path(input)).collect();
    job
}

fn files_of(rows: &RecordBatch) -> Vec<String> {
    let column = rows.column_by_name("file").unwrap();
    assert!(matches!(column.data_type(), DataType::Dictionary(..)), "{}", column.data_type());
    let text = cast(column, &DataType::Utf8).unwrap();
    text.as_string::<i32>().iter().map(|text| text.unwrap().to_owned()).collect()
}

#[test]
fn a_folder_a_pattern_and_a_list_are_the_same() {
    let folder = Folder::new(&model(1));
    let days = days(&folder);
    let (_, expected) = folder.results(&job(&folder, &["days"], "folder.parquet"));
    let files = files_of(&expected);
    let ids = texts(&expected, "trace_id");
    let mut at = 0;
    for (name, drives) in &days {
        for drive in 0..drives.len() {
            assert_eq!(files[at], folder.path(name).to_str().unwrap());
            assert_eq!(ids[at], Some(format!("drive {drive:05}")));
            at += 1;
        }
    }
    assert_eq!(at, files.len());
    let lists: Vec<&str> = days.iter().map(|(name, _)| *name).collect();
    let found = [
        folder.results(&job(&folder, &["days/*/*.parquet"], "a.parquet")),
        folder.results(&job(&folder, &["days/day=*"], "b.parquet")),
        folder.results(&job(&folder, &lists, "c.parquet")),
        folder.results(&job(
            &folder,
            &["days/day=1", "days/day=10", lists[3], lists[4]],
            "d.parquet",
        )),
    ];
    for (summary, rows) in found {
        assert_eq!(summary.drives, 151);
        assert_eq!(rows, expected);
    }
    // One at a time, they have the same results without the column for the file.
    for (number, (name, drives)) in days.iter().enumerate() {
        let (_, rows) = folder.results(&job(&folder, &[name], &format!("{number}.parquet")));
        let before = days[..number].iter().map(|(_, drives)| drives.len()).sum();
        assert_eq!(
            rows,
            expected.slice(before, drives.len()).project(&[1, 2, 3, 4, 5, 6]).unwrap()
        );
    }
}

#[test]
fn a_file_of_results_for_each_file() {
    let folder = Folder::new(&model(1));
    let days = days(&folder);
    fs::write(folder.path("days/day=2/more.csv"), "trace_id,step,observation\na,1,0\n").unwrap();
    let job = job(&folder, &["days"], "results/");
    let summary = go_on(&job).unwrap();
    assert_eq!((summary.outputs, summary.finished, summary.drives), (6, 0, 152));
    for (name, _) in &days {
        let one = format!("{}.one", name.replace('/', "-"));
        let one = folder.job(name, &one, Verb::Smooth, Table::Steps);
        run(&one, |_| {}).unwrap();
        let name = name.strip_prefix("days/").unwrap();
        let found = fs::read(folder.path("results").join(name)).unwrap();
        assert!(found == fs::read(&one.output).unwrap(), "{name}");
    }
    assert_eq!(read(&folder.path("results/day=2/more.csv.parquet")).num_rows(), 1);
    // Again, with one more file.
    assert_eq!(go_on(&job).unwrap().finished, 6);
    folder.write("days/day=3.parquet", &nested(&drives(7, 5, 1, 9)), 10);
    let summary = go_on(&job).unwrap();
    assert_eq!((summary.outputs, summary.finished, summary.drives), (7, 6, 157));
}

#[test]
fn columns_may_come_and_must_not_go() {
    let folder = Folder::new(&model(1));
    fs::create_dir(folder.path("days")).unwrap();
    let some = long(&drives(1, 20, 1, 9));
    folder.write("days/1.parquet", &some, 50);
    let mut columns: Vec<(&str, ArrayRef)> =
        vec![("speed", Arc::new(Int64Array::from(vec![1; some.num_rows()])))];
    let schema = some.schema();
    let names = schema.fields().iter().map(|field| field.name().as_str());
    columns.extend(names.zip(some.columns().iter().cloned()));
    folder.write("days/2.parquet", &RecordBatch::try_from_iter(columns).unwrap(), 50);
    let job = job(&folder, &["days"], "out.parquet");
    let (summary, _) = folder.results(&job);
    assert_eq!((summary.drives, summary.steps), (40, 2 * some.num_rows() as u64));

    fs::remove_file(&job.output).unwrap();
    folder.write("days/3.parquet", &some.project(&[0, 1]).unwrap(), 50);
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("days/3.parquet: column `observation`: is missing"), "{error}");
    assert!(!folder.has_leftovers());
    // Ids of another type.
    let ids: ArrayRef = Arc::new(StringArray::from(vec!["x"; some.num_rows()]));
    let mut columns = some.columns().to_vec();
    columns[0] = ids;
    let names = ["trace_id", "step", "observation"];
    let other = RecordBatch::try_from_iter(names.into_iter().zip(columns)).unwrap();
    folder.write("days/3.parquet", &other, 50);
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("days/3.parquet: column `trace_id`: is read as Utf8, but as Int64 in"));
    // An error of a value names its file, too.
    let mut bad = drives(1, 20, 3, 9);
    bad[3][1] = 9;
    folder.write("days/3.parquet", &long(&bad), 50);
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("days/3.parquet: column `observation`, row "), "{error}");
}

#[test]
fn inputs_that_cannot_be_meant_are_refused() {
    let folder = Folder::new(&model(1));
    days(&folder);
    fs::create_dir(folder.path("empty")).unwrap();
    for (inputs, output, message) in [
        (&["days"][..], "days/out.parquet", "which is part of the input"),
        (&["days"], "days/day=1/", "which is part of the input"),
        (&["days/day=*"], "days/day=2/results/", "which is part of the input"),
        (&["days", "days/day=1/part-0.parquet"], "out.parquet", "occurs twice in the input"),
        (&["days/*.csv"], "out.parquet", "has no files"),
        (&["empty"], "out.parquet", "has no files"),
        (&["none.parquet"], "out.parquet", "No such file"),
        (
            &["days/day=1/part-0.parquet", "days/day=2/part-0.parquet"],
            "results/",
            "would both be written to the same file of results",
        ),
    ] {
        let error = run(&job(&folder, inputs, output), |_| {}).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
        assert!(!folder.has_leftovers() && !folder.path("out.parquet").exists());
    }
}

#[test]
fn a_run_goes_on_with_the_same_files_before_it() {
    let folder = Folder::new(&model(1));
    let days = days(&folder);
    folder.results(&job(&folder, &["days"], "whole.parquet"));
    let mut job = job(&folder, &["days"], "out.parquet");
    job.part = 200;
    let stop = || {
        let stopped = job.clone();
        thread::spawn(move || run(&stopped, |done| assert!(done.drives < 90, "stop"))).join()
    };
    assert!(stop().is_err());
    // A file that was read has changed, keeping its size and time.
    let first = folder.path(days[0].0);
    let (bytes, modified) =
        (fs::read(&first).unwrap(), fs::metadata(&first).unwrap().modified().unwrap());
    let mut other = bytes.clone();
    other[30] ^= 1;
    fs::write(&first, other).unwrap();
    fs::File::options().append(true).open(&first).unwrap().set_modified(modified).unwrap();
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("day=1/part-0.parquet: row group 0"), "{error}");
    fs::write(&first, bytes).unwrap();
    // One more file among those that were read, and one after them.
    folder.write("days/day=1/part-2.parquet", &nested(&drives(7, 5, 1, 9)), 10);
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("are not those that parts of"), "{error}");
    fs::remove_file(folder.path("days/day=1/part-2.parquet")).unwrap();
    folder.write("days/day=3.parquet", &nested(&drives(7, 5, 1, 9)), 10);
    let (summary, rows) = folder.results(&job);
    assert!(summary.resumed > 0 && summary.drives == 156, "{summary:?}");
    fs::remove_file(folder.path("days/day=3.parquet")).unwrap();
    let before = read(&folder.path("whole.parquet"));
    assert_eq!(rows.slice(0, before.num_rows()), before);
}

/// Kills the command at random moments, 24 times, over many files with some invalid drives.
#[test]
fn a_killed_run_over_many_files_goes_on() {
    let folder = Folder::new(&model(3));
    fs::create_dir(folder.path("days")).unwrap();
    let mut rng = rng(1);
    for file in 0..40 {
        let mut some = drives(file, 80, 1, 40);
        for drive in [3, 40, 41] {
            some[drive][0] = 9;
        }
        folder.write(&format!("days/{file:02}.parquet"), &long(&some), 499);
    }
    let command = |output: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
        command.args(["smooth", "--quiet", "--part", "1000"]);
        let named = [("--model", "model.json"), ("--input", "days"), ("--output", output)];
        for (option, name) in named {
            command.arg(option).arg(folder.path(name));
        }
        command.arg("--skip-invalid").arg(folder.path(&format!("{output}.jsonl")));
        command.stdout(Stdio::null());
        command
    };
    let paths =
        |name: &str| -> [PathBuf; 2] { [folder.path(name), folder.path(&format!("{name}.jsonl"))] };
    let start = Instant::now();
    assert!(command("whole.parquet").status().unwrap().success());
    let whole = start.elapsed();
    let expected = paths("whole.parquet").map(|path| fs::read(path).unwrap());
    assert_eq!(String::from_utf8_lossy(&expected[1]).lines().count(), 120);
    let (mut kills, mut runs) = (0, 0);
    while kills < 24 {
        let name = format!("out{runs}.parquet");
        runs += 1;
        loop {
            let mut child = command(&name).spawn().unwrap();
            thread::sleep(whole.mul_f64(rng.random_range(0.0..0.7)));
            // Fails if the process has already ended.
            _ = child.kill();
            let status = child.wait().unwrap();
            if status.success() {
                break;
            }
            kills += 1;
        }
        let found = paths(&name).map(|path| fs::read(path).unwrap());
        assert!(found == expected, "after {kills} kills");
        paths(&name).into_iter().for_each(|path| fs::remove_file(path).unwrap());
    }
    assert!(runs > 1 && !folder.has_leftovers());
}
