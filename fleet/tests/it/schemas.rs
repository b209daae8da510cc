//! Files of one input whose columns differ.

use std::fs;
use std::sync::Arc;

use arrow::array::{Array, ArrayRef, AsArray, Float64Array, Int64Array, RecordBatch};
use arrow::compute::cast;
use arrow::datatypes::{DataType, Field};
use wayfix::{Hmm, SparseLikelihood};
use wayfix_fleet::Job;
use wayfix_fleet::output::{Table, Verb};

use crate::kit::*;

fn job(folder: &Folder, output: &str) -> Job {
    folder.job("days", output, Verb::Smooth, Table::Steps)
}

/// Casts a column to another type.
fn as_type(rows: &RecordBatch, name: &str, to: &DataType) -> RecordBatch {
    let schema = rows.schema();
    let columns = schema.fields().iter().zip(rows.columns()).map(|(field, column)| {
        let is_it = field.name() == name;
        let column = if is_it { cast(column, to).unwrap() } else { column.clone() };
        (field.name().clone(), column)
    });
    RecordBatch::try_from_iter(columns.collect::<Vec<_>>()).unwrap()
}

fn dictionary(of: DataType) -> DataType {
    DataType::Dictionary(Box::new(DataType::Int32), Box::new(of))
}

/// Results of a run over all files, without the file column, in batches of a given number of rows.
fn of_each(folder: &Folder, job: &Job, count: usize) -> Vec<RecordBatch> {
    let (_, rows) = folder.results(job);
    assert_eq!(rows.num_rows() % count, 0);
    let columns: Vec<usize> = (1..rows.num_columns()).collect();
    let rows = rows.project(&columns).unwrap();
    let one = rows.num_rows() / count;
    (0..count).map(|file| rows.slice(file * one, one)).collect()
}

/// The same drives with columns of many types give the same results.
#[test]
fn types_may_differ_by_file() {
    let folder = Folder::new(&model(1));
    fs::create_dir(folder.path("days")).unwrap();
    let some = long(&drives(1, 60, 1, 20));
    let numbers = [
        some.clone(),
        as_type(&some, "trace_id", &DataType::Int32),
        as_type(&some, "trace_id", &DataType::UInt64),
        as_type(&some, "step", &DataType::Int16),
        as_type(&some, "observation", &DataType::Int64),
        as_type(&some, "observation", &DataType::UInt8),
    ];
    for (number, rows) in numbers.iter().enumerate() {
        folder.write(&format!("days/{number}.parquet"), rows, 70);
    }
    let found = of_each(&folder, &job(&folder, "numbers.parquet"), numbers.len());
    assert!(found.iter().all(|rows| *rows == found[0]) && found[0].num_rows() > 0);

    fs::remove_dir_all(folder.path("days")).unwrap();
    fs::create_dir(folder.path("days")).unwrap();
    let some = nested(&drives(1, 60, 1, 20));
    let list = |of| DataType::new_list(of, false);
    let large = DataType::LargeList(Arc::new(Field::new_list_field(DataType::Int64, true)));
    let texts = [
        some.clone(),
        as_type(&some, "trace_id", &DataType::LargeUtf8),
        as_type(&some, "trace_id", &DataType::Utf8View),
        as_type(&some, "trace_id", &dictionary(DataType::Utf8)),
        as_type(&some, "trace_id", &dictionary(DataType::LargeUtf8)),
        as_type(&some, "observation", &list(DataType::Int32)),
        as_type(&some, "observation", &large),
    ];
    for (number, rows) in texts.iter().enumerate() {
        folder.write(&format!("days/{number}.parquet"), rows, 7);
    }
    let found = of_each(&folder, &job(&folder, "texts.parquet"), texts.len());
    assert!(found.iter().all(|rows| *rows == found[0]) && found[0].num_rows() == 60);

    // What makes no sense is reported before the work begins.
    let number = RecordBatch::try_from_iter([
        ("trace_id", Arc::new(Float64Array::from(vec![1.5])) as ArrayRef),
        ("observation", some.column(1).slice(0, 1)),
    ]);
    folder.write("days/9.parquet", &number.unwrap(), 7);
    let error = go_on(&job(&folder, "none.parquet")).unwrap_err().to_string();
    let said =
        "days/9.parquet: column `trace_id`: has the type Float64, expected an integer or text";
    assert!(error.contains(said), "{error}");
    assert!(!folder.has_leftovers());
}

