//! Errors name the column and the row, and leave nothing behind if no part was finished.

use std::fs;
use std::sync::Arc;

use arrow::array::{
    ArrayRef, Float64Builder, Int64Array, ListBuilder, RecordBatch, StringArray, UInt64Array,
};
use wayfix::{Hmm, LikelihoodVector};

use crate::kit::*;

/// Runs on a table and expects an error; checks that nothing is left, and returns the message.
fn refused(folder: &Folder, rows: &RecordBatch) -> String {
    folder.write("bad.parquet", rows, 4);
    let error = folder.error("bad.parquet");
    assert!(!folder.has_leftovers(), "{error}");
    error.to_string()
}

fn refused_csv(folder: &Folder, text: &str) -> String {
    fs::write(folder.path("bad.csv"), text).unwrap();
    let error = folder.error("bad.csv");
    assert!(!folder.has_leftovers(), "{error}");
    error.to_string()
}

fn rows(columns: Vec<(&str, ArrayRef)>) -> RecordBatch {
    RecordBatch::try_from_iter_with_nullable(
        columns.into_iter().map(|(name, column)| (name, column, true)),
    )
    .unwrap()
}

fn numbers(values: impl Into<Int64Array>) -> ArrayRef {
    Arc::new(values.into())
}

/// Seven rows: drive 3 with two steps, drive 5 with five.
fn with(change: &str, column: &ArrayRef) -> RecordBatch {
    let mut columns = vec![
        ("trace_id", numbers(vec![3, 3, 5, 5, 5, 5, 5])),
        ("step", numbers(vec![1, 2, 1, 2, 3, 4, 5])),
        ("observation", numbers(vec![0, 1, 2, 3, 4, 0, 1])),
    ];
    columns.iter_mut().filter(|(name, _)| *name == change).for_each(|(_, c)| *c = column.clone());
    rows(columns)
}

#[test]
fn rows_and_columns_are_named() {
    let folder = Folder::new(&model(1));
    for (column, values, message) in [
        (
            "trace_id",
            vec![Some(3), Some(3), Some(5), Some(5), None, Some(5), Some(5)],
            "column `trace_id`, row 4 (counted from 0): is null, expected a value",
        ),
        (
            "trace_id",
            vec![Some(3), Some(3), Some(5), Some(5), Some(5), Some(3), Some(3)],
            "column `trace_id`, row 5 (counted from 0): drive 3 follows drive 5, expected rows \
             sorted by drive (numbers by value, text by its bytes)",
        ),
        (
            "step",
            vec![Some(1), Some(2), Some(1), Some(2), Some(2), Some(4), Some(5)],
            "column `step`, row 4 (counted from 0): step 2 of drive 5 occurs twice",
        ),
        (
            "step",
            vec![Some(2), Some(1), Some(1), Some(2), Some(3), Some(4), Some(5)],
            "column `step`, row 1 (counted from 0): step 1 follows step 2 of drive 3, expected \
             increasing steps",
        ),
        (
            "step",
            vec![Some(1), Some(2), Some(1), Some(2), Some(3), Some(4), None],
            "column `step`, row 6 (counted from 0): is null, expected a value",
        ),
        (
            "observation",
            vec![Some(0), Some(1), None, Some(3), Some(4), Some(0), Some(1)],
            "column `observation`, row 2 (counted from 0): is null, expected a value",
        ),
        (
            "observation",
            vec![Some(0), Some(1), Some(2), Some(6), Some(4), Some(0), Some(1)],
            "column `observation`, row 3 (counted from 0): symbol 6 does not exist, the model has \
             6 symbols (0 to 5)",
        ),
        (
            "observation",
            vec![Some(0), Some(1), Some(2), Some(-1), Some(4), Some(0), Some(1)],
            "column `observation`, row 3 (counted from 0): symbol -1 does not exist, the model \
             has 6 symbols (0 to 5)",
        ),
    ] {
        assert_eq!(refused(&folder, &with(column, &numbers(values))), message);
    }
    let large = UInt64Array::from(vec![0, 1, 2, u64::MAX, 0, 0, 0]);
    assert_eq!(
        refused(&folder, &with("step", &(Arc::new(large) as ArrayRef))),
        "column `step`, row 3 (counted from 0): cannot be read as a 64-bit integer"
    );
}

