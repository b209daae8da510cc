//! Tables with one row per step.

use wayfix::HmmError;
use wayfix_fleet::sql::{Query, context};

use crate::kit::*;
use crate::tables::*;

/// Results of drives gathered from rows.
fn gathered(model: &str) -> String {
    format!(
        "SELECT trace_id, steps, wayfix_smooth({model}, seen) AS smooth, \
         wayfix_score({model}, seen)['log_likelihood'] AS log_likelihood FROM (SELECT trace_id, \
         array_agg(observation ORDER BY step) AS seen, array_agg(step ORDER BY step) AS steps \
         FROM drives GROUP BY trace_id)"
    )
}

fn query(folder: &Folder, input: &str, key: &[&str]) -> Query {
    over(folder, input, key, &gathered(&model_of(folder)))
}

#[test]
fn rows_are_gathered_in_order() {
    let model = model(5);
    let folder = Folder::new(&model);
    let drives = drives(31, 300, 1, 40);
    folder.write("long.parquet", &long(&drives), 777);
    for (threads, batch) in [(1, 1000), (2, 16), (3, 5)] {
        let mut query = query(&folder, "long.parquet", &["trace_id", "step"]);
        (query.threads, query.batch) = (threads, batch);
        let found = rows(&query);
        assert!(integers(&found, "trace_id").into_iter().eq((0..300).map(Some)));
        let (smooth, logs) = (list(&found, "smooth"), numbers(&found, "log_likelihood"));
        let steps = list(&found, "steps");
        for (drive, seen) in drives.iter().enumerate() {
            assert_eq!(steps.value(drive).len(), seen.len());
            let seen: Vec<usize> = seen.iter().map(|&symbol| symbol as usize).collect();
            match model.smooth(&seen) {
                Ok(smoothed) => {
                    close(logs[drive].unwrap(), smoothed.log_likelihood());
                    let items = items_of(&smooth, drive).unwrap();
                    let probability = numbers(&items, "probability");
                    assert_eq!(probability.len(), seen.len());
                    for (found, belief) in probability.iter().zip(smoothed.posteriors().iter()) {
                        close(found.unwrap(), belief.peak().1);
                    }
                }
                Err(HmmError::Impossible { .. }) => {
                    assert!(logs[drive].is_none() && items_of(&smooth, drive).is_none());
                }
                Err(other) => panic!("{other}"),
            }
        }
    }
    // Without an order of the table the rows are the same ones.
    let mut query = query(&folder, "long.parquet", &[]);
    query.sql += " ORDER BY trace_id";
    let found = rows(&query);
    assert!(integers(&found, "trace_id").into_iter().eq((0..300).map(Some)));
    let logs = numbers(&found, "log_likelihood");
    for (seen, log) in drives.iter().zip(logs) {
        let seen: Vec<usize> = seen.iter().map(|&symbol| symbol as usize).collect();
        match (model.log_likelihood(&seen), log) {
            (Ok(expected), Some(log)) => close(log, expected),
            (expected, log) => assert!(expected.is_err() && log.is_none()),
        }
    }
}

/// Physical plan, as text, for a table declared as sorted in SQL.
fn plan(folder: &Folder, threads: usize, order: &str, of: &str) -> String {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let context = context(threads, 1024);
        let path = folder.path("long.parquet");
        let table = format!(
            "CREATE EXTERNAL TABLE drives STORED AS PARQUET {order} LOCATION '{}'",
            path.display()
        );
        context.sql(&table).await.unwrap().collect().await.unwrap();
        let explain = format!(
            "EXPLAIN FORMAT INDENT {}",
            gathered(&model_of(folder)).replace("FROM drives", of)
        );
        let rows = context.sql(&explain).await.unwrap().collect().await.unwrap();
        let texts = rows.iter().flat_map(|rows| texts(rows, "plan")).flatten();
        texts.last().unwrap()
    })
}

#[test]
fn memory_is_flat_by_the_plan() {
    let folder = Folder::new(&model(5));
    folder.write("long.parquet", &long(&drives(31, 300, 1, 40)), 777);
    for threads in [1, 2, 3] {
        let sorted = plan(&folder, threads, "WITH ORDER (trace_id ASC, step ASC)", "FROM drives");
        let aggregates = sorted.matches("AggregateExec").count();
        assert!(aggregates > 0, "{sorted}");
        assert_eq!(sorted.matches("ordering_mode=Sorted").count(), aggregates, "{sorted}");
        assert!(!sorted.contains("SortExec"), "{sorted}");
        let unsorted = plan(&folder, threads, "", "FROM drives");
        assert!(!unsorted.contains("ordering_mode=Sorted"), "{unsorted}");
    }
    // A range of the table is ordered, and has one aggregate that needs no exchange of rows.
    let order = "WITH ORDER (trace_id ASC, step ASC)";
    let range = "FROM drives WHERE trace_id >= 20 AND trace_id < 77";
    let range = plan(&folder, 1, order, range);
    assert_eq!(range.matches("AggregateExec: mode=Single").count(), 1, "{range}");
    assert_eq!(range.matches("ordering_mode=Sorted").count(), 1, "{range}");
    assert!(!range.contains("SortExec") && !range.contains("RepartitionExec"), "{range}");
    assert!(range.contains("pruning_predicate="), "{range}");
}
