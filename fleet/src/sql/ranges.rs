//! Ranges of a sorted table, each of whole drives, which queries can take one by one.
//!
//! A range is a condition on the first column that the table is sorted by, so that it goes wherever
//! a plan goes, to the executors of a cluster too, and the reader of the file skips the row groups
//! that lie outside by their statistics.

use std::collections::VecDeque;

use arrow::array::{Array, ArrayRef};
use arrow::compute::concat;
use arrow::compute::kernels::cmp::neq;
use datafusion::common::tree_node::{Transformed, TransformedResult, TreeNode};
use datafusion::common::{Column, Result};
use datafusion::logical_expr::{Expr, LogicalPlan, LogicalPlanBuilder, lit};
use datafusion::scalar::ScalarValue;

use crate::error::Outcome;

/// Rows of a sorted table whose key is not below one value, and below another.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Range {
    from: Option<ScalarValue>,
    to: Option<ScalarValue>,
    /// Row of the table after the last one.
    pub(super) end_row: u64,
}

impl Range {
    /// All rows.
    pub(super) fn all() -> Self {
        Self { from: None, to: None, end_row: 0 }
    }

    /// The plan over these rows of a table alone, whose first column of the order is `key`.
    pub(super) fn of(&self, plan: LogicalPlan, table: &str, key: &str) -> Result<LogicalPlan> {
        let narrow = |node: LogicalPlan| {
            let LogicalPlan::TableScan(scan) = &node else { return Ok(Transformed::no(node)) };
            if scan.table_name.table() != table {
                return Ok(Transformed::no(node));
            }
            let column = Expr::Column(Column::new(Some(scan.table_name.clone()), key));
            let of = scan.source.schema().field_with_name(key)?.data_type().clone();
            let bound = |value: &ScalarValue| value.cast_to(&of).map(lit);
            let from = self.from.as_ref().map(bound).transpose()?;
            let to = self.to.as_ref().map(bound).transpose()?;
            let from = from.map(|from| column.clone().gt_eq(from));
            let to = to.map(|to| column.lt(to));
            let Some(condition) = from.into_iter().chain(to).reduce(Expr::and) else {
                return Ok(Transformed::no(node));
            };
            let narrowed = LogicalPlanBuilder::from(node).filter(condition)?.build()?;
            Ok(Transformed::yes(narrowed))
        };
        plan.transform_up(narrow).data()
    }
}

/// Rows of a sorted table with which ranges begin: the first ones of a drive at or after the rows
/// that are wanted.
#[derive(Debug, Default)]
pub(super) struct Starts {
    wanted: VecDeque<u64>,
    found: Vec<(u64, ScalarValue)>,
    rows: u64,
    last: Option<ArrayRef>,
}

impl Starts {
    pub(super) fn new(wanted: Vec<u64>) -> Self {
        Self { wanted: wanted.into(), ..Self::default() }
    }

    /// Takes the next keys of the table.
    pub(super) fn push(&mut self, keys: &ArrayRef) -> Outcome<()> {
        let first = self.rows;
        self.rows += keys.len() as u64;
        if self.wanted.front().is_some_and(|&row| row < self.rows) && !keys.is_empty() {
            // Each key beside the one before it; before the first one of all there is none.
            let before = self.last.take().map_or_else(|| keys.slice(0, 0), |last| last);
            let all = concat(&[&*before, &**keys])?;
            let begins = neq(&all.slice(0, all.len() - 1), &all.slice(1, all.len() - 1))?;
            let shift = first + 1 - before.len() as u64;
            for index in begins.values().set_indices() {
                let row = index as u64 + shift;
                if self.wanted.front().is_some_and(|&wanted| wanted <= row) {
                    self.wanted.retain(|&wanted| wanted > row);
                    let key = ScalarValue::try_from_array(&keys, (row - first) as usize);
                    self.found.push((row, key?));
                }
            }
        }
        self.last =
            keys.len().checked_sub(1).map_or(self.last.take(), |at| Some(keys.slice(at, 1)));
        Ok(())
    }

    /// Returns the ranges between these rows.
    pub(super) fn ranges(self) -> Vec<Range> {
        let mut from = None;
        let mut ranges = Vec::with_capacity(self.found.len() + 1);
        for (row, key) in self.found {
            ranges.push(Range { from: from.replace(key.clone()), to: Some(key), end_row: row });
        }
        ranges.push(Range { from, to: None, end_row: self.rows });
        ranges
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arrow::array::Int64Array;
    use std::sync::Arc;

    #[test]
    fn ranges_begin_with_drives() {
        let keys: Vec<i64> = vec![1, 1, 1, 2, 3, 3, 3, 3, 4, 5, 5];
        // Rows that are wanted, and those with which ranges begin.
        for (wanted, expected) in [
            (vec![], vec![]),
            (vec![1], vec![3]),
            (vec![3], vec![3]),
            (vec![1, 2, 4, 5, 8], vec![3, 4, 8]),
            (vec![5, 6, 7], vec![8]),
            (vec![10, 11], vec![]),
        ] {
            for size in 1..=keys.len() {
                let mut starts = Starts::new(wanted.clone());
                for keys in keys.chunks(size) {
                    starts.push(&(Arc::new(Int64Array::from(keys.to_vec())) as ArrayRef)).unwrap();
                }
                let ranges = starts.ranges();
                let ends: Vec<u64> = ranges.iter().map(|range| range.end_row).collect();
                assert_eq!(ends, [&expected[..], &[11]].concat(), "{wanted:?}, {size}");
                let key = |row: u64| Some(ScalarValue::from(keys[row as usize]));
                assert!(ranges.iter().zip(&expected).all(|(range, &row)| range.to == key(row)));
                assert!(ranges[1..].iter().zip(&expected).all(|(r, &row)| r.from == key(row)));
                assert!(ranges[0].from.is_none() && ranges[expected.len()].to.is_none());
            }
        }
    }
}
