//! Each kind of fault, in each form.

use std::fs;
use std::sync::Arc;

use arrow::array::{ArrayRef, Int64Array, Int64Builder, ListBuilder, RecordBatch};
use serde_json::json;
use wayfix::{Hmm, LikelihoodVector};

use super::*;

#[test]
fn each_kind_in_the_long_form() {
    let folder = Folder::new(&model(1));
    let row = |id: i64, step: i64, symbol: i64| [Some(id), Some(step), Some(symbol)];
    let rows = [
        [None, Some(1), Some(0)], // 0: without an id
        row(1, 1, 0),
        row(1, 2, 1),
        row(2, 1, 9), // 3: unknown symbol
        row(2, 2, 1),
        row(3, 1, 1),
        [Some(3), None, Some(1)], // 6: no step
        row(4, 2, 1),
        row(4, 1, 1), // 8: decreasing steps
        row(5, 1, 1),
        row(5, 1, 1), // 10: a repeated step
        row(6, 1, 1),
        row(3, 9, 1), // 12: out of order
        row(7, 1, 1),
        [Some(7), Some(2), None], // 14: no observation
        row(8, 1, 1),
        [None, Some(2), Some(1)], // 16: within drive 8
        row(8, 3, 1),             // 17
        row(9, 1, -1),            // 18: unknown symbol
        row(9, 2, 1),
        row(10, 1, 4),
        row(10, 2, 3),
        row(2, 1, 1), // 22: out of order, at the end
    ];
    let valid = |id: &Option<i64>| [Some(1), Some(6), Some(10)].contains(id);
    let good: Cells = [&rows[1..12], &rows[13..22]].concat();
    let good: Cells = good.into_iter().filter(|row| valid(&row[0])).collect();
    folder.write("good.parquet", &table(&good), 100);
    let good = folder.job("good.parquet", "good.out", Verb::Smooth, Table::Steps);
    let (_, expected) = folder.results(&good);
    for group in [1, 2, 3, 5, 7, 100] {
        folder.write("bad.parquet", &table(&rows), group);
        let job = job(&folder, "bad.parquet", &format!("out{group}.parquet"));
        let (summary, found) = folder.results(&job);
        assert_eq!(found, expected, "row groups of {group}");
        assert_eq!((summary.drives, summary.left_out), (3, 11));
        assert_lines(
            &job,
            &[
                (0, json!(null), "trace_id", "is null"),
                (3, json!(2), "observation", "symbol 9 does not exist"),
                (6, json!(3), "step", "is null"),
                (8, json!(4), "step", "step 1 follows step 2 of drive 4"),
                (10, json!(5), "step", "step 1 of drive 5 occurs twice"),
                (12, json!(3), "trace_id", "drive 3 follows drive 6"),
                (14, json!(7), "observation", "is null"),
                (16, json!(null), "trace_id", "is null"),
                (17, json!(8), "trace_id", "other rows stand between those of drive 8"),
                (18, json!(9), "observation", "symbol -1 does not exist"),
                (22, json!(2), "trace_id", "drive 2 follows drive 10"),
            ],
        );
    }
}

