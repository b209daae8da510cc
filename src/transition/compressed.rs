//! Rows (or columns) of a sparse matrix, one after another.

use crate::kernels::lockstep::Lines;

/// Sparse lines: rows of A, or its columns. Line i occupies
/// `indices[starts[i]..starts[i + 1]]`; within a line, indices ascend.
#[derive(Debug, Clone)]
pub(super) struct Compressed {
    starts: Vec<u32>,
    indices: Vec<u32>,
    values: Vec<f64>,
}

impl Compressed {
    /// From entries (line, index, value) in any order, of which there are fewer
    /// than 2^32. The indices of a line come in the order of the entries.
    /// O(n + entries).
    pub(super) fn new(
        lines: usize,
        entries: impl Iterator<Item = (u32, u32, f64)> + Clone,
    ) -> Self {
        let mut starts = vec![0_u32; lines + 1];
        for (line, ..) in entries.clone() {
            starts[line as usize + 1] += 1;
        }
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
        // Now it is where the line ends.
        starts.rotate_right(1);
        starts[0] = 0;
        Self { starts, indices, values }
    }

    /// The lines of the transpose, in which indices ascend. O(n + entries).
    pub(super) fn transposed(&self) -> Self {
        let lines = 0..self.lines() as u32;
        let entries = lines.flat_map(|line| {
            let (indices, values) = self.slices(line as usize);
            indices.iter().zip(values).map(move |(&index, &value)| (index, line, value))
        });
        Self::new(self.lines(), entries)
    }

    /// How many lines there are.
    pub(super) fn lines(&self) -> usize {
        self.starts.len() - 1
    }

    /// How many entries there are.
    pub(super) fn entries(&self) -> usize {
        self.indices.len()
    }

    /// The values of all lines.
    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    /// Indices and values of a line.
    #[inline]
    pub(super) fn slices(&self, line: usize) -> (&[u32], &[f64]) {
        let range = self.starts[line] as usize..self.starts[line + 1] as usize;
        (&self.indices[range.clone()], &self.values[range])
    }

    /// All of them, for the kernels.
    pub(super) fn as_lines(&self) -> Lines<'_> {
        Lines::Sparse { starts: &self.starts, indices: &self.indices, values: &self.values }
    }

    /// The entries of a line, in ascending order of their index.
    pub(super) fn line(&self, line: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let (indices, values) = self.slices(line);
        indices.iter().map(|&index| index as usize).zip(values.iter().copied())
    }
}