#[test]
fn columns_are_found_and_have_types() {
    let folder = Folder::new(&model(1));
    let good = with("", &numbers(vec![0]));
    for (left, message) in [
        (0, "column `trace_id`: is missing; there are `step`, `observation`"),
        (1, "column `step`: is missing; there are `trace_id`, `observation`"),
        (2, "column `observation`: is missing; there are `trace_id`, `step`"),
    ] {
        let kept: Vec<usize> = (0..3).filter(|&column| column != left).collect();
        assert_eq!(refused(&folder, &good.project(&kept).unwrap()), message);
    }
    let text: ArrayRef = Arc::new(StringArray::from(vec!["1"; 7]));
    assert_eq!(
        refused(&folder, &with("observation", &text)),
        "column `observation`: has the type Utf8, expected an integer (a symbol), or a list of \
         these for each drive"
    );
    assert_eq!(
        refused(&folder, &with("step", &text)),
        "column `step`: has the type Utf8, expected an integer"
    );
    let real: ArrayRef = Arc::new(arrow::array::Float64Array::from(vec![1.0; 7]));
    assert_eq!(
        refused(&folder, &with("trace_id", &real)),
        "column `trace_id`: has the type Float64, expected an integer or text"
    );
}

#[test]
fn lists_are_checked() {
    let folder = Folder::new(&model(1));
    let mut lists = ListBuilder::new(arrow::array::Int64Builder::new());
    lists.append_value([Some(0), Some(1)]);
    lists.append_value([Some(0), None]);
    let nested =
        rows(vec![("trace_id", numbers(vec![1, 2])), ("observation", Arc::new(lists.finish()))]);
    assert_eq!(
        refused(&folder, &nested),
        "column `observation`, row 1 (counted from 0): element 1 of the list: is null, expected a \
         value"
    );
    let mut lists = ListBuilder::new(arrow::array::Int64Builder::new());
    lists.append_value([Some(0), Some(1)]);
    lists.append_value([Some(0), Some(3)]);
    let mut steps = ListBuilder::new(arrow::array::Int64Builder::new());
    steps.append_value([Some(0), Some(1)]);
    steps.append_value([Some(0), Some(0)]);
    let lists: ArrayRef = Arc::new(lists.finish());
    let nested = rows(vec![
        ("trace_id", numbers(vec![1, 2])),
        ("observation", lists.clone()),
        ("step", Arc::new(steps.finish())),
    ]);
    assert_eq!(
        refused(&folder, &nested),
        "column `step`, row 1 (counted from 0): element 1 of the list: step 0 follows step 0, \
         expected increasing steps"
    );
    steps.append_value([Some(0), Some(1)]);
    steps.append_value([Some(0)]);
    let nested = rows(vec![
        ("trace_id", numbers(vec![1, 2])),
        ("observation", lists),
        ("step", Arc::new(steps.finish())),
    ]);
    assert_eq!(
        refused(&folder, &nested),
        "column `step`, row 1 (counted from 0): has 1 elements, but column `observation` has 2"
    );
}

#[test]
fn a_model_of_another_size_is_refused() {
    let seen = model(1);
    let sensor = LikelihoodVector::linear(STATES);
    let model = Hmm::new(prior(), seen.transition().clone(), sensor).unwrap();
    let folder = Folder::new(&model);
    let of = |lengths: [usize; 7], bad: f64| -> ArrayRef {
        let mut lists = ListBuilder::new(Float64Builder::new());
        for (row, length) in lengths.into_iter().enumerate() {
            lists.append_value(
                (0..length).map(|k| Some(if (row, k) == (4, 2) { bad } else { 0.5 })),
            );
        }
        Arc::new(lists.finish())
    };
    assert_eq!(
        refused(&folder, &with("observation", &of([11, 11, 11, 10, 11, 11, 11], 0.5))),
        "column `observation`, row 3 (counted from 0): has 10 values, expected one for each of \
         the 11 states of the model"
    );
    assert_eq!(
        refused(&folder, &with("observation", &of([11; 7], -1.0))),
        "column `observation`, row 4 (counted from 0): state 2 has likelihood -1, expected a \
         finite value of at least 0"
    );
}

