//! Errors name the argument, the row and the step, and leave nothing behind.

use std::fs;
use std::sync::Arc;

use arrow::array::{ArrayRef, Int64Array, Int64Builder, ListBuilder, RecordBatch, StringArray};
use wayfix::{Hmm, LikelihoodVector, SparseLikelihood};
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::places::Places;

use crate::kit::*;
use crate::tables::*;

/// Drives of a few symbols, which may be missing.
fn symbols(drives: &[Option<Vec<Option<i64>>>]) -> RecordBatch {
    let mut lists = ListBuilder::new(Int64Builder::new());
    for drive in drives {
        match drive {
            Some(symbols) => lists.append_value(symbols.iter().copied()),
            None => lists.append_null(),
        }
    }
    let ids: ArrayRef = Arc::new(Int64Array::from_iter_values(0..drives.len() as i64));
    let columns = [("trace_id", ids), ("seen", Arc::new(lists.finish()) as ArrayRef)];
    RecordBatch::try_from_iter(columns).unwrap()
}

#[expect(clippy::unnecessary_wraps, reason = "a drive may be null")]
fn some(symbols: &[i64]) -> Option<Vec<Option<i64>>> {
    Some(symbols.iter().copied().map(Some).collect())
}

/// Message for a query over a table.
fn refused(folder: &Folder, table: &RecordBatch, sql: &str) -> String {
    folder.write("drives.parquet", table, 4);
    error(&over(folder, "drives.parquet", &[], sql)).to_string()
}

#[track_caller]
fn contains(message: &str, expected: &str) {
    assert!(message.contains(expected), "{message}");
}

#[test]
fn rows_and_steps_are_named() {
    let folder = Folder::new(&model(1));
    let model = model_of(&folder);
    let table =
        symbols(&[some(&[0, 1, 2]), some(&[3]), some(&[0, 1, 0, 9, 0, 1, 2, 3, 4]), some(&[])]);
    for function in ["wayfix_score", "wayfix_smooth", "wayfix_filter", "wayfix_decode"] {
        let sql = format!("SELECT {function}({model}, seen) FROM drives");
        contains(
            &refused(&folder, &table, &sql),
            &format!(
                "{function}: column `observations`, row 2 (counted from 0): element 3 of the list: \
                 symbol 9 does not exist, the model has 6 symbols (0 to 5); rows are those of a \
                 batch of 4, in which this drive begins with 0, 1, 0, 9, 0, 1, 2, 3"
            ),
        );
    }
    let sql = format!("SELECT wayfix_smooth({model}, seen) FROM drives");
    let table = symbols(&[some(&[0]), Some(vec![Some(0), None])]);
    contains(
        &refused(&folder, &table, &sql),
        "`observations`, row 1 (counted from 0): element 1 of the list: is null, expected a value",
    );
    let table = symbols(&[some(&[0]), None, some(&[1])]);
    contains(
        &refused(&folder, &table, &sql),
        "`observations`, row 1 (counted from 0): is null, expected a value",
    );
}

#[test]
fn types_and_numbers_of_arguments() {
    let folder = Folder::new(&model(1));
    let model = model_of(&folder);
    let table = symbols(&[some(&[0, 1, 2])]);
    let refused = |sql: &str| refused(&folder, &table, sql);
    contains(
        &refused(&format!("SELECT wayfix_smooth({model}, trace_id) FROM drives")),
        "column `observations`: has the type Int64, that of one observation; expected a list",
    );
    contains(
        &refused(&format!("SELECT wayfix_smooth({model}, [1.5, trace_id]) FROM drives")),
        "column `observations`: has the type List(Float64), expected an integer (a symbol), or a \
         list of these for each drive",
    );
    contains(
        &refused(&format!("SELECT wayfix_smooth({model}, [[trace_id]]) FROM drives")),
        "expected an integer (a symbol), or a list of these for each drive",
    );
    contains(
        &refused(&format!("SELECT wayfix_smooth({model}, NULL) FROM drives")),
        "column `observations`: has the type Null, expected",
    );
    contains(
        &refused(&format!("SELECT wayfix_smooth({model}, seen, seen) FROM drives")),
        "2 arguments after the model, but its sensor takes `observations`",
    );
    let count = refused(&format!("SELECT wayfix_smooth({model}) FROM drives"));
    contains(&count, "wayfix_smooth");
    for model in ["trace_id", "NULL", "3", "concat('a', trace_id)"] {
        contains(
            &refused(&format!("SELECT wayfix_smooth({model}, seen) FROM drives")),
            "the first argument of wayfix_smooth is the model, expected a literal text",
        );
    }
}

