//! Checks the order of a table that a query relies on.

use arrow::array::{Array, ArrayRef, BooleanArray};
use arrow::compute::concat;
use arrow::compute::kernels::boolean::{and, or};
use arrow::compute::kernels::cmp::{eq, gt};
use arrow::util::display::array_value_to_string;
use datafusion::execution::SendableRecordBatchStream;
use futures::StreamExt;

use super::starts::Starts;
use crate::error::{FleetError, Outcome};

/// Checks that rows are sorted by their columns, the first one first, without duplicates.
/// DataFusion trusts a declared order, and gives wrong results if it does not hold. The values of
/// the first column are passed to `starts` on the way.
pub(super) async fn check(mut rows: SendableRecordBatchStream, starts: &mut Starts) -> Outcome<()> {
    let schema = rows.schema();
    if let Some(field) = schema.fields().iter().find(|field| field.data_type().is_nested()) {
        let message = format!(
            "--order: column `{}` is nested, expected numbers, text or times",
            field.name()
        );
        return Err(FleetError::Settings(message));
    }
    let names: Vec<&str> = schema.fields().iter().map(|field| field.name().as_str()).collect();
    let names = names.join("`, `");
    let mut first_row = 0;
    let mut last: Option<Vec<ArrayRef>> = None;
    while let Some(batch) = rows.next().await {
        let batch = batch?;
        let count = batch.num_rows();
        if count == 0 {
            continue;
        }
        let columns = batch.columns();
        for (column, field) in columns.iter().zip(schema.fields()) {
            // Nulls have no agreed place in an order, and comparisons with them are null.
            if column.logical_null_count() > 0 {
                let is_null = |&row: &usize| column.logical_nulls().is_some_and(|n| n.is_null(row));
                let row = first_row + (0..count).find(is_null).unwrap_or(0) as u64;
                return Err(FleetError::value(field.name(), row, "is null, expected a value"));
            }
        }
        let refuse = |columns: &[ArrayRef], at: usize, row: u64| {
            let text = |at: usize| {
                let values =
                    columns.iter().map(|c| array_value_to_string(c, at).unwrap_or_default());
                values.collect::<Vec<_>>().join(", ")
            };
            let message = format!(
                "({}) follows ({}), expected rows sorted by these columns, without duplicates",
                text(at + 1),
                text(at)
            );
            Err(FleetError::value(&names, row, message))
        };
        // The pair across the border of two batches.
        if let Some(last) = &last {
            let pair = last.iter().zip(columns);
            let pair = pair.map(|(last, column)| concat(&[&**last, &column.slice(0, 1)]));
            let pair = pair.collect::<Result<Vec<_>, _>>()?;
            if disorder(&pair)?.is_some() {
                return refuse(&pair, 0, first_row);
            }
        }
        if let Some(at) = disorder(columns)? {
            return refuse(columns, at, first_row + at as u64 + 1);
        }
        starts.push(&columns[0])?;
        last = Some(columns.iter().map(|column| column.slice(count - 1, 1)).collect());
        first_row += count as u64;
    }
    Ok(())
}

/// Returns the first row whose successor is not greater.
fn disorder(columns: &[ArrayRef]) -> Outcome<Option<usize>> {
    let pairs = columns.first().map_or(0, Array::len).saturating_sub(1);
    // Lexicographic comparison, column by column and vectorised: `tied` marks pairs equal so far,
    // `wrong` those decided against.
    let mut wrong = BooleanArray::from(vec![false; pairs]);
    let mut tied = BooleanArray::from(vec![true; pairs]);
    for column in columns {
        let (row, next) = (column.slice(0, pairs), column.slice(1, pairs));
        wrong = or(&wrong, &and(&tied, &gt(&row, &next)?)?)?;
        tied = and(&tied, &eq(&row, &next)?)?;
    }
    // Still tied after the last column: a duplicate.
    let wrong = or(&wrong, &tied)?;
    Ok(wrong.values().set_indices().next())
}
