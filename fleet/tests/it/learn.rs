//! Learning from files.

use std::fs;
use std::thread;

use wayfix::inference::LearningOptions;
use wayfix::{Hmm, SparseTransition, TableLikelihood};
use wayfix_fleet::input::ColumnNames;
use wayfix_fleet::{LearnJob, Start, learn};

use crate::kit::*;

fn job(folder: &Folder, input: &str, output: &str) -> LearnJob {
    LearnJob {
        model: folder.path("model.json"),
        input: folder.path(input),
        output: folder.path(output),
        names: ColumnNames::default(),
        iterations: 10,
        tolerance: 0.0,
        keep_prior: false,
        threads: 2,
        start: Start::default(),
    }
}

#[test]
fn is_that_of_the_library_also_after_an_interruption() {
    let given = model(11);
    let folder = Folder::new(&given);
    let some = drives(12, 1500, 0, 30);
    folder.write("nested.parquet", &nested(&some), 200);
    folder.write("long.parquet", &long(&some), 3000);
    let seen: Vec<Vec<usize>> =
        some.iter().map(|drive| drive.iter().map(|&symbol| symbol as usize).collect()).collect();
    let options = LearningOptions { iterations: 10, tolerance: 0.0, ..LearningOptions::default() };
    let expected = given.learn(&seen, &options).unwrap();
    assert!(!expected.left_out().is_empty());

    for (input, output) in [("nested.parquet", "a.json"), ("long.parquet", "b.json")] {
        let job = job(&folder, input, output);
        if input == "long.parquet" {
            let stopped = job.clone();
            let stopped =
                thread::spawn(move || learn(&stopped, |k, _| assert!(k < 5, "interrupted")));
            assert!(stopped.join().is_err());
            assert!(folder.has_leftovers() && !job.output.exists());
        }
        let mut iterations = Vec::new();
        let course = learn(&job, |iteration, _| iterations.push(iteration)).unwrap();
        assert!(!folder.has_leftovers());
        let first = if input == "long.parquet" { 5 } else { 0 };
        assert_eq!(iterations.first(), Some(&first));
        assert_eq!(course.left_out, expected.left_out().len() as u64);
        assert_eq!(course.log_likelihoods.len(), 11);
        for (found, expected) in course.log_likelihoods.iter().zip(expected.objectives()) {
            assert!((found - expected).abs() < 1e-9 * expected.abs(), "{found}, {expected}");
        }
        let learned: Hmm<SparseTransition, TableLikelihood> =
            serde_json::from_slice(&fs::read(&job.output).unwrap()).unwrap();
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-9);
        for i in 0..STATES {
            for j in 0..STATES {
                near(learned.transition().get(i, j), expected.model().transition().get(i, j));
            }
            for symbol in 0..6 {
                let p = |hmm: &Hmm<SparseTransition, TableLikelihood>| {
                    hmm.likelihood().probability(i, symbol).unwrap()
                };
                near(p(&learned), p(expected.model()));
            }
        }
    }
}
