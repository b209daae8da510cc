//! Results of all functions equal those of the library, with any number of partitions.

use wayfix::HmmError;

use crate::kit::*;
use crate::tables::*;

/// All functions over nested drives.
fn all(model: &str) -> String {
    format!(
        "SELECT trace_id, wayfix_score({model}, observation) AS score, \
         wayfix_smooth({model}, observation) AS smooth, \
         wayfix_filter({model}, observation) AS filter, \
         wayfix_decode({model}, observation) AS decode FROM drives"
    )
}

#[test]
fn all_functions_are_those_of_the_library() {
    for seed in 0..2 {
        let model = model(seed);
        let folder = Folder::new(&model);
        let drives = drives(200 + seed, 400, 1, 30);
        folder.write("nested.parquet", &nested(&drives), 33);
        let sql = all(&model_of(&folder));
        let mut failed = 0;
        for (threads, batch) in [(1, 1000), (2, 7), (3, 16), (4, 1)] {
            let mut query = over(&folder, "nested.parquet", &["trace_id"], &sql);
            (query.threads, query.batch) = (threads, batch);
            let found = rows(&query);
            assert_eq!(found.num_rows(), drives.len());
            let ids = texts(&found, "trace_id");
            let score = fields(&found, "score");
            let (logs, kinds) = (numbers(&score, "log_likelihood"), texts(&score, "error_kind"));
            let (at, errors) = (integers(&score, "error_step"), texts(&score, "error"));
            let lists = ["smooth", "filter", "decode"].map(|name| list(&found, name));
            for (drive, seen) in drives.iter().enumerate() {
                assert_eq!(ids[drive], Some(format!("drive {drive:05}")));
                let seen: Vec<usize> = seen.iter().map(|&symbol| symbol as usize).collect();
                let [smooth, filter, decode] = lists.each_ref().map(|list| items_of(list, drive));
                let smoothed = match model.smooth(&seen) {
                    Ok(smoothed) => smoothed,
                    Err(error @ HmmError::Impossible { step }) => {
                        failed += 1;
                        assert!(smooth.is_none() && filter.is_none() && decode.is_none());
                        assert_eq!((logs[drive], at[drive]), (None, Some(step as i64)));
                        assert_eq!(kinds[drive].as_deref(), Some("impossible"));
                        assert_eq!(errors[drive], Some(error.to_string()));
                        continue;
                    }
                    Err(other) => panic!("{other}"),
                };
                close(logs[drive].unwrap(), smoothed.log_likelihood());
                assert_eq!((&kinds[drive], at[drive], &errors[drive]), (&None, None, &None));
                let filtered = model.forward(&seen).unwrap();
                let path = model.viterbi(&seen).unwrap();
                let (smooth, filter, decode) = (smooth.unwrap(), filter.unwrap(), decode.unwrap());
                let steps: Vec<_> = (1..=seen.len() as i64).map(Some).collect();
                for (items, posteriors) in
                    [(&smooth, smoothed.posteriors()), (&filter, filtered.posteriors())]
                {
                    assert_eq!(integers(items, "step"), steps);
                    let (state, p) = (states(items, "state"), numbers(items, "probability"));
                    let entropy = numbers(items, "entropy");
                    for (k, belief) in posteriors.iter().enumerate() {
                        let (mode, probability) = belief.peak();
                        assert_eq!(state[k], Some(mode as u32));
                        close(p[k].unwrap(), probability);
                        close(entropy[k].unwrap(), belief.entropy());
                    }
                }
                let logs = numbers(&filter, "log_likelihood");
                logs.iter()
                    .zip(filtered.log_likelihoods())
                    .for_each(|(f, e)| close(f.unwrap(), *e));
                assert_eq!(integers(&decode, "step"), steps);
                let states = states(&decode, "state");
                assert!(states.iter().copied().eq(path.states().iter().map(|&s| Some(s as u32))));
            }
        }
        assert!(failed > 40, "{failed}");
    }
}

#[test]
fn functions_combine_with_other_sql() {
    let model = model(3);
    let folder = Folder::new(&model);
    let drives = drives(7, 60, 3, 12);
    folder.write("nested.parquet", &nested(&drives), 33);
    let name = model_of(&folder);
    // One row per step, and drives that are ruled out.
    let sql = format!(
        "SELECT trace_id, s['step'] AS step, s['state'] AS state FROM (SELECT trace_id, \
         unnest(wayfix_decode({name}, observation)) AS s FROM drives) ORDER BY trace_id, step"
    );
    let found = rows(&over(&folder, "nested.parquet", &[], &sql));
    let path = |seen: &Vec<u32>| {
        let seen: Vec<usize> = seen.iter().map(|&symbol| symbol as usize).collect();
        model.viterbi(&seen).ok().map(|path| path.states().to_vec())
    };
    let expected: Vec<_> = drives.iter().filter_map(path).flatten().collect();
    let states: Vec<_> = states(&found, "state").into_iter().map(Option::unwrap).collect();
    assert!(states.iter().map(|&state| state as usize).eq(expected.iter().copied()));
    let sql = format!(
        "SELECT count(*) AS n, count(wayfix_smooth({name}, observation)) AS valid FROM drives \
         WHERE wayfix_score({name}, observation)['error_kind'] IS NULL"
    );
    let found = rows(&over(&folder, "nested.parquet", &[], &sql));
    let count = drives.iter().filter_map(path).count() as i64;
    assert!(count < 60);
    assert_eq!(
        (integers(&found, "n")[0], integers(&found, "valid")[0]),
        (Some(count), Some(count))
    );
    // Constants, which are evaluated when the query is planned.
    let sql = format!("SELECT wayfix_decode({name}, [0, 1, 2]) AS path FROM drives LIMIT 2");
    let found = rows(&over(&folder, "nested.parquet", &[], &sql));
    let expected = model.viterbi(&[0, 1, 2]).unwrap();
    for row in 0..2 {
        let items = items_of(&list(&found, "path"), row).unwrap();
        let found = crate::kit::states(&items, "state");
        assert!(found.into_iter().eq(expected.states().iter().map(|&s| Some(s as u32))));
    }
    // A table without rows.
    let sql =
        format!("SELECT wayfix_smooth({name}, observation) AS s FROM drives WHERE trace_id = ''");
    assert_eq!(rows(&over(&folder, "nested.parquet", &[], &sql)).num_rows(), 0);
}