#[test]
fn damaged_files_are_refused() {
    let folder = Folder::new(&model(1));
    fs::write(folder.path("bad.parquet"), "").unwrap();
    assert!(folder.error("bad.parquet").to_string().contains("bad.parquet"));
    assert!(folder.error("none.parquet").to_string().contains("none.parquet: No such file"));

    let drives = drives(2, 4000, 10, 20);
    folder.write("whole.parquet", &long(&drives), 10_000);
    let whole = fs::read(folder.path("whole.parquet")).unwrap();
    for length in [whole.len() - 1, whole.len() / 2, 100, 4] {
        fs::write(folder.path("bad.parquet"), &whole[..length]).unwrap();
        let error = folder.error("bad.parquet").to_string();
        assert!(error.contains("bad.parquet: "), "{error}");
        assert!(!folder.has_leftovers());
    }
    // A file with a hole, whose first part is intact.
    let mut damaged = whole.clone();
    let middle = whole.len() / 2;
    damaged[middle..middle + 2000].fill(0xa5);
    fs::write(folder.path("bad.parquet"), damaged).unwrap();
    let job = folder.job(
        "bad.parquet",
        "out.parquet",
        wayfix_fleet::output::Verb::Smooth,
        wayfix_fleet::output::Table::Steps,
    );
    assert!(wayfix_fleet::run(&job, |_| {}).is_err());
    // Parts finished before the error stay for the next run.
    assert!(!job.output.exists() && folder.has_leftovers());
    fs::write(folder.path("bad.parquet"), &whole).unwrap();
    assert!(wayfix_fleet::run(&job, |_| {}).unwrap().resumed > 0);
    assert!(!folder.has_leftovers());
}

#[test]
fn models_that_are_none_are_refused() {
    let folder = Folder::new(&model(1));
    folder.write("good.parquet", &with("", &numbers(vec![0])), 4);
    for (text, message) in [
        ("{", "not a model: EOF"),
        ("{}", "its field `transition` is neither"),
        (r#"{"version":1,"transition":{"to":[]}}"#, "not a model: "),
    ] {
        fs::write(folder.path("model.json"), text).unwrap();
        let error = folder.error("good.parquet").to_string();
        assert!(error.contains("model.json: ") && error.contains(message), "{error}");
    }
}

#[test]
fn text_is_checked() {
    let folder = Folder::new(&model(1));
    for (text, message) in [
        ("", "bad.csv: is empty, expected a header"),
        ("trace_id,step\n1,1\n", "column `observation`: is missing; there are `trace_id`, `step`"),
        (
            "trace_id,step,observation\n1,1,0\n1,2,x\n",
            "column `observation`, row 1 (counted from 0): `x` is not a 64-bit integer",
        ),
        (
            "trace_id,step,observation\n1,1,0\n1,2,\n",
            "column `observation`, row 1 (counted from 0): is null, expected a value",
        ),
        (
            "trace_id,step,observation\nb,1,0\na,2,1\n",
            "column `trace_id`, row 1 (counted from 0): drive `a` follows drive `b`, expected \
             rows sorted by drive (numbers by value, text by its bytes)",
        ),
        ("trace_id,step,observation\n1,1,0\n1,2\n", "line 3"),
        (
            "trace_id,step,observation,observation\n1,1,0,1\n",
            "column `observation`: occurs twice; give the columns different names",
        ),
        ("trace_id,step,trace_id,observation\n1,1,0,1\n", "column `trace_id`: occurs twice"),
        ("step,trace_id,step,observation\n1,1,0,1\n", "column `step`: occurs twice"),
    ] {
        let error = refused_csv(&folder, text);
        assert!(error.contains(message), "{error}");
    }
}