#[test]
fn each_kind_in_the_nested_form() {
    let folder = Folder::new(&model(1));
    let lists = |rows: &[Option<Vec<Option<i64>>>]| -> ArrayRef {
        let mut lists = ListBuilder::new(Int64Builder::new());
        rows.iter().for_each(|row| lists.append_option(row.clone()));
        Arc::new(lists.finish())
    };
    let whole = |steps: &[i64]| Some(steps.iter().map(|&step| Some(step)).collect());
    let ids = [Some(7), Some(2), None, Some(4), Some(5), Some(6), Some(1), Some(8)];
    let seen = [
        whole(&[0, 1]),
        None,
        whole(&[1]),
        Some(vec![Some(1), None]),
        whole(&[0, 6]),
        whole(&[0, 1]),
        whole(&[1, 2]),
        whole(&[3, 2, 1]),
    ];
    let steps = [
        whole(&[1, 2]),
        whole(&[]),
        whole(&[1]),
        whole(&[1, 2]),
        whole(&[1, 2]),
        whole(&[2, 1]),
        whole(&[3, 4]),
        whole(&[1]),
    ];
    let table = |kept: &[usize]| {
        let columns: [(&str, ArrayRef); 3] = [
            ("trace_id", Arc::new(kept.iter().map(|&k| ids[k]).collect::<Int64Array>())),
            ("observation", lists(&kept.iter().map(|&k| seen[k].clone()).collect::<Vec<_>>())),
            ("step", lists(&kept.iter().map(|&k| steps[k].clone()).collect::<Vec<_>>())),
        ];
        let columns = columns.into_iter().map(|(name, column)| (name, column, true));
        RecordBatch::try_from_iter_with_nullable(columns).unwrap()
    };
    folder.write("good.parquet", &table(&[0, 6]), 100);
    let good = folder.job("good.parquet", "good.out", Verb::Smooth, Table::Steps);
    let (_, expected) = folder.results(&good);
    for group in [1, 3, 100] {
        folder.write("bad.parquet", &table(&[0, 1, 2, 3, 4, 5, 6, 7]), group);
        let job = job(&folder, "bad.parquet", &format!("out{group}.parquet"));
        let (summary, found) = folder.results(&job);
        assert_eq!(found, expected, "row groups of {group}");
        assert_eq!((summary.drives, summary.left_out), (2, 6));
        assert_lines(
            &job,
            &[
                (1, json!(2), "observation", "is null"),
                (2, json!(null), "trace_id", "is null"),
                (3, json!(4), "observation", "element 1 of the list: is null"),
                (4, json!(5), "observation", "symbol 6 does not exist"),
                (5, json!(6), "step", "step 1 follows step 2"),
                (7, json!(8), "step", "has 1 elements, but column `observation` has 3"),
            ],
        );
    }
}

#[test]
fn likelihoods_below_zero() {
    let seen = model(1);
    let sensor = LikelihoodVector::linear(STATES);
    let folder = Folder::new(&Hmm::new(prior(), seen.transition().clone(), sensor).unwrap());
    let bad = [3, 17, 18, 39];
    let text = |rows: &[usize]| {
        let line = |&row: &usize| {
            let is_bad = |k: usize| k == 2 && bad.contains(&row);
            let value = |k| if is_bad(k) { -1.0 } else { (row + k) as f64 };
            let values: Vec<String> = (0..STATES).map(|k| value(k).to_string()).collect();
            format!("{row},1,{}\n", values.join(" "))
        };
        "trace_id,step,observation\n".to_owned() + &rows.iter().map(line).collect::<String>()
    };
    let all: Vec<usize> = (0..40).collect();
    let valid: Vec<usize> = (0..40).filter(|row| !bad.contains(row)).collect();
    fs::write(folder.path("good.csv"), text(&valid)).unwrap();
    fs::write(folder.path("bad.csv"), text(&all)).unwrap();
    let good = folder.job("good.csv", "good.out", Verb::Smooth, Table::Steps);
    let (_, expected) = folder.results(&good);
    let job = job(&folder, "bad.csv", "out.parquet");
    let (summary, found) = folder.results(&job);
    assert_eq!(integers(&found, "trace_id"), integers(&expected, "trace_id"));
    assert_eq!(states(&found, "state"), states(&expected, "state"));
    let (found, expected) = (numbers(&found, "entropy"), numbers(&expected, "entropy"));
    // Drives are computed in other groups, so the last digit may differ.
    found.iter().zip(&expected).for_each(|(a, b)| close(a.unwrap(), b.unwrap()));
    assert_eq!((summary.drives, summary.left_out), (36, 4));
    let bad = bad.map(|row| {
        (
            row as u64,
            json!(row),
            "observation",
            "state 2 has likelihood -1, expected a finite value",
        )
    });
    assert_lines(&job, &bad);
}

