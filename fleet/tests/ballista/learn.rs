//! Learning on a cluster.

use std::fs;

use wayfix::inference::LearningOptions;
use wayfix::{Hmm, SparseTransition, TableLikelihood};
use wayfix_fleet::input::ColumnNames;
use wayfix_fleet::{LearnJob, Start, sql};

use crate::Cluster;
use crate::kit::*;

/// Ten iterations on two executors, of which one is killed on the way, equal those of the library.
#[test]
fn iterations_are_those_of_one_process() {
    let given = model(21);
    let folder = Folder::new(&given);
    let some = drives(22, 2000, 0, 30);
    folder.write("nested.parquet", &nested(&some), 50);
    let seen: Vec<Vec<usize>> =
        some.iter().map(|drive| drive.iter().map(|&symbol| symbol as usize).collect()).collect();
    let options = LearningOptions { iterations: 10, tolerance: 0.0, ..LearningOptions::default() };
    let expected = given.learn(&seen, &options).unwrap();
    let cluster = Cluster::start(&folder);
    for kill in [false, true] {
        let job = LearnJob {
            model: folder.path("model.json"),
            input: folder.path("nested.parquet"),
            output: folder.path(if kill { "killed.json" } else { "learned.json" }),
            names: ColumnNames::default(),
            iterations: 10,
            tolerance: 0.0,
            keep_prior: false,
            threads: 8,
            start: Start::default(),
        };
        let course = sql::learn(&job, Some(&cluster.scheduler()), |iteration| {
            if kill && iteration == 4 {
                cluster.kill(1);
            }
            if kill && iteration == 6 {
                cluster.script(&["executor", "1"]);
            }
        })
        .unwrap();
        assert_eq!(course.left_out, expected.left_out().len() as u64);
        assert_eq!(course.log_likelihoods.len(), 11);
        let learned: Hmm<SparseTransition, TableLikelihood> =
            serde_json::from_slice(&fs::read(&job.output).unwrap()).unwrap();
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
                let p = |hmm: &Hmm<SparseTransition, TableLikelihood>| {
                    hmm.likelihood().probability(i, symbol).unwrap()
                };
                near(p(&learned), p(expected));
            }
        }
    }
}
