//! Queries over files, and their rows.

use std::path::PathBuf;

use arrow::array::{Array, ArrayRef, AsArray, ListArray, RecordBatch, StructArray};
use arrow::datatypes::{DataType, Float64Type};
use wayfix_fleet::sql::{Query, Source, query};
use wayfix_fleet::{FleetError, Pack};

use crate::kit::{Folder, close, read};

/// A query over one table, `drives`, sorted by some columns.
pub(crate) fn over(folder: &Folder, input: &str, key: &[&str], sql: &str) -> Query {
    let key = key.iter().map(|&column| column.to_owned()).collect();
    Query {
        tables: vec![Source { name: "drives".to_owned(), path: folder.path(input), key }],
        sql: sql.to_owned(),
        output: folder.path("rows.parquet"),
        pack: Pack::None,
        threads: 3,
        scheduler: None,
        models: None,
        batch: 16,
        part: 1000,
        force: true,
        restart: false,
    }
}

/// Rows of a query.
pub(crate) fn rows(query_of: &Query) -> RecordBatch {
    let count = query(query_of, |_| {}).unwrap().rows;
    let rows = read(&query_of.output);
    assert_eq!(rows.num_rows() as u64, count);
    assert!(leftovers(query_of).is_empty());
    rows
}

/// Error of a query, which must leave no files.
pub(crate) fn error(query_of: &Query) -> FleetError {
    let error = query(query_of, |_| {}).unwrap_err();
    assert!(!query_of.output.exists() && leftovers(query_of).is_empty(), "{error}");
    error
}

/// Files beside the output that begin with its name.
fn leftovers(query_of: &Query) -> Vec<PathBuf> {
    let folder = query_of.output.parent().unwrap();
    let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
    let name = query_of.output.to_str().unwrap();
    files
        .filter(|file| *file != query_of.output && file.to_str().unwrap().starts_with(name))
        .collect()
}

/// Literal of the folder's model.
pub(crate) fn model_of(folder: &Folder) -> String {
    format!("'{}'", folder.path("model.json").display())
}

pub(crate) fn list(rows: &RecordBatch, name: &str) -> ListArray {
    rows.column_by_name(name).unwrap().as_list::<i32>().clone()
}

/// List of a row as a table.
pub(crate) fn items_of(lists: &ListArray, row: usize) -> Option<RecordBatch> {
    lists.is_valid(row).then(|| RecordBatch::from(lists.value(row).as_struct()))
}

/// A struct column as a table.
pub(crate) fn fields(rows: &RecordBatch, name: &str) -> RecordBatch {
    let column: &StructArray = rows.column_by_name(name).unwrap().as_struct();
    assert_eq!(column.null_count(), 0);
    RecordBatch::from(column)
}

pub(crate) fn same_rows(found: &RecordBatch, expected: &RecordBatch) {
    assert_eq!(found.schema(), expected.schema());
    assert_eq!(found.num_rows(), expected.num_rows());
    found.columns().iter().zip(expected.columns()).for_each(|(found, e)| same(found, e));
}

/// Compares rows; numbers may differ in their last digits, as drives are computed in other groups.
fn same(found: &ArrayRef, expected: &ArrayRef) {
    assert_eq!(found.logical_nulls(), expected.logical_nulls());
    match found.data_type() {
        DataType::List(_) => {
            let (found, expected) = (found.as_list::<i32>(), expected.as_list::<i32>());
            assert_eq!(found.offsets(), expected.offsets());
            same(found.values(), expected.values());
        }
        DataType::Struct(_) => {
            let (found, expected) = (found.as_struct(), expected.as_struct());
            found.columns().iter().zip(expected.columns()).for_each(|(found, e)| same(found, e));
        }
        DataType::Float64 => {
            let (found, expected) =
                (found.as_primitive::<Float64Type>(), expected.as_primitive::<Float64Type>());
            for (found, expected) in found.iter().zip(expected.iter()) {
                found.zip(expected).into_iter().for_each(|(found, e)| close(found, e));
            }
        }
        _ => assert_eq!(found, expected),
    }
}
