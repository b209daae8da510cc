//! Queries by parts of a sorted table, and queries that cannot be run so.

use std::fs;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Instant;

use arrow::array::RecordBatch;
use rand::RngExt;
use wayfix_fleet::sql::{Query, QueryState, QuerySummary, query};

use crate::kit::*;
use crate::tables::*;

/// A long table, a nested one, and the long one in a folder of three files whose borders lie within
/// drives.
fn prepare() -> Folder {
    let folder = Folder::new(&model(6));
    let drives = drives(51, 600, 1, 40);
    let rows = long(&drives);
    folder.write("long.parquet", &rows, 300);
    folder.write("nested.parquet", &nested(&drives), 20);
    fs::create_dir(folder.path("days")).unwrap();
    for (day, from) in (0..rows.num_rows()).step_by(rows.num_rows().div_ceil(3)).enumerate() {
        let count = rows.num_rows().div_ceil(3).min(rows.num_rows() - from);
        folder.write(&format!("days/{day}.parquet"), &rows.slice(from, count), 300);
    }
    folder
}

/// Runs a query, and returns its rows, its outcome, and what prevented parts.
fn run(of: &Query) -> (RecordBatch, QuerySummary, Option<String>) {
    let mut whole = None;
    let mut last = 0;
    let summary = query(of, |state| match state {
        QueryState::Whole(reason) => whole = Some(reason.clone()),
        QueryState::Rows { done, all, .. } => {
            assert!(*done >= last && all.is_none_or(|all| *done <= all));
            last = *done;
        }
        _ => {}
    });
    (read(&of.output), summary.unwrap(), whole)
}

const GATHERED: &str = "SELECT trace_id AS id, array_agg(observation ORDER BY step) AS seen, \
                        count(*) AS steps FROM drives WHERE observation < 5 GROUP BY trace_id";

#[test]
fn rows_are_those_of_the_whole_query() {
    let folder = prepare();
    let model = model_of(&folder);
    let smooth = format!("SELECT id, steps, wayfix_smooth({model}, seen) AS s FROM ({GATHERED})");
    for (input, sql) in [
        ("long.parquet", smooth.clone()),
        ("days", smooth.clone()),
        ("long.parquet", format!("{smooth} ORDER BY id, steps")),
        (
            "long.parquet",
            format!(
                "SELECT id, unnest(wayfix_decode({model}, seen)) AS at FROM ({GATHERED}) WHERE \
                 steps > 3"
            ),
        ),
        ("nested.parquet", format!("SELECT *, wayfix_score({model}, observation) s FROM drives")),
    ] {
        let key: &[&str] =
            if input == "nested.parquet" { &["trace_id"] } else { &["trace_id", "step"] };
        let mut of = over(&folder, input, key, &sql);
        of.part = 0;
        let (expected, summary, whole) = run(&of);
        assert_eq!((summary.parts, whole.unwrap()), (0, "--part is 0".to_owned()));
        assert!(expected.num_rows() > 500);
        for (part, threads, least) in [(1, 3, 20), (1000, 2, 8), (1 << 20, 1, 1)] {
            (of.part, of.threads) = (part, threads);
            let (found, summary, whole) = run(&of);
            assert_eq!(whole, None, "{sql}");
            assert!(summary.parts >= least && summary.resumed == 0, "{summary:?}");
            assert_eq!(summary.rows, found.num_rows() as u64);
            same_rows(&found, &expected);
        }
    }
}

