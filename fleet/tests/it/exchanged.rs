//! Inputs that are replaced between an interruption and the run that continues.

use std::fs;

use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{Job, Pack, run};

use crate::kit::*;
use crate::resume::{interrupt, prepare};

fn refused(job: &Job) -> String {
    let error = go_on(job).unwrap_err().to_string();
    assert!(!job.output.exists(), "{error}");
    error
}

#[test]
fn a_file_that_is_shorter_is_refused_and_one_that_is_longer_goes_on() {
    let (folder, expected) = prepare("long");
    let job = interrupt(&folder);
    let bytes = fs::read(&job.inputs[0]).unwrap();
    // Cut off: no longer valid Parquet.
    fs::write(&job.inputs[0], &bytes[..bytes.len() / 2]).unwrap();
    let error = refused(&job);
    assert!(error.contains("drives.parquet: "), "{error}");
    // Fewer row groups.
    let some = drives(33, 6000, 1, 60);
    folder.write("drives.parquet", &long(&some).slice(0, 28_000), 7000);
    let error = refused(&job);
    assert!(error.contains("row group or block 4 has disappeared"), "{error}");
    // More: what was read is unchanged.
    let more = [some, drives(34, 500, 1, 60)].concat();
    folder.write("drives.parquet", &long(&more), 7000);
    let summary = go_on(&job).unwrap();
    assert!(summary.resumed > 0 && summary.drives == 6500, "{summary:?}");
    let longer = fs::read(&job.output).unwrap();
    fs::remove_file(&job.output).unwrap();
    assert_eq!(go_on(&job).unwrap().resumed, 0);
    assert!(fs::read(&job.output).unwrap() == longer && longer != expected);
}

#[test]
fn another_order_of_files_is_refused_and_so_is_a_folder_for_a_file() {
    let folder = Folder::new(&model(3));
    fs::create_dir(folder.path("days")).unwrap();
    for (seed, name) in (0..).zip(["days/a.parquet", "days/b.parquet"]) {
        folder.write(name, &nested(&drives(seed, 400, 1, 40)), 100);
    }
    let mut job = folder.job("", "out.parquet", Verb::Smooth, Table::Steps);
    let inputs = |names: &[&str]| names.iter().map(|name| folder.path(name)).collect::<Vec<_>>();
    let stop = |job: &Job| {
        let job = job.clone();
        std::thread::spawn(move || run(&job, |done| assert!(done.drives < 600, "interrupted")))
            .join()
            .is_err()
    };
    job.inputs = inputs(&["days/a.parquet", "days/b.parquet"]);
    assert!(stop(&job));
    job.inputs = inputs(&["days/b.parquet", "days/a.parquet"]);
    let error = refused(&job);
    assert!(error.contains("are not those that parts of"), "{error}");
    job.inputs = inputs(&["days/b.parquet"]);
    let error = refused(&job);
    assert!(error.contains("names of files is false, was true"), "{error}");
    // A folder with the same files in the same order is the same input.
    job.inputs = inputs(&["days"]);
    assert!(go_on(&job).unwrap().resumed > 0);
    fs::remove_file(&job.output).unwrap();

    // First a single file, then its folder.
    fs::remove_file(folder.path("days/b.parquet")).unwrap();
    job.inputs = inputs(&["days/a.parquet"]);
    let job_of_one = job.clone();
    let stopped =
        std::thread::spawn(move || run(&job_of_one, |done| assert!(done.drives < 300, "stop")));
    assert!(stopped.join().is_err());
    job.inputs = inputs(&["days"]);
    let error = refused(&job);
    assert!(error.contains("names of files is true, was false"), "{error}");
}

#[test]
fn every_other_option_is_named() {
    let (folder, expected) = prepare("long");
    let job = interrupt(&folder);
    let other = |change: &dyn Fn(&mut Job), said: &str| {
        let mut other = job.clone();
        change(&mut other);
        let error = refused(&other);
        assert!(
            error.contains("an unfinished run with different settings") && error.contains(said),
            "{error}"
        );
    };
    other(&|job| job.verb = Verb::Filter, "routine is \"Filter\", was \"Smooth\"");
    other(&|job| job.table = Table::Best(2), "table is \"Best(2)\", was \"Steps\"");
    other(&|job| job.form = Some(wayfix_fleet::input::Form::Nested), "form is \"Nested\"");
    other(&|job| job.pack = Pack::Zstd, "compression is \"Zstd\", was \"None\"");
    other(&|job| job.names.elsewhere = "rest".to_owned(), "columns is [");
    // The number of threads may differ.
    let mut again = job.clone();
    again.threads = 1;
    assert!(go_on(&again).unwrap().resumed > 0);
    assert!(fs::read(&job.output).unwrap() == expected);
}
