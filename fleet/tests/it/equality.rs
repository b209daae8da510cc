//! Results of files are those of the library.

use arrow::array::RecordBatch;
use wayfix::InferenceError;
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
            Err(InferenceError::Impossible { step: at }) => rows.push(Row {
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

#[test]
fn steps_are_those_of_the_library_in_every_form() {
    for seed in 0..3 {
        let model = model(seed);
        let folder = Folder::new(&model);
        let drives = drives(100 + seed, 500, 1, 30);
        // Groups that end within drives, and within batches.
        folder.write("long.parquet", &long(&drives), 777);
        folder.write("nested.parquet", &nested(&drives), 33);
        for verb in [Verb::Smooth, Verb::Filter] {
            let expected = steps(&model, &drives, verb, step);
            let name = format!("{verb:?}");
            let job = folder.job("long.parquet", &format!("{name}1"), verb, Table::Steps);
            let (summary, found) = folder.results(&job);
            compare_long(&found, &expected, number_id);
            let failed = expected.iter().filter(|row| row.state.is_none()).count();
            let count = drives.iter().map(Vec::len).sum::<usize>();
            assert!(failed > 5, "{failed}");
            assert_eq!(
                (summary.drives, summary.steps, summary.failed),
                (500, count as u64, failed as u64)
            );

            let expected = steps(&model, &drives, verb, |k| k as i64 + 1);
            let mut job = folder.job("nested.parquet", &format!("{name}2"), verb, Table::Steps);
            job.form = Some(Form::Long);
            let (_, found) = folder.results(&job);
            compare_long(&found, &expected, text_id);

            job.form = None;
            job.output = folder.path(&format!("{name}3"));
            let (summary, found) = folder.results(&job);
            assert_eq!(summary.failed, failed as u64);
            let (offsets, items) = items(&found, "results");
            let totals = numbers(&found, "log_likelihood");
            let (kinds, steps) = (texts(&found, "error_kind"), integers(&found, "error_step"));
            let valid: Vec<&Row> = expected.iter().filter(|row| row.state.is_some()).collect();
            assert_eq!(items.num_rows(), valid.len());
            for (at, row) in valid.iter().enumerate() {
                assert_eq!(states(&items, "state")[at], row.state);
                assert_eq!(integers(&items, "step")[at], Some(row.step));
                close(numbers(&items, "probability")[at].unwrap(), row.numbers[0].1);
                close(numbers(&items, "entropy")[at].unwrap(), row.numbers[1].1);
            }
            for (drive, seen) in drives.iter().enumerate() {
                assert_eq!(text_id(&found, drive), drive);
                let length = offsets[drive + 1] - offsets[drive];
                match model.log_likelihood(&symbols(seen)) {
                    Ok(log) => {
                        close(totals[drive].unwrap(), log);
                        assert_eq!((length, &kinds[drive]), (seen.len(), &None));
                    }
                    Err(InferenceError::Impossible { step }) => {
                        assert_eq!((length, steps[drive]), (0, Some(step as i64)));
                        assert_eq!(kinds[drive].as_deref(), Some("impossible"));
                    }
                    Err(other) => panic!("{other}"),
                }
            }
        }
    }
}

#[test]
fn drives_have_their_scores_and_errors() {
    let model = model(7);
    let folder = Folder::new(&model);
    // Also drives without a step.
    let drives = drives(17, 400, 0, 12);
    folder.write("nested.parquet", &nested(&drives), 100);
    for (verb, name) in [
        (Verb::Score, "log_likelihood"),
        (Verb::Smooth, "log_likelihood"),
        (Verb::Filter, "log_likelihood"),
        (Verb::Decode, "log_probability"),
    ] {
        let job = folder.job("nested.parquet", &format!("{verb:?}"), verb, Table::Drives);
        let (_, found) = folder.results(&job);
        assert_eq!(found.num_rows(), drives.len());
        let (steps, logs) = (integers(&found, "steps"), numbers(&found, name));
        let (kinds, errors) = (texts(&found, "error_kind"), texts(&found, "error"));
        for (drive, seen) in drives.iter().enumerate() {
            assert_eq!(steps[drive], Some(seen.len() as i64));
            let expected = match verb {
                Verb::Decode => model.viterbi(&symbols(seen)).map(|path| path.log_probability()),
                _ => model.log_likelihood(&symbols(seen)),
            };
            match expected {
                Ok(expected) => {
                    close(logs[drive].unwrap(), expected);
                    assert_eq!((&kinds[drive], &errors[drive]), (&None, &None));
                }
                Err(error) => {
                    assert_eq!(logs[drive], None);
                    assert_eq!(kinds[drive].as_deref(), Some("impossible"));
                    assert_eq!(errors[drive], Some(error.to_string()));
                }
            }
        }
    }
}

#[test]
fn paths_are_those_of_the_library() {
    let model = model(9);
    let folder = Folder::new(&model);
    let drives = drives(19, 200, 1, 10);
    folder.write("long.parquet", &long(&drives), 1000);
    for count in [1, 3] {
        let mut rows = Vec::new();
        let mut paths = Vec::new();
        for (drive, seen) in drives.iter().enumerate() {
            let Ok(best) = model.k_best(&symbols(seen), count) else {
                let Err(InferenceError::Impossible { step: at }) = model.viterbi(&symbols(seen))
                else {
                    panic!("expected to be impossible");
                };
                let numbers = Vec::new();
                rows.push(Row { drive, step: step(at - 1), rank: None, state: None, numbers });
                continue;
            };
            for (rank, path) in (1..).zip(&best) {
                for (k, &state) in path.states().iter().enumerate() {
                    rows.push(Row {
                        drive,
                        step: step(k),
                        rank: Some(rank),
                        state: Some(state as u32),
                        numbers: vec![("log_probability", path.log_probability())],
                    });
                }
                paths.push((drive, rank, path.states().to_vec()));
            }
        }
        let name = format!("paths{count}");
        let mut job = folder.job("long.parquet", &name, Verb::Decode, Table::Paths(count));
        compare_long(&folder.results(&job).1, &rows, number_id);

        job.form = Some(Form::Nested);
        job.output = folder.path(&format!("{name} nested"));
        let (_, found) = folder.results(&job);
        let (offsets, items) = items(&found, "path");
        let state = states(&items, "state");
        let ranks = states(&found, "rank");
        let mut expected = paths.iter();
        for row in (0..found.num_rows()).filter(|&row| ranks[row].is_some()) {
            let (drive, rank, path) = expected.next().unwrap();
            assert_eq!((number_id(&found, row), ranks[row]), (*drive, Some(*rank)));
            let range = offsets[row]..offsets[row + 1];
            assert!(state[range].iter().map(|s| s.unwrap() as usize).eq(path.iter().copied()));
        }
        assert!(expected.next().is_none());
    }
}

#[test]
fn best_states_are_in_order() {
    let model = model(4);
    let folder = Folder::new(&model);
    let drives = drives(5, 60, 1, 8);
    folder.write("long.parquet", &long(&drives), 1000);
    let job = folder.job("long.parquet", "best", Verb::Smooth, Table::Best(4));
    let mut rows = Vec::new();
    for (drive, seen) in drives.iter().enumerate() {
        match model.smooth(&symbols(seen)) {
            Ok(smoothed) => {
                for (k, belief) in smoothed.posteriors().iter().enumerate() {
                    let mut order: Vec<usize> = (0..STATES).collect();
                    let p = belief.as_slice();
                    order.sort_by(|&a, &b| p[b].total_cmp(&p[a]).then(a.cmp(&b)));
                    rows.extend((1..=4).zip(order).map(|(rank, state)| Row {
                        drive,
                        step: step(k),
                        rank: Some(rank),
                        state: Some(state as u32),
                        numbers: vec![("probability", p[state])],
                    }));
                }
            }
            Err(InferenceError::Impossible { step: at }) => rows.push(Row {
                drive,
                step: step(at - 1),
                rank: None,
                state: None,
                numbers: Vec::new(),
            }),
            Err(other) => panic!("{other}"),
        }
    }
    compare_long(&folder.results(&job).1, &rows, number_id);
}

#[test]
fn no_drives_give_no_rows() {
    let folder = Folder::new(&model(1));
    folder.write("none.parquet", &long(&Vec::new()), 10);
    let job = folder.job("none.parquet", "out.parquet", Verb::Smooth, Table::Steps);
    let (summary, found) = folder.results(&job);
    assert_eq!((summary.drives, found.num_rows()), (0, 0));
}
