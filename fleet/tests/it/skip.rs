//! Drives that are no valid input are left out, and said.

use std::fs;
use std::sync::Arc;

use arrow::array::{ArrayRef, Int64Array, Int64Builder, ListBuilder, RecordBatch};
use rand::RngExt;
use serde_json::{Value, json};
use wayfix::{Hmm, LikelihoodVector};
use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{Job, run};

use crate::kit::*;

/// A run that leaves drives out.
fn job(folder: &Folder, input: &str, output: &str) -> Job {
    let mut job = folder.job(input, output, Verb::Smooth, Table::Steps);
    job.left_out = Some(folder.path(&format!("{output}.jsonl")));
    job
}

fn lines(job: &Job) -> Vec<Value> {
    let text = fs::read_to_string(job.left_out.as_ref().unwrap()).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Rows at fault, their drives, and the beginnings of the reasons.
fn assert_lines(job: &Job, expected: &[(u64, Value, &str, &str)]) {
    let found = lines(job);
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for (line, (row, id, column, reason)) in found.iter().zip(expected) {
        assert_eq!(line["file"], json!(job.inputs[0].to_str().unwrap()));
        assert_eq!((&line["row"], &line["trace_id"]), (&json!(row), id), "{line}");
        assert_eq!(line["column"], json!(column), "{line}");
        assert!(line["reason"].as_str().unwrap().contains(reason), "{line}");
    }
}

type Cells = Vec<[Option<i64>; 3]>;

/// Rows of a trace id, a step and an observation.
fn table(rows: &[[Option<i64>; 3]]) -> RecordBatch {
    let column = |at: usize| -> ArrayRef {
        Arc::new(rows.iter().map(|row| row[at]).collect::<Int64Array>())
    };
    let names = ["trace_id", "step", "observation"];
    let columns = names.into_iter().enumerate().map(|(at, name)| (name, column(at), true));
    RecordBatch::try_from_iter_with_nullable(columns).unwrap()
}

#[test]
fn each_kind_in_the_long_form() {
    let folder = Folder::new(&model(1));
    let row = |id: i64, step: i64, symbol: i64| [Some(id), Some(step), Some(symbol)];
    let rows = [
        [None, Some(1), Some(0)], // 0: without an id
        row(1, 1, 0),
        row(1, 2, 1),
        row(2, 1, 9), // 3: no such symbol
        row(2, 2, 1),
        row(3, 1, 1),
        [Some(3), None, Some(1)], // 6: no step
        row(4, 2, 1),
        row(4, 1, 1), // 8: steps that fall
        row(5, 1, 1),
        row(5, 1, 1), // 10: a step twice
        row(6, 1, 1),
        row(3, 9, 1), // 12: out of order
        row(7, 1, 1),
        [Some(7), Some(2), None], // 14: nothing seen
        row(8, 1, 1),
        [None, Some(2), Some(1)], // 16: within drive 8
        row(8, 3, 1),             // 17
        row(9, 1, -1),            // 18: no such symbol
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
                (10, json!(5), "step", "step 1 of drive 5 is there twice"),
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
    // Drives that are worked on together are others, and so may be the last digit.
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
    // A file that is none still ends the run.
    fs::write(folder.path("bad.csv"), "trace_id,step,observation\n1,1,0\n1,2\n").unwrap();
    job.output = folder.path("none.parquet");
    job.left_out = Some(folder.path("none.jsonl"));
    assert!(go_on(&job).unwrap_err().to_string().contains("line 3"));
    assert!(!folder.has_leftovers());
}

/// Drives in the long form, of which many are at fault at random.
fn faulty(seed: u64, drives: usize) -> Cells {
    let mut rng = rng(seed);
    let mut rows: Cells = Vec::new();
    for id in 0..drives as i64 {
        let length = rng.random_range(1..30);
        let first = rows.len();
        for k in 0..length {
            rows.push([Some(id), Some(step(k)), Some(rng.random_range(0..5))]);
        }
        let at = rng.random_range(first..rows.len());
        match rng.random_range(0..24) {
            0 => rows[at][0] = None,
            1 => rows[at][0] = Some(id / 2),
            2 => rows[at][1] = None,
            3 => rows[at][1] = Some(0),
            4 => rows[at][2] = None,
            5 => rows[at][2] = Some(7),
            _ => {}
        }
    }
    rows
}

/// Rows as text, some of which is none.
fn csv(rows: &[[Option<i64>; 3]]) -> String {
    let cell = |cell: Option<i64>| match cell {
        Some(0) => "0".to_owned(),
        Some(7) => "seven".to_owned(),
        other => other.map(|number| number.to_string()).unwrap_or_default(),
    };
    let line = |row: &[Option<i64>; 3]| row.map(cell).join(",") + "\n";
    "trace_id,step,observation\n".to_owned() + &rows.iter().map(line).collect::<String>()
}

#[test]
fn a_run_goes_on_without_lost_or_doubled_lines() {
    for seed in 0..3 {
        let folder = Folder::new(&model(5));
        let rows = faulty(seed, 500);
        // Row groups are batches: their ends are in the middle of drives.
        folder.write("drives.parquet", &table(&rows), 61);
        fs::write(folder.path("drives.csv"), csv(&rows)).unwrap();
        let input = if seed == 2 { "drives.csv" } else { "drives.parquet" };
        let whole = job(&folder, input, "whole.parquet");
        let mut steps = 0;
        let summary = run(&whole, |_| steps += 1).unwrap();
        assert!(summary.left_out > 50 && summary.parts > 10 && steps > 50, "{summary:?}, {steps}");
        assert_eq!(lines(&whole).len() as u64, summary.left_out);
        let bytes = |job: &Job| {
            let left_out = job.left_out.as_ref().unwrap();
            (fs::read(&job.output).unwrap(), fs::read(left_out).unwrap())
        };
        let expected = bytes(&whole);
        for stride in [1, 2, 5, 40] {
            let job = job(&folder, input, &format!("out{stride}.parquet"));
            let (mut runs, mut resumed, mut done) = (0, 0, None);
            while done.is_none() {
                let mut count = 0;
                let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                    run(&job, |_| {
                        count += 1;
                        // Later each time, so that it comes to an end.
                        assert!(count <= stride + 4 * runs, "interrupted");
                    })
                }));
                runs += 1;
                // A command of another test may hold the locks for a moment.
                if let Ok(Ok(summary)) = stopped {
                    resumed = summary.resumed;
                    done = Some(summary);
                }
                assert!(runs < 500);
            }
            assert!(runs > 2 && resumed > 0, "{runs} runs, {resumed} parts");
            assert!(bytes(&job) == expected, "seed {seed}, {runs} runs");
            let done = done.unwrap();
            assert_eq!((done.drives, done.left_out), (summary.drives, summary.left_out));
        }
    }
}

