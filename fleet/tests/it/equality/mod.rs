//! Results of files are those of the library.

mod drives;
mod steps;

use arrow::array::RecordBatch;
use wayfix::HmmError;
use wayfix_fleet::input::Form;
use wayfix_fleet::output::{Table, Verb};

use crate::kit::*;

/// One row that is expected: drive, step, state, and numbers; or drive and step of a failure.
struct Row {
    drive: usize,
    step: i64,
    rank: Option<u32>,
    state: Option<u32>,
    numbers: Vec<(&'static str, f64)>,
}

fn symbols(drive: &[u32]) -> Vec<usize> {
    drive.iter().map(|&symbol| symbol as usize).collect()
}

fn steps(model: &Model, drives: &Drives, verb: Verb, step: impl Fn(usize) -> i64) -> Vec<Row> {
    let mut rows = Vec::new();
    for (drive, seen) in drives.iter().enumerate() {
        let seen = symbols(seen);
        let result = match verb {
            Verb::Smooth => model.smooth(&seen).map(|s| {
                let total = vec![s.log_likelihood(); seen.len()];
                (s.posteriors().clone(), total)
            }),
            _ => {
                model.forward(&seen).map(|f| (f.posteriors().clone(), f.log_likelihoods().to_vec()))
            }
        };
        match result {
            Ok((posteriors, logs)) => {
                for (k, (belief, log)) in posteriors.iter().zip(logs).enumerate() {
                    let (state, probability) = belief.peak();
                    rows.push(Row {
                        drive,
                        step: step(k),
                        rank: None,
                        state: Some(state as u32),
                        numbers: vec![
                            ("probability", probability),
                            ("entropy", belief.entropy()),
                            ("log_likelihood", log),
                        ],
                    });
                }
            }
            Err(HmmError::Impossible { step: at }) => rows.push(Row {
                drive,
                step: step(at - 1),
                rank: None,
                state: None,
                numbers: Vec::new(),
            }),
            Err(other) => panic!("{other}"),
        }
    }
    rows
}

fn compare_long(found: &RecordBatch, expected: &[Row], id: impl Fn(&RecordBatch, usize) -> usize) {
    assert_eq!(found.num_rows(), expected.len());
    let (steps, state) = (integers(found, "step"), states(found, "state"));
    let kinds = texts(found, "error_kind");
    for (at, row) in expected.iter().enumerate() {
        assert_eq!(id(found, at), row.drive);
        assert_eq!(steps[at], Some(row.step));
        assert_eq!(state[at], row.state);
        assert_eq!(kinds[at].as_deref(), row.state.is_none().then_some("impossible"));
        if let Some(rank) = row.rank {
            assert_eq!(states(found, "rank")[at], Some(rank));
        }
    }
    let names = expected.iter().find(|row| row.state.is_some()).unwrap();
    for (column, (name, _)) in names.numbers.iter().enumerate() {
        let found = numbers(found, name);
        for (found, row) in found.iter().zip(expected) {
            match row.numbers.get(column) {
                Some((_, expected)) => close(found.unwrap(), *expected),
                None => assert_eq!(*found, None),
            }
        }
    }
}

fn number_id(rows: &RecordBatch, at: usize) -> usize {
    use arrow::array::AsArray;
    let ids = rows.column_by_name("trace_id").unwrap();
    ids.as_primitive::<arrow::datatypes::Int64Type>().value(at) as usize
}

fn text_id(rows: &RecordBatch, at: usize) -> usize {
    use arrow::array::AsArray;
    let ids = rows.column_by_name("trace_id").unwrap().as_string::<i32>();
    ids.value(at).strip_prefix("drive ").unwrap().parse().unwrap()
}