#[test]
fn models_that_do_not_fit() {
    let folder = Folder::new(&model(1));
    let table = symbols(&[some(&[0, 1, 2])]);
    let refused = |model: &str| {
        refused(&folder, &table, &format!("SELECT wayfix_decode('{model}', seen) FROM drives"))
    };
    let write = |name: &str, text: &[u8]| {
        fs::write(folder.path(name), text).unwrap();
        folder.path(name).to_str().unwrap().to_owned()
    };
    let path = folder.path("model.json").to_str().unwrap().to_owned();
    contains(&refused(&format!("{path}.none")), "model.json.none: No such file");
    contains(&refused(&write("text.json", b"{}")), "text.json: not a model");
    let hash = format!("{path}#{}", "0".repeat(32));
    contains(&refused(&hash), "model.json: has the hash ");
    let mut rng = rng(1);
    let vector = Hmm::new(prior(), transition(&mut rng), LikelihoodVector::linear(STATES).owned());
    let vector = serde_json::to_vec(&vector.unwrap()).unwrap();
    contains(
        &refused(&write("vector.json", &vector)),
        "has the type List(Int64), expected a list of floating-point numbers (one for each state)",
    );
    let sparse = Hmm::new(prior(), transition(&mut rng), SparseLikelihood::new(STATES)).unwrap();
    let sparse = serde_json::to_vec(&sparse).unwrap();
    contains(&refused(&write("sparse.json", &sparse)), "expected a list of structs of `state`");
    let place = |_| wayfix::map::Position { latitude: -35.3, longitude: 149.1 };
    let places = Places::new((0..STATES).map(place).collect(), 3.0).unwrap();
    let places = serde_json::to_vec(&Hmm::new(prior(), transition(&mut rng), places).unwrap());
    contains(
        &refused(&write("places.json", &places.unwrap())),
        "1 arguments after the model, but its sensor takes `latitudes`, `longitudes`, `deviations`",
    );
    // Likelihoods for a model with another number of states.
    let lists = "SELECT trace_id, [[0.5, 0.25]] AS seen FROM drives";
    let path = write("vector.json", &vector);
    let sql = format!("SELECT wayfix_score('{path}', seen) FROM ({lists})");
    let message = error(&over(&folder, "drives.parquet", &[], &sql)).to_string();
    contains(
        &message,
        "row 0 (counted from 0): element 0 of the list: has 2 values, expected one for each of the \
         11 states of the model",
    );
}

#[test]
fn a_table_must_be_in_the_order_that_is_said() {
    let folder = Folder::new(&model(1));
    let column = |values: [Option<i64>; 6]| Arc::new(Int64Array::from(values.to_vec())) as ArrayRef;
    let all = |values: [i64; 6]| column(values.map(Some));
    let sql = "SELECT trace_id, array_agg(seen ORDER BY step) FROM drives GROUP BY trace_id";
    for (ids, steps, expected) in [
        (
            all([1, 1, 2, 2, 1, 2]),
            all([1, 2, 1, 2, 3, 3]),
            "column `trace_id`, `step`, row 4 (counted from 0): (1, 3) follows (2, 2), expected \
             rows sorted by these columns, without duplicates",
        ),
        (all([1, 1, 2, 2, 3, 3]), all([1, 2, 3, 2, 1, 2]), "row 3 (counted from 0): (2, 2)"),
        (all([1, 1, 2, 2, 3, 3]), all([1, 2, 1, 1, 1, 2]), "row 3 (counted from 0): (2, 1)"),
        (
            all([1, 1, 2, 2, 3, 3]),
            column([Some(1), Some(2), Some(1), Some(2), None, Some(1)]),
            "column `step`, row 4 (counted from 0): is null, expected a value",
        ),
    ] {
        let columns = [("trace_id", ids), ("step", steps.clone()), ("seen", all([0; 6]))];
        let columns = columns.map(|(name, column)| (name, column, true));
        let table = RecordBatch::try_from_iter_with_nullable(columns).unwrap();
        folder.write("drives.parquet", &table, 2);
        let query = over(&folder, "drives.parquet", &["trace_id", "step"], sql);
        contains(&error(&query).to_string(), expected);
    }
    // Across two batches; and text.
    let mut ids: Vec<i64> = (0..70_000).collect();
    ids[65_536] = 65_535;
    let texts: StringArray = ids.iter().map(|id| Some(format!("{id:06}"))).collect();
    let numbers: ArrayRef = Arc::new(Int64Array::from(ids));
    for column in [numbers, Arc::new(texts)] {
        let table = RecordBatch::try_from_iter([("trace_id", column)]).unwrap();
        folder.write("drives.parquet", &table, 100_000);
        let query = over(&folder, "drives.parquet", &["trace_id"], "SELECT * FROM drives");
        contains(&error(&query).to_string(), "row 65536 (counted from 0)");
    }
    let query = over(&folder, "drives.parquet", &["other"], "SELECT * FROM drives");
    contains(&error(&query).to_string(), "other");
    folder.write("drives.parquet", &symbols(&[some(&[0]), some(&[1])]), 2);
    let query = over(&folder, "drives.parquet", &["seen"], "SELECT * FROM drives");
    contains(
        &error(&query).to_string(),
        "column `seen` is nested, expected numbers, text or times",
    );
}