#[test]
fn without_the_option_finished_parts_stay() {
    let folder = Folder::new(&model(5));
    let mut rows: Cells = Vec::new();
    for id in 0..400 {
        rows.extend((0..10).map(|k| [Some(id), Some(k), Some(k % 5)]));
    }
    let good = table(&rows);
    rows[3005][2] = Some(77);
    folder.write("drives.parquet", &table(&rows), 200);
    let whole = job(&folder, "drives.parquet", "whole.parquet");
    assert_eq!(go_on(&whole).unwrap().left_out, 1);
    assert_lines(&whole, &[(3005, json!(300), "observation", "symbol 77 does not exist")]);

    let mut job = job(&folder, "drives.parquet", "out.parquet");
    let left_out = job.left_out.take();
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("row 3005"), "{error}");
    assert!(folder.has_leftovers() && !job.output.exists());
    job.left_out.clone_from(&left_out);
    let summary = go_on(&job).unwrap();
    assert!(summary.resumed >= 7 && summary.left_out == 1, "{summary:?}");
    assert!(fs::read(&job.output).unwrap() == fs::read(&whole.output).unwrap());
    assert_eq!(lines(&job), lines(&whole));
    assert_eq!(go_on(&job).unwrap().finished, 1);

    // Or with a file that is repaired.
    job.output = folder.path("repaired.parquet");
    job.left_out = None;
    assert!(go_on(&job).is_err());
    folder.write("drives.parquet", &good, 200);
    let summary = go_on(&job).unwrap();
    assert!(summary.resumed >= 7 && summary.drives == 400, "{summary:?}");
    assert!(!folder.has_leftovers());
}

#[test]
fn the_file_of_an_unfinished_run_is_asked_for() {
    let folder = Folder::new(&model(5));
    folder.write("drives.parquet", &table(&faulty(9, 300)), 100);
    let job = job(&folder, "drives.parquet", "out.parquet");
    let stopped =
        std::panic::catch_unwind(|| run(&job, |done| assert!(done.drives < 200, "interrupted")));
    assert!(stopped.is_err());
    let mut other = job.clone();
    other.left_out = None;
    let error = go_on(&other).unwrap_err().to_string();
    assert!(error.contains("give its --skip-invalid again"), "{error}");
    other.left_out = Some(folder.path("other.jsonl"));
    let error = go_on(&other).unwrap_err().to_string();
    assert!(error.contains("other.jsonl.partial is not there"), "{error}");
    // A file of somebody else is not replaced.
    fs::write(job.left_out.as_ref().unwrap(), "mine").unwrap();
    let error = go_on(&job).unwrap_err().to_string();
    assert!(error.contains("out.parquet.jsonl exists; replace it with --force"), "{error}");
    fs::remove_file(job.left_out.as_ref().unwrap()).unwrap();
    other.left_out = Some(other.output.clone());
    let error = go_on(&other).unwrap_err().to_string();
    assert!(error.contains("must be another than the output"), "{error}");
    assert!(go_on(&job).unwrap().resumed > 0);
}
