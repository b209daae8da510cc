//! Learning by queries.

use std::fs;

use wayfix::inference::LearningOptions;
use wayfix::{Hmm, SparseTransition, TableLikelihood};
use wayfix_fleet::input::ColumnNames;
use wayfix_fleet::{LearnJob, Start, sql};

use crate::kit::*;

fn job(folder: &Folder, input: &str, output: &str, threads: usize) -> LearnJob {
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

type Model = Hmm<SparseTransition, TableLikelihood>;

fn read(job: &LearnJob) -> Model {
    serde_json::from_slice(&fs::read(&job.output).unwrap()).unwrap()
}

fn assert_near(found: &Model, expected: &Model) {
    let near = |found: f64, expected: f64| {
        assert!((found - expected).abs() < 1e-9, "{found}, expected {expected}");
    };
    for i in 0..STATES {
        near(found.prior().belief().as_slice()[i], expected.prior().belief().as_slice()[i]);
        for j in 0..STATES {
            near(found.transition().get(i, j), expected.transition().get(i, j));
        }
        for symbol in 0..6 {
            let p = |hmm: &Model| hmm.likelihood().probability(i, symbol).unwrap();
            near(p(found), p(expected));
        }
    }
}

/// Ten iterations equal those of the library, however the rows are divided.
#[test]
fn iterations_by_queries_are_those_of_the_library() {
    let given = model(11);
    let folder = Folder::new(&given);
    let some = drives(12, 1500, 0, 30);
    folder.write("nested.parquet", &nested(&some), 100);
    folder.write("long.parquet", &long(&some), 1000);
    let seen: Vec<Vec<usize>> =
        some.iter().map(|drive| drive.iter().map(|&symbol| symbol as usize).collect()).collect();
    let options = LearningOptions { iterations: 10, tolerance: 0.0, ..LearningOptions::default() };
    let expected = given.learn(&seen, &options).unwrap();
    assert!(!expected.left_out().is_empty());
    for (input, threads) in [("nested.parquet", 1), ("nested.parquet", 3), ("long.parquet", 2)] {
        let job = job(&folder, input, &format!("{input}.{threads}.json"), threads);
        let mut iterations = Vec::new();
        let course = sql::learn(&job, None, |iteration| iterations.push(iteration)).unwrap();
        assert!(iterations.into_iter().eq(0..=10));
        assert!(!folder.has_leftovers());
        assert_eq!(course.left_out, expected.left_out().len() as u64);
        for (found, expected) in course.log_likelihoods.iter().zip(expected.objectives()) {
            assert!((found - expected).abs() < 1e-9 * expected.abs(), "{found}, {expected}");
        }
        assert_near(&read(&job), expected.model());
    }
}

/// An interrupted run goes on after its last re-estimation, by a query or from the file.
#[test]
fn learning_goes_on_after_an_interruption() {
    let given = model(13);
    let folder = Folder::new(&given);
    folder.write("nested.parquet", &nested(&drives(14, 300, 0, 30)), 100);
    let whole = job(&folder, "nested.parquet", "whole.json", 2);
    sql::learn(&whole, None, |_| ()).unwrap();
    let part = job(&folder, "nested.parquet", "part.json", 2);
    let stopped = part.clone();
    let stopped = std::thread::spawn(move || {
        sql::learn(&stopped, None, |iteration| assert!(iteration < 4, "interrupted"))
    });
    assert!(stopped.join().is_err());
    assert!(!part.output.exists());
    let mut iterations = Vec::new();
    sql::learn(&part, None, |iteration| iterations.push(iteration)).unwrap();
    assert_eq!(iterations.first(), Some(&4));
    assert_near(&read(&part), &read(&whole));
}

#[test]
fn drives_that_cannot_be_used_are_errors() {
    let given = model(15);
    let folder = Folder::new(&given);
    let mut some = drives(16, 50, 1, 30);
    some[40][0] = 1000;
    folder.write("nested.parquet", &nested(&some), 100);
    let wrong = job(&folder, "nested.parquet", "a.json", 2);
    let message = sql::learn(&wrong, None, |_| ()).unwrap_err().to_string();
    assert!(message.contains("wayfix_expect") && message.contains("symbol 1000"), "{message}");
    assert!(!wrong.output.exists());
    folder.write("none.parquet", &nested(&[]), 100);
    let none = job(&folder, "none.parquet", "b.json", 2);
    let message = sql::learn(&none, None, |_| ()).unwrap_err().to_string();
    assert_eq!(message, "learning failed: none of 0 drives is possible");
}