#[test]
fn files_and_queries() {
    let folder = Folder::new(&model(1));
    let model = model_of(&folder);
    folder.write("drives.parquet", &symbols(&vec![some(&[0, 1, 2, 3]); 2000]), 100);
    let sql = format!("SELECT wayfix_smooth({model}, seen) FROM drives");
    let bytes = fs::read(folder.path("drives.parquet")).unwrap();
    fs::write(folder.path("cut.parquet"), &bytes[..bytes.len() / 2]).unwrap();
    fs::write(folder.path("empty.parquet"), []).unwrap();
    for input in ["cut.parquet", "empty.parquet", "none.parquet"] {
        error(&over(&folder, input, &[], &sql));
    }
    let mut bad = bytes;
    let middle = bad.len() / 2;
    bad[..middle].iter_mut().skip(4).for_each(|byte| *byte = 0xff);
    fs::write(folder.path("bad.parquet"), bad).unwrap();
    error(&over(&folder, "bad.parquet", &[], &sql));
    for sql in ["SELECT", "SELECT nothing FROM drives", "DROP TABLE drives", "COPY drives TO 'x'"] {
        error(&over(&folder, "drives.parquet", &[], sql));
    }
    // An existing output is left alone.
    fs::write(folder.path("rows.parquet"), b"mine").unwrap();
    let mut query = over(&folder, "drives.parquet", &[], &sql);
    query.force = false;
    let message = wayfix_fleet::sql::query(&query, |_| {}).unwrap_err().to_string();
    contains(&message, "exists");
    assert_eq!(fs::read(folder.path("rows.parquet")).unwrap(), b"mine");
    // The command returns what the function returns.
    query.force = true;
    let found = rows(&query);
    let file = nested(&vec![vec![0, 1, 2, 3]; 2000]);
    folder.write("nested.parquet", &file, 100);
    let job = folder.job("nested.parquet", "out", Verb::Smooth, Table::Steps);
    let (_, expected) = folder.results(&job);
    assert_eq!(list(&found, found.schema().field(0).name()), list(&expected, "results"));
}

#[test]
fn runs_do_not_share_an_output() {
    let folder = Folder::new(&model(1));
    folder.write("drives.parquet", &symbols(&vec![some(&[0, 1, 2, 3]); 2000]), 100);
    let run = |k: i64, round: usize, force: bool| {
        let sql = format!("SELECT {k} AS k FROM drives");
        let mut query = over(&folder, "drives.parquet", &[], &sql);
        query.output = folder.path(&format!("rows {round}.parquet"));
        query.force = force;
        wayfix_fleet::sql::query(&query, |_| {})
    };
    for round in 0..20 {
        let force = round % 2 == 1;
        let (a, b) = std::thread::scope(|scope| {
            let other = scope.spawn(|| run(1, round, force));
            (run(0, round, force), other.join().unwrap())
        });
        // Both only if one began after the other had ended, and may replace it.
        assert!(a.is_ok() || b.is_ok());
        assert!(force || a.is_err() || b.is_err());
        for refused in [&a, &b].into_iter().filter_map(|done| done.as_ref().err()) {
            let message = refused.to_string();
            assert!(message.contains("holds the lock") || message.contains("exists"), "{message}");
        }
        let found = integers(&read(&folder.path(&format!("rows {round}.parquet"))), "k");
        assert_eq!(found.len(), 2000);
        assert!(found.iter().all(|k| *k == found[0]), "rows of both");
        let of = [a, b].map(|done| done.is_ok());
        assert!(of[usize::from(found[0] == Some(1))], "rows of a run that was refused");
        assert!(!folder.path(&format!("rows {round}.parquet.unfinished")).exists());
    }
}

#[cfg(unix)]
#[test]
fn a_model_is_a_file() {
    let folder = Folder::new(&model(1));
    let table = symbols(&[some(&[0, 1])]);
    let pipe = folder.path("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    for name in [pipe.to_str().unwrap(), "/dev/zero", "/"] {
        let sql = format!("SELECT wayfix_score('{name}', seen) FROM drives");
        contains(&refused(&folder, &table, &sql), "is not a file");
    }
}
