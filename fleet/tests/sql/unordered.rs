//! Drives whose steps come in any order are refused.

use datafusion::prelude::{ParquetReadOptions, SessionContext};
use wayfix_fleet::sql::register;

use crate::kit::*;
use crate::tables::*;

/// Queries that are refused, with `{}` for the model.
const REFUSED: [&str; 10] = [
    "SELECT trace_id, wayfix_smooth({}, array_agg(observation)) FROM drives GROUP BY trace_id",
    "SELECT wayfix_decode({}, array_agg(DISTINCT observation)) FROM drives GROUP BY trace_id",
    "SELECT wayfix_expect({}, seen) FROM (SELECT array_agg(observation) AS seen FROM drives \
     GROUP BY trace_id)",
    "WITH a AS (SELECT trace_id, array_agg(observation) AS seen FROM drives GROUP BY trace_id), \
     b AS (SELECT seen AS other, trace_id FROM a WHERE trace_id > 3 ORDER BY trace_id LIMIT 5) \
     SELECT wayfix_score({}, other)['log_likelihood'] FROM b",
    "SELECT wayfix_filter({}, array_slice(array_agg(observation), 1, 2)) FROM drives \
     GROUP BY trace_id",
    "SELECT wayfix_score({}, a.seen) FROM (SELECT trace_id, array_agg(observation) AS seen FROM \
     drives GROUP BY trace_id) AS a JOIN drives AS b ON a.trace_id = b.trace_id",
    "SELECT wayfix_score({}, seen) FROM (SELECT array_agg(observation ORDER BY step) AS seen FROM \
     drives GROUP BY trace_id UNION ALL SELECT array_agg(observation) FROM drives \
     GROUP BY trace_id)",
    "SELECT wayfix_score({}, array_agg(observation) OVER (PARTITION BY trace_id)) FROM drives",
    "SELECT trace_id FROM drives GROUP BY trace_id \
     HAVING wayfix_score({}, array_agg(observation))['log_likelihood'] > -9",
    "SELECT trace_id FROM drives WHERE trace_id IN (SELECT trace_id FROM drives GROUP BY trace_id \
     HAVING wayfix_score({}, array_agg(observation))['log_likelihood'] > -9)",
];

/// Queries that are accepted.
const TAKEN: [&str; 6] = [
    "SELECT wayfix_smooth({}, array_agg(observation ORDER BY step)) FROM drives GROUP BY trace_id",
    "SELECT wayfix_smooth({}, seen), other FROM (SELECT array_agg(observation ORDER BY step) AS \
     seen, array_agg(observation) AS other FROM drives GROUP BY trace_id)",
    "SELECT array_agg(observation) FROM drives GROUP BY trace_id",
    "SELECT wayfix_score({}, CASE WHEN cardinality(array_agg(step)) > 3 THEN \
     array_agg(observation ORDER BY step) END) FROM drives GROUP BY trace_id \
     HAVING cardinality(array_agg(step)) > 3",
    "SELECT wayfix_expect({}, seen) FROM (SELECT array_agg(observation ORDER BY step DESC) AS seen \
     FROM drives GROUP BY trace_id)",
    "SELECT wayfix_score({}, [observation]) FROM drives",
];

#[test]
fn an_order_is_asked_for() {
    let folder = Folder::new(&model(1));
    let model = model_of(&folder);
    folder.write("drives.parquet", &long(&drives(31, 300, 1, 40)), 777);
    let query = |sql: &str, key| over(&folder, "drives.parquet", key, &sql.replace("{}", &model));
    for sql in REFUSED {
        // Over a sorted table, too: threads put pieces together in any order.
        for key in [&[] as &[&str], &["trace_id", "step"]] {
            let message = error(&query(sql, key)).to_string();
            let expected = "has no ORDER BY, so the steps of a drive come in any order";
            assert!(message.contains(expected), "{sql}: {message}");
            assert!(message.contains("array_agg("), "{message}");
            assert!(message.contains("observation ORDER BY step)"), "{message}");
        }
    }
    for sql in TAKEN {
        rows(&query(sql, &[]));
    }
}

#[test]
fn a_program_is_told_too() {
    let folder = Folder::new(&model(1));
    let model = model_of(&folder);
    folder.write("drives.parquet", &long(&drives(31, 30, 1, 40)), 777);
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let context = SessionContext::new();
        register(&context);
        let path = folder.path("drives.parquet");
        context
            .register_parquet("drives", path.to_str().unwrap(), ParquetReadOptions::default())
            .await
            .unwrap();
        let ask = |sql: &str| {
            let (context, sql) = (context.clone(), sql.replace("{}", &model));
            async move { context.sql(&sql).await?.collect().await }
        };
        for sql in REFUSED {
            let message = ask(sql).await.unwrap_err().to_string();
            assert!(message.contains("has no ORDER BY"), "{sql}: {message}");
        }
        for sql in TAKEN {
            assert!(ask(sql).await.is_ok(), "{sql}");
        }
    });
}
