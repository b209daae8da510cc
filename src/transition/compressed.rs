//! Compressed rows or columns of a sparse matrix (CSR and CSC), the form that all sparse operators
//! are built from and that lists single entries. Products read a copy in slices of eight lines.

use std::ops::Range;

use wayfix_kernels::{Lines, Sliced};

/// Sparse lines: rows of A, or its columns. Line i occupies
/// `indices[starts[i]..starts[i + 1]]`; within a line, indices ascend.
#[derive(Debug, Clone, PartialEq)]
pub struct Compressed {
    starts: Vec<u32>,
    indices: Vec<u32>,
    values: Vec<f64>,
}

impl Compressed {
    /// Builds lines from fewer than 2^32 entries (line, index, value) in any order. The indices of
    /// a line keep the order of the entries. O(n + entries).
    #[doc(hidden)]
    pub fn new(lines: usize, entries: impl Iterator<Item = (u32, u32, f64)> + Clone) -> Self {
        // Counting sort by line, which is stable: count, sum up, place.
        let mut starts = vec![0_u32; lines + 1];
        for (line, ..) in entries.clone() {
            starts[line as usize + 1] += 1;
        }
        // Counts are stored one place late, so their running sums are starts. These fit 32 bits,
        // since the caller has checked the number of entries.
        let mut end = 0;
        for start in &mut starts {
            end += *start;
            *start = end;
        }
        let mut indices = vec![0; end as usize];
        let mut values = vec![0.0; end as usize];
        // While filled, starts[i] is where the next entry of line i goes.
        for (line, index, value) in entries {
            let at = &mut starts[line as usize];
            indices[*at as usize] = index;
            values[*at as usize] = value;
            *at += 1;
        }
        // Now starts[i] is the end of line i.
        starts.rotate_right(1);
        starts[0] = 0;
        Self { starts, indices, values }
    }

    /// Returns the lines of the transpose, with ascending indices. O(n + entries).
    #[doc(hidden)]
    #[must_use]
    pub fn transposed(&self) -> Self {
        // Lines are visited in order and `new` keeps the order of entries: hence indices ascend,
        // whatever their order here.
        let lines = 0..self.lines() as u32;
        let entries = lines.flat_map(|line| {
            self.line(line as usize).map(move |(index, value)| (index as u32, line, value))
        });
        Self::new(self.lines(), entries)
    }

    /// Returns the starts of all lines, followed by the end of the last, and all indices.
    #[must_use]
    pub fn into_pattern(self) -> (Vec<u32>, Vec<u32>) {
        (self.starts, self.indices)
    }

    /// Number of lines.
    #[must_use]
    pub fn lines(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of entries.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.indices.len()
    }

    /// The start of each line, and the end of the last.
    #[must_use]
    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// Positions of the entries of a line.
    #[inline]
    pub(super) fn range(&self, line: usize) -> Range<usize> {
        self.starts[line] as usize..self.starts[line + 1] as usize
    }

    /// The indices of a line.
    #[inline]
    #[must_use]
    pub fn indices(&self, line: usize) -> &[u32] {
        &self.indices[self.range(line)]
    }

    /// All lines, for the kernels.
    pub(super) fn as_lines(&self) -> Lines<'_> {
        Lines::Sparse { starts: &self.starts, indices: &self.indices, values: &self.values }
    }

    /// The lines in slices of eight, for products.
    pub(super) fn sliced(&self) -> Sliced {
        Sliced::new(self.lines(), |line| (self.indices(line), &self.values[self.range(line)]))
    }

    /// Index and value of the entry at a position among all entries.
    #[inline]
    #[doc(hidden)]
    #[must_use]
    pub fn entry(&self, at: usize) -> (usize, f64) {
        (self.indices[at] as usize, self.values[at])
    }

    /// The entries of a line, in ascending order of their index.
    #[inline]
    pub fn line(&self, line: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let range = self.range(line);
        let (indices, values) = (&self.indices[range.clone()], &self.values[range]);
        indices.iter().zip(values).map(|(&index, &value)| (index as usize, value))
    }
}
