//! Invalid drives are left out and reported.

mod going_on;
mod kinds;

use std::fs;
use std::sync::Arc;

use arrow::array::{ArrayRef, Int64Array, RecordBatch};
use serde_json::{Value, json};
use wayfix_fleet::Job;
use wayfix_fleet::output::{Table, Verb};

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