#[test]
fn what_needs_other_rows_is_named() {
    let folder = prepare();
    let model = model_of(&folder);
    for (sql, expected) in [
        ("SELECT a.step FROM drives a JOIN drives b USING (trace_id)", "reads several tables"),
        ("SELECT step FROM drives UNION ALL SELECT step FROM drives", "reads several tables"),
        ("SELECT step FROM drives LIMIT 3", "needs other rows"),
        ("SELECT DISTINCT trace_id FROM drives", "needs other rows"),
        ("SELECT row_number() OVER () FROM drives", "needs other rows"),
        ("SELECT step FROM drives ORDER BY step", "needs all rows"),
        ("SELECT trace_id FROM drives ORDER BY trace_id DESC", "needs all rows"),
        ("SELECT count(*) FROM drives", "groups rows of different `trace_id`"),
        ("SELECT step, count(*) FROM drives GROUP BY step", "groups rows of different `trace_id`"),
        (
            "SELECT -trace_id AS trace_id, count(*) FROM drives GROUP BY 1",
            "groups rows of different `trace_id`",
        ),
        (
            "SELECT trace_id, count(*) FROM (SELECT step AS trace_id FROM drives) GROUP BY 1",
            "groups rows of different `trace_id`",
        ),
        (
            "SELECT trace_id, count(*) FROM drives GROUP BY ROLLUP (trace_id)",
            "groups rows of different `trace_id`",
        ),
        ("SELECT step FROM drives WHERE step > (SELECT min(step) FROM drives)", "a subquery"),
        ("SELECT step FROM drives WHERE step IN (SELECT step FROM drives)", "a subquery"),
        ("SELECT step, random() FROM drives", "random depends on when it is called"),
        ("SELECT step, now() FROM drives", "now depends on when it is called"),
        ("EXPLAIN SELECT step FROM drives", "needs other rows"),
        ("SELECT 1", "needs other rows"),
    ] {
        let of = over(&folder, "long.parquet", &["trace_id", "step"], sql);
        let (_, summary, whole) = run(&of);
        assert!(whole.as_ref().is_some_and(|whole| whole.contains(expected)), "{sql}: {whole:?}");
        assert_eq!(summary.parts, 0);
    }
    // A table without rows makes one part without rows.
    folder.write("none.parquet", &long(&[]), 10);
    let sql = "SELECT step FROM drives";
    let none = over(&folder, "none.parquet", &["trace_id", "step"], sql);
    assert_eq!(run(&none), (read(&none.output), QuerySummary { parts: 1, ..run(&none).1 }, None));
    assert_eq!(read(&none.output).num_rows(), 0);
    let sql = format!("SELECT wayfix_score({model}, observation) FROM drives");
    let (_, _, whole) = run(&over(&folder, "nested.parquet", &[], &sql));
    assert_eq!(whole.unwrap(), "no table has an --order");
    fs::write(folder.path("a.csv"), "trace_id,step\n1,1\n").unwrap();
    let (_, _, whole) = run(&over(&folder, "a.csv", &["trace_id"], "SELECT * FROM drives"));
    assert_eq!(whole.unwrap(), "a CSV file can only be read as a whole");
}

fn smoothing(folder: &Folder) -> Query {
    let model = model_of(folder);
    let sql = format!(
        "SELECT trace_id, max(step) / 2.5 AS last, cast(count(*) AS int) AS steps, \
         arrow_cast(min(step), 'UInt64') AS first, wayfix_smooth({model}, \
         array_agg(observation ORDER BY step)) AS s FROM drives GROUP BY trace_id"
    );
    over(folder, "long.parquet", &["trace_id", "step"], &sql)
}

/// Leaves a query with some parts behind, by a panic halfway.
fn interrupt(of: &Query) {
    let of = of.clone();
    let stopped = thread::spawn(move || {
        query(&of, |state| {
            assert!(!matches!(state, QueryState::Rows { done: 4000.., .. }), "interrupted");
        })
    });
    assert!(stopped.join().is_err());
}