#[test]
fn text_that_cannot_be_read() {
    let folder = Folder::new(&model(1));
    let text = "trace_id,step,observation\n1,1,0\n1,2,x\n2,1,0\n3,y,1\n4,1,2\nfive,1,1\n6,1,3\n";
    fs::write(folder.path("bad.csv"), text).unwrap();
    let good = "trace_id,step,observation\n2,1,0\n4,1,2\n6,1,3\n";
    fs::write(folder.path("good.csv"), good).unwrap();
    let good = folder.job("good.csv", "good.out", Verb::Smooth, Table::Steps);
    let (_, expected) = folder.results(&good);
    let mut job = job(&folder, "bad.csv", "out.parquet");
    let (_, found) = folder.results(&job);
    assert_eq!(found, expected);
    assert_lines(
        &job,
        &[
            (1, json!(1), "observation", "`x` is not a 64-bit integer"),
            (3, json!(3), "step", "`y` is not a 64-bit integer"),
            (5, json!(null), "trace_id", "`five` is not a 64-bit integer"),
        ],
    );
    // An unreadable file still ends the run.
    fs::write(folder.path("bad.csv"), "trace_id,step,observation\n1,1,0\n1,2\n").unwrap();
    job.output = folder.path("none.parquet");
    job.left_out = Some(folder.path("none.jsonl"));
    assert!(go_on(&job).unwrap_err().to_string().contains("line 3"));
    assert!(!folder.has_leftovers());
}

/// One huge id, after which all others are out of order, is an error before memory grows.
#[test]
fn an_id_that_is_far_too_large_ends_the_run() {
    let folder = Folder::new(&model(5));
    let rows = |count: i64| {
        let mut rows: Cells = (0..1000).map(|id| [Some(id), Some(1), Some(2)]).collect();
        rows.push([Some(i64::MAX), Some(1), Some(2)]);
        rows.extend((1000..1000 + count).map(|id| [Some(id), Some(1), Some(2)]));
        table(&rows)
    };
    folder.write("few.parquet", &rows(60_000), 9000);
    let few = job(&folder, "few.parquet", "few.out.parquet");
    let summary = go_on(&few).unwrap();
    assert_eq!((summary.drives, summary.left_out), (1001, 60_000));
    folder.write("many.parquet", &rows(70_000), 9000);
    let many = job(&folder, "many.parquet", "many.out.parquet");
    let error = go_on(&many).unwrap_err().to_string();
    let said = "column `trace_id`, row 1000 (counted from 0): more than 65536 drives after drive \
                9223372036854775807 would be left out";
    assert!(error.contains(said), "{error}");
}

/// Rows without an id do not belong together: each has its line.
#[test]
fn rows_without_an_id_are_named_one_by_one() {
    let folder = Folder::new(&model(1));
    let text = "trace_id,step,observation\n1,1,3\na,1,3\nb,1,3\nc,1,3\n2,1,3\n";
    fs::write(folder.path("text.csv"), text).unwrap();
    let of = |id| [id, Some(1), Some(3)];
    let rows = [of(Some(1)), of(None), of(None), of(None), of(Some(2))];
    folder.write("null.parquet", &table(&rows), 2);
    for (input, reasons) in [
        ("text.csv", ["`a` is not a 64-bit", "`b` is not a 64-bit", "`c` is not a 64-bit"]),
        ("null.parquet", ["is null"; 3]),
    ] {
        let job = job(&folder, input, &format!("{input}.out"));
        let (summary, found) = folder.results(&job);
        assert_eq!((summary.drives, summary.left_out), (2, 3));
        assert_eq!(integers(&found, "trace_id"), [Some(1), Some(2)]);
        let expected = (1..).zip(reasons).map(|(row, why)| (row, json!(null), "trace_id", why));
        assert_lines(&job, &expected.collect::<Vec<_>>());
    }
    // As many as may wait, and more, after a drive and before all drives.
    for (first, said) in [
        (Some(1), "row 0 (counted from 0): more than 65536 drives after drive 1 would be left out"),
        (None, "row 0 (counted from 0): more than 65536 drives would be left out, since their ids"),
    ] {
        let rows = |count: usize| {
            let mut rows = vec![of(first)];
            rows.extend(std::iter::repeat_n(of(None), count));
            table(&[rows, vec![of(Some(2))]].concat())
        };
        folder.write("few.parquet", &rows(65_000), 9000);
        let few = job(&folder, "few.parquet", &format!("few {}", first.is_some()));
        let count = 65_000 + u64::from(first.is_none());
        assert_eq!(go_on(&few).unwrap().left_out, count);
        assert_eq!(lines(&few).len() as u64, count);
        folder.write("many.parquet", &rows(70_000), 9000);
        let many = job(&folder, "many.parquet", "many.out");
        let error = go_on(&many).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}
