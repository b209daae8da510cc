//! A transition operator that stores every entry.

use std::sync::OnceLock;

use super::sparse::LEAST_PLAIN;
use super::stored::Stored;
use super::{Transition, TransitionEntries, best_of, check_columns, check_count, log};
use crate::error::TransitionError;
use crate::kernels;
use crate::kernels::lockstep::Lines;

/// How many columns are added in one pass over the result.
const BLOCK: usize = 4;

/// A dense transition matrix, stored by columns.
///
/// Products cost O(n²), memory is 8 n² bytes, and as much again after the first
/// Viterbi. For a map, where most entries are 0, take
/// [`SparseTransition`](crate::SparseTransition).
///
/// ```
/// use wayfix::{DenseTransition, Transition};
///
/// // Row i is what leads to state i; columns sum to one.
/// let a = DenseTransition::from_rows(2, &[0.7, 0.4, 0.3, 0.6])?;
/// let mut out = [0.0; 2];
/// a.apply(&(), &[1.0, 0.0], &mut out);
/// assert_eq!(out, [0.7, 0.3]);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Debug, Clone)]
pub struct DenseTransition {
    states: usize,
    /// A\[i, j\] at j n + i.
    pub(crate) columns: Vec<f64>,
    /// Whether all entries above 0 are at least 2^-100.
    pub(super) plain: bool,
    /// log2 A\[i, j\] at i n + j, made when first decoded with.
    log2_rows: OnceLock<Vec<f64>>,
}

impl DenseTransition {
    /// From a matrix, row after row: `matrix[i * n + j]` = A\[i, j\] =
    /// p(i | j). O(n²).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no states, unless there are n × n values, for a
    /// value that is NaN, negative or infinite, or for a column that does not
    /// sum to one within 1e-9.
    pub fn from_rows(states: usize, matrix: &[f64]) -> Result<Self, TransitionError> {
        check_square(states, matrix.len())?;
        Self::from_fn(states, |i, j| matrix[i * states + j])
    }

    /// From a function of (to, from). O(n²).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_rows`](Self::from_rows).
    pub fn from_fn(
        states: usize,
        mut entry: impl FnMut(usize, usize) -> f64,
    ) -> Result<Self, TransitionError> {
        if states == 0 {
            return Err(TransitionError::Empty);
        }
        check_count("states", states)?;
        let mut columns = Vec::with_capacity(states * states);
        let mut sums = vec![0.0; states];
        for (from, sum) in sums.iter_mut().enumerate() {
            for to in 0..states {
                let value = entry(to, from);
                if !(value >= 0.0 && value.is_finite()) {
                    return Err(TransitionError::Entry { to, from, value });
                }
                columns.push(value);
                *sum += value;
            }
        }
        check_columns(&sums)?;
        let plain = !columns.iter().any(|&p| 0.0 < p && p < LEAST_PLAIN);
        Ok(Self { states, columns, plain, log2_rows: OnceLock::new() })
    }

    /// From a faer view of A (columns sum to one). O(n²).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_rows`](Self::from_rows), or
    /// [`TransitionError::NotSquare`].
    #[cfg(feature = "faer")]
    pub fn from_faer(matrix: faer::MatRef<'_, f64>) -> Result<Self, TransitionError> {
        let (rows, columns) = (matrix.nrows(), matrix.ncols());
        if rows != columns {
            return Err(TransitionError::NotSquare { rows, columns });
        }
        Self::from_fn(rows, |i, j| matrix[(i, j)])
    }

    /// A as a faer view, without copying.
    #[cfg(feature = "faer")]
    #[must_use]
    pub fn as_faer(&self) -> faer::MatRef<'_, f64> {
        faer::MatRef::from_column_major_slice(&self.columns, self.states, self.states)
    }

    /// A\[to, from\], 0 where there is no such state.
    #[must_use]
    pub fn get(&self, to: usize, from: usize) -> f64 {
        let n = self.states;
        if to < n && from < n { self.columns[from * n + to] } else { 0.0 }
    }

    /// Rows and columns.
    pub(super) fn lines(&self) -> (Lines<'_>, Lines<'_>) {
        let values = &self.columns;
        (Lines::DenseTransposed { values }, Lines::Dense { values })
    }

    /// The entries above 0 of a row.
    fn row(&self, to: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        assert!(to < self.states, "there is no state {to}");
        let row = self.columns[to..].iter().step_by(self.states).copied();
        row.enumerate().filter(|entry| entry.1 > 0.0)
    }

    /// The entries above 0 of a column.
    fn column(&self, from: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let column = &self.columns[from * self.states..(from + 1) * self.states];
        column.iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }

    fn check_slices(&self, x: &[f64], out: &[f64]) {
        super::check_slices(self.states, x, out);
    }
}

impl Transition for DenseTransition {
    type Control = ();

    fn states(&self) -> usize {
        self.states
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.check_slices(x, out);
        let n = self.states;
        out.fill(0.0);
        let (blocks, rest) = x.as_chunks::<BLOCK>();
        for (x, a) in blocks.iter().zip(self.columns.chunks_exact(BLOCK * n)) {
            let (a0, a) = a.split_at(n);
            let (a1, a) = a.split_at(n);
            let (a2, a3) = a.split_at(n);
            for ((((out, a0), a1), a2), a3) in out.iter_mut().zip(a0).zip(a1).zip(a2).zip(a3) {
                *out += (a0 * x[0] + a1 * x[1]) + (a2 * x[2] + a3 * x[3]);
            }
        }
        for (x, a) in rest.iter().zip(self.columns[(n - rest.len()) * n..].chunks_exact(n)) {
            out.iter_mut().zip(a).for_each(|(out, a)| *out += a * x);
        }
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.check_slices(x, out);
        for (out, a) in out.iter_mut().zip(self.columns.chunks_exact(self.states)) {
            *out = kernels::dot(a, x);
        }
    }

    fn stored(&self, (): &()) -> Option<Stored<'_>> {
        Some(Stored::dense(self))
    }

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = log::sum(self.row(i), x);
        }
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = log::sum(self.column(j), x);
        }
    }
}

impl TransitionEntries for DenseTransition {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.row(to)
    }

    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.column(from)
    }

    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        self.check_slices(x, out);
        let n = self.states;
        let log2 = self.log2_rows.get_or_init(|| {
            let entries = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
            entries.map(|(i, j)| kernels::log2(self.columns[j * n + i])).collect()
        });
        let best = log2.chunks_exact(n).map(|row| best_of((0..).zip(row.iter().copied()), x));
        for ((out, from), best) in out.iter_mut().zip(from).zip(best) {
            (*out, *from) = best;
        }
    }
}

/// n × n values, n above 0.
pub(super) fn check_square(states: usize, found: usize) -> Result<(), TransitionError> {
    if states == 0 {
        return Err(TransitionError::Empty);
    }
    if states.checked_mul(states) != Some(found) {
        return Err(TransitionError::WrongLength { states, found });
    }
    Ok(())
}