#[test]
fn an_interrupted_query_goes_on() {
    let folder = prepare();
    let mut of = smoothing(&folder);
    of.force = false;
    of.part = 300;
    let (_, summary, _) = run(&of);
    assert!(summary.parts > 20);
    let expected = fs::read(&of.output).unwrap();
    // It says that it is finished, and another query does not replace it.
    let again = query(&of, |_| {}).unwrap();
    assert_eq!((again.rows, again.parts, again.finished), (summary.rows, 0, true));
    let other = Query { batch: 8, ..of.clone() };
    let message = query(&other, |_| {}).unwrap_err().to_string();
    assert!(message.contains("exists; replace it with --force"), "{message}");
    fs::remove_file(&of.output).unwrap();

    interrupt(&of);
    let refused = |of: &Query, expected: &str| {
        let message = query(of, |_| {}).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    };
    refused(&other, "batch is 8, was 16");
    refused(&Query { sql: of.sql.replace("2.5", "2.0"), ..of.clone() }, "query is ");
    refused(&Query { part: 0, ..of.clone() }, "is from an unfinished run");
    refused(&Query { sql: "SELECT count(*) FROM drives".to_owned(), ..of.clone() }, "unfinished");
    let input = fs::read(folder.path("long.parquet")).unwrap();
    folder.write("long.parquet", &long(&drives(52, 600, 0, 40)), 300);
    refused(&of, "content of the table is ");
    fs::write(folder.path("long.parquet"), input).unwrap();
    let (_, resumed, _) = run(&of);
    assert!(resumed.resumed > 3 && resumed.resumed < resumed.parts, "{resumed:?}");
    assert_eq!((resumed.rows, resumed.parts), (summary.rows, summary.parts));
    assert!(fs::read(&of.output).unwrap() == expected);

    // Another model under the same name. This process would not notice, as it has read the first.
    fs::remove_file(&of.output).unwrap();
    interrupt(&of);
    fs::write(folder.path("model.json"), serde_json::to_vec(&model(7)).unwrap()).unwrap();
    let told = command(&folder, &of).stderr(Stdio::piped()).output().unwrap();
    let told = String::from_utf8(told.stderr).unwrap();
    assert!(told.contains("models is "), "{told}");
    of.restart = true;
    assert_eq!(run(&of).1.resumed, 0);
    assert!(fs::read(&of.output).unwrap() == expected);
    assert!(!folder.has_leftovers());
}

/// An error in a part keeps the parts before it, and leaves nothing if there are none.
#[test]
fn an_error_is_an_interruption() {
    let folder = prepare();
    let mut of = smoothing(&folder);
    of.part = 300;
    of.sql = of.sql.replace("observation ORDER", "observation + (trace_id / 500) * 90 ORDER");
    let message = query(&of, |_| {}).unwrap_err().to_string();
    assert!(message.contains("symbol 9"), "{message}");
    assert!(folder.has_leftovers() && !of.output.exists());
    assert!(!of.output.with_extension("parquet.unfinished").exists());
    let of = Query { sql: of.sql.replace("/ 500", "- trace_id + 1"), restart: true, ..of };
    error(&of);
}

fn command(folder: &Folder, of: &Query) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
    command.args(["sql", "--threads", "2", "--order", "trace_id,step", "--batch", "16"]);
    command.args(["--part", "300", "--query", &of.sql]);
    command.arg("--table").arg(format!("drives={}", folder.path("long.parquet").display()));
    command.arg("--output").arg(&of.output).stdout(Stdio::null());
    command
}

/// Kills the command at random moments, as often as `WAYFIX_KILLS` says, and compares the bytes.
#[test]
fn a_killed_query_goes_on() {
    let folder = prepare();
    let of = smoothing(&folder);
    let start = Instant::now();
    let said = command(&folder, &of).arg("--lines").output().unwrap();
    let whole = start.elapsed();
    let said = String::from_utf8(said.stderr).unwrap();
    assert!(said.lines().count() > 20 && said.contains(" rows, 600 rows made"), "{said}");
    let expected = fs::read(&of.output).unwrap();
    let kills = std::env::var("WAYFIX_KILLS").ok().and_then(|kills| kills.parse().ok());
    let (mut rng, mut left) = (rng(8), kills.unwrap_or(6_u32));
    let mut resumed = 0;
    while left > 0 {
        fs::remove_file(&of.output).unwrap();
        loop {
            let begun = folder.has_leftovers();
            let mut child = command(&folder, &of).stderr(Stdio::null()).spawn().unwrap();
            if left > 0 {
                thread::sleep(whole.mul_f64(rng.random_range(0.0..1.1)));
                // Fails if the process has already ended.
                _ = child.kill();
                left -= 1;
            }
            let done = child.wait().unwrap().success();
            resumed += u32::from(begun);
            if done || (of.output.exists() && !folder.has_leftovers()) {
                break;
            }
        }
        assert!(fs::read(&of.output).unwrap() == expected, "{left} kills left");
        // A lock file left by a killed run does not get in the way.
        let told = command(&folder, &of).stderr(Stdio::piped()).output().unwrap();
        assert!(told.status.success() && told.stderr.is_empty(), "{told:?}");
        assert!(!of.output.with_extension("parquet.unfinished").exists());
    }
    assert!(resumed > 0);
}
