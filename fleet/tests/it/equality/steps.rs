//! One row per step.

use super::*;

#[test]
fn steps_are_those_of_the_library_in_every_form() {
    for seed in 0..3 {
        let model = model(seed);
        let folder = Folder::new(&model);
        let drives = drives(100 + seed, 500, 1, 30);
        // Row groups that end within drives, and within batches.
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
                    Err(HmmError::Impossible { step }) => {
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
