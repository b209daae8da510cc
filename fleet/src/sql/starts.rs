//! Determines the rows at which the ranges of a sorted table begin.

use std::collections::VecDeque;

use arrow::array::{Array, ArrayRef};
use arrow::compute::concat;
use arrow::compute::kernels::cmp::neq;
use datafusion::scalar::ScalarValue;

use super::ranges::Range;
use crate::error::Outcome;

/// Rows of a sorted table at which ranges begin.
///
/// These are the first rows of drives at or after the wanted rows, and at the borders of files. A
/// drive that continues in the next file becomes a range of its own, so that every other range lies
/// within one file.
#[derive(Debug, Default)]
pub(super) struct Starts {
    wanted: VecDeque<u64>,
    borders: VecDeque<u64>,
    found: Vec<(u64, ScalarValue)>,
    rows: u64,
    /// First row and key of the current drive.
    drive: Option<(u64, ScalarValue)>,
    last: Option<ArrayRef>,
}

impl Starts {
    /// Creates it for a table whose second and later files begin at the rows of `borders`.
    pub(super) fn new(wanted: Vec<u64>, borders: Vec<u64>) -> Self {
        Self { wanted: wanted.into(), borders: borders.into(), ..Self::default() }
    }

    /// Takes the keys of the next rows.
    pub(super) fn push(&mut self, keys: &ArrayRef) -> Outcome<()> {
        if keys.is_empty() || (self.wanted.is_empty() && self.borders.is_empty()) {
            self.rows += keys.len() as u64;
            return Ok(());
        }
        let first = self.rows;
        self.rows += keys.len() as u64;
        let key_of = |row: u64| ScalarValue::try_from_array(keys, (row - first) as usize);
        // Compare each key with the previous one, also across batches.
        let last = self.last.replace(keys.slice(keys.len() - 1, 1));
        let (all, shift) = if let Some(last) = last {
            (concat(&[&*last, &**keys])?, first)
        } else {
            self.drive = Some((first, key_of(first)?));
            (keys.clone(), first + 1)
        };
        let begins = neq(&all.slice(0, all.len() - 1), &all.slice(1, all.len() - 1))?;
        // First row of the current drive, while the loop goes from one start to the next.
        let mut drive = self.drive.as_ref().map_or(0, |drive| drive.0);
        for index in begins.values().set_indices() {
            let row = index as u64 + shift;
            // All wanted rows up to this start collapse into it.
            let passed = |wanted: Option<&u64>| wanted.is_some_and(|&wanted| wanted <= row);
            if passed(self.borders.front()) {
                // If a border is strictly inside the drive that ends here, the drive spans two
                // files, so cut at both of its ends.
                let crossed = self.borders.iter().any(|&border| drive < border && border < row);
                self.borders.retain(|&border| border > row);
                // The drive began in this batch, or in an earlier one.
                if crossed && drive >= first {
                    self.cut(drive, key_of(drive)?);
                } else if crossed && let Some((row, key)) = self.drive.clone() {
                    self.cut(row, key);
                }
                self.cut(row, key_of(row)?);
            }
            if passed(self.wanted.front()) {
                self.wanted.retain(|&wanted| wanted > row);
                self.cut(row, key_of(row)?);
            }
            drive = row;
        }
        if drive >= first {
            self.drive = Some((drive, key_of(drive)?));
        }
        Ok(())
    }

    fn cut(&mut self, row: u64, key: ScalarValue) {
        // Each start once, and never row 0, where the first range begins anyway.
        if self.found.last().map_or(0, |last| last.0) < row {
            self.found.push((row, key));
        }
    }

    /// Returns the ranges between the starts.
    pub(super) fn ranges(mut self) -> Vec<Range> {
        // The last drive, which no start ends.
        let crosses = |row: u64| self.borders.iter().any(|&b| row < b && b < self.rows);
        if let Some((row, key)) = self.drive.take().filter(|(row, _)| crosses(*row)) {
            self.cut(row, key);
        }
        let (mut from, mut row) = (None, 0);
        let mut ranges = Vec::with_capacity(self.found.len() + 1);
        for (end, key) in self.found {
            ranges.push(Range { from: from.replace(key.clone()), to: Some(key), rows: row..end });
            row = end;
        }
        ranges.push(Range { from, to: None, rows: row..self.rows });
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
        // Wanted rows, borders of files, and expected beginnings of ranges.
        for (wanted, borders, expected) in [
            (vec![], vec![], vec![]),
            (vec![1], vec![], vec![3]),
            (vec![3], vec![], vec![3]),
            (vec![1, 2, 4, 5, 8], vec![], vec![3, 4, 8]),
            (vec![5, 6, 7], vec![], vec![8]),
            (vec![10, 11], vec![], vec![]),
            (vec![], vec![0, 3, 3, 11], vec![3]),
            (vec![], vec![5], vec![4, 8]),
            (vec![], vec![5, 6, 10], vec![4, 8, 9]),
            (vec![], vec![2], vec![3]),
            (vec![3], vec![8, 10], vec![3, 8, 9]),
            (vec![1], vec![9, 11], vec![3, 9]),
        ] {
            for size in 1..=keys.len() {
                let mut starts = Starts::new(wanted.clone(), borders.clone());
                for keys in keys.chunks(size) {
                    starts.push(&(Arc::new(Int64Array::from(keys.to_vec())) as ArrayRef)).unwrap();
                }
                let ranges = starts.ranges();
                let ends: Vec<u64> = ranges.iter().map(|range| range.rows.end).collect();
                assert_eq!(ends, [&expected[..], &[11]].concat(), "{wanted:?} {borders:?} {size}");
                let key = |row: u64| Some(ScalarValue::from(keys[row as usize]));
                assert!(ranges.iter().zip(&expected).all(|(range, &row)| range.to == key(row)));
                for (range, &row) in ranges[1..].iter().zip(&expected) {
                    assert_eq!((&range.from, range.rows.start), (&key(row), row));
                }
                assert!(ranges[0].from.is_none() && ranges[expected.len()].to.is_none());
            }
        }
    }
}
