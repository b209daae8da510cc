//! One row per drive, and paths.

use super::*;

#[test]
fn drives_have_their_scores_and_errors() {
    let model = model(7);
    let folder = Folder::new(&model);
    // Drives without steps, too.
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
                let Err(HmmError::Impossible { step: at }) = model.viterbi(&symbols(seen)) else {
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
