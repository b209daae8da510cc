//! A damaged journal never leads to other results, or to other counts.

use std::fs;

use rand::RngExt;
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{Job, Summary, run};

use crate::kit::*;
use crate::resume::{interrupt, prepare};

/// A run with left-out drives, stopped halfway, and the result of a whole one.
fn stopped(folder: &Folder) -> (Job, Summary, [Vec<u8>; 2]) {
    let mut some = drives(33, 400, 1, 30);
    for drive in [3, 40, 41, 170, 320] {
        some[drive][0] = 9;
    }
    folder.write("drives.parquet", &long(&some), 700);
    let job = |name: &str| {
        let mut job = folder.job("drives.parquet", name, Verb::Score, Table::Drives);
        job.left_out = Some(folder.path(&format!("{name}.jsonl")));
        job.part = 40;
        job
    };
    let whole = job("whole.parquet");
    let summary = go_on(&whole).unwrap();
    let expected = made(&whole);
    let job = job("out.parquet");
    let stopped = std::panic::catch_unwind(|| run(&job, |done| assert!(done.drives < 250, "stop")));
    assert!(stopped.is_err() && folder.has_leftovers());
    (job, summary, expected)
}

fn made(job: &Job) -> [Vec<u8>; 2] {
    [&job.output, job.left_out.as_ref().unwrap()].map(|path| fs::read(path).unwrap())
}

#[test]
fn flipped_bits_are_refused_or_change_nothing() {
    let folder = Folder::new(&model(3));
    let (job, summary, expected) = stopped(&folder);
    let names = ["out.parquet.journal", "out.parquet.partial", "out.parquet.jsonl.partial"];
    let before = names.map(|name| fs::read(folder.path(name)).unwrap());
    let lines = String::from_utf8_lossy(&before[0]).lines().count();
    assert!(lines > 4, "{lines}");
    let mut rng = rng(1);
    let (mut refused, mut same) = (0, 0);
    for _ in 0..400 {
        for (name, bytes) in names.iter().zip(&before) {
            fs::write(folder.path(name), bytes).unwrap();
        }
        let mut journal = before[0].clone();
        let at = rng.random_range(0..journal.len());
        journal[at] ^= 1 << rng.random_range(0..8);
        fs::write(folder.path(names[0]), journal).unwrap();
        match go_on(&job) {
            Err(error) => {
                let error = error.to_string();
                assert!(error.contains("out.parquet.journal: line "), "{error}");
                assert!(error.contains("is damaged, or from another version"), "{error}");
                refused += 1;
            }
            Ok(done) => {
                assert!(made(&job) == expected, "byte {at}");
                let counts = |done: &Summary| (done.drives, done.steps, done.left_out);
                assert_eq!(counts(&done), counts(&summary), "byte {at}");
                same += 1;
                fs::remove_file(&job.output).unwrap();
                fs::remove_file(job.left_out.as_ref().unwrap()).unwrap();
            }
        }
    }
    assert!(refused > 100 && same > 10, "{refused} refused, {same} the same");
    eprintln!("{refused} refused, {same} the same");
}

#[test]
fn a_damaged_line_is_named() {
    let (folder, expected) = prepare("long");
    let mut job = interrupt(&folder);
    let path = folder.path("out.parquet.journal");
    let text = fs::read_to_string(&path).unwrap();
    let damaged = text.replacen("\"counts\":[", "\"counts\":[1", 1);
    assert_ne!(text, damaged);
    fs::write(&path, damaged).unwrap();
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("out.parquet.journal: line 2 is damaged"), "{error}");
    job.start.restart = true;
    assert_eq!(go_on(&job).unwrap().resumed, 0);
    assert!(fs::read(&job.output).unwrap() == expected);
}
