//! Learning from files, and by the library.

use std::fs;

use wayfix::inference::{LearnedModel, LearningOptions};
use wayfix::{SparseTransition, TableLikelihood};
use wayfix_fleet::input::ColumnNames;
use wayfix_fleet::{Course, LearnJob, Start};

use super::{Drives, Folder, Model, STATES};

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
    let options = LearningOptions::default().with_iterations(10).with_tolerance(0.0);
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