/// A step column that was added later, in a folder as other engines write it.
#[test]
fn a_column_that_only_later_files_have() {
    let folder = Folder::new(&model(1));
    let days = ["day=2024-01-01", "day=2024-01-02"];
    let some = drives(1, 50, 1, 20);
    let rows = nested(&some);
    let lists = rows.column(1).as_list::<i32>();
    let steps = some.iter().map(|drive| Some((0..drive.len()).map(|k| Some(step(k)))));
    let steps =
        arrow::array::ListArray::from_iter_primitive::<arrow::datatypes::Int64Type, _, _>(steps);
    let with_steps = RecordBatch::try_from_iter([
        ("step", Arc::new(steps) as ArrayRef),
        ("trace_id", rows.column(0).clone()),
        ("observation", Arc::new(lists.clone()) as ArrayRef),
        ("driver", Arc::new(Int64Array::from(vec![1; 50])) as ArrayRef),
    ]);
    for (day, rows) in days.iter().zip([&rows, &with_steps.unwrap()]) {
        fs::create_dir_all(folder.path("days").join(day)).unwrap();
        folder.write(&format!("days/{day}/part-00000-c000.snappy.parquet"), rows, 7);
        fs::write(folder.path("days").join(day).join(".part-00000.crc"), "crc").unwrap();
    }
    fs::write(folder.path("days/_SUCCESS"), "").unwrap();
    let mut job = job(&folder, "out.parquet");
    job.form = Some(wayfix_fleet::input::Form::Long);
    let (summary, found) = folder.results(&job);
    assert_eq!((summary.drives, summary.outputs), (100, 1));
    let (half, steps) = (found.num_rows() / 2, integers(&found, "step"));
    let files = cast(found.column_by_name("file").unwrap(), &DataType::Utf8).unwrap();
    for (row, number) in steps[..half].iter().enumerate() {
        let number = number.unwrap();
        assert!(files.as_string::<i32>().value(row).contains("day=2024-01-01/part"));
        // The same step by its own number.
        let later = steps[half + row].unwrap();
        assert!((later - 3) % 10 == 0 && (later - 3) / 10 + 1 == number, "{number}, {later}");
    }
    let states = states(&found, "state");
    assert_eq!(states[..half], states[half..]);
}

/// The likelihood elsewhere is 0 in files without the column.
#[test]
fn elsewhere_may_be_lacking() {
    let mut rng = rng(5);
    let hmm = Hmm::new(prior(), transition(&mut rng), SparseLikelihood::new(STATES)).unwrap();
    let folder = Folder::new(&hmm);
    fs::create_dir(folder.path("days")).unwrap();
    let seen = [[(3, 0.5), (4, 0.25)], [(4, 0.5), (5, 0.25)], [(5, 0.5), (6, 0.125)]];
    let lists: ArrayRef = Arc::new(lists_of_pairs(seen.iter().map(|pairs| &pairs[..])));
    let columns = |elsewhere: Option<f64>| {
        let mut columns: Vec<(&str, ArrayRef)> = vec![
            ("trace_id", Arc::new(Int64Array::from(vec![1; 3]))),
            ("step", Arc::new(Int64Array::from(vec![1, 2, 3]))),
            ("observation", lists.clone()),
        ];
        if let Some(elsewhere) = elsewhere {
            columns.push(("elsewhere", Arc::new(Float64Array::from(vec![elsewhere; 3]))));
        }
        RecordBatch::try_from_iter(columns).unwrap()
    };
    for (number, elsewhere) in [Some(0.0), None, Some(0.25)].into_iter().enumerate() {
        folder.write(&format!("days/{number}.parquet"), &columns(elsewhere), 2);
    }
    let found = of_each(&folder, &job(&folder, "out.parquet"), 3);
    assert_eq!(found[0], found[1]);
    assert!(found[2] != found[1] && found[2].column(1).null_count() == 0);
}
