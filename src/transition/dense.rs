//! [`DenseTransition`], which stores every entry of A by columns.
//!
//! Invariant: all values are finite and at least 0, and columns sum to one within 1e-9. Values are
//! checked where they enter, in [`DenseTransition::from_fn`]; `known` takes valid ones.

use std::fmt;
use std::sync::OnceLock;

use super::check::{check_columns_of, check_count, check_rows, check_square};
use crate::error::TransitionError;
use wayfix_kernels::limits;
use wayfix_kernels::{Dense, Lines, Panels};

/// Largest number of states for which `Debug` shows the entries.
const SHOWN: usize = 8;

/// A dense transition matrix, stored by columns.
///
/// Products cost O(n²). Memory is 8 n² bytes, with one dimension rounded up to a multiple of
/// eight, and as much again after the first Viterbi. For a map, where most entries are 0, use
/// [`SparseTransition`](crate::SparseTransition).
///
/// ```
/// use wayfix::{DenseTransition, Transition};
///
/// // Row i holds the moves to state i, column j the moves out of state j: columns sum to one.
/// // The vehicle moves from state 0 to state 1 with 0.3, and back with 0.4.
/// let a = DenseTransition::from_rows(&[[0.7, 0.4], [0.3, 0.6]])?;
/// let mut out = [0.0; 2];
/// a.apply(&(), &[1.0, 0.0], &mut out);
/// assert_eq!(out, [0.7, 0.3]);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Clone)]
pub struct DenseTransition {
    pub(super) matrix: Dense,
    /// True if all entries above 0 are at least 2^-100.
    pub(super) no_tiny_entries: bool,
    /// log2 of the entries, computed by the first decoding.
    pub(super) log2: OnceLock<Panels>,
}

impl fmt::Debug for DenseTransition {
    /// Shows the number of states, and the rows if there are at most eight.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let states = self.matrix.states();
        let mut out = f.debug_struct("DenseTransition");
        out.field("states", &states);
        if states > SHOWN {
            out.finish_non_exhaustive()
        } else {
            out.field("rows", &self.to_rows()).finish()
        }
    }
}

impl DenseTransition {
    /// Creates an operator from the rows of A: `rows[i][j]` = A\[i, j\] = p(to i | from j), so
    /// that **columns** sum to one. O(n²).
    ///
    /// Many textbooks put p(to j | from i) at row i and column j, which is the transpose: pass
    /// such a matrix to [`from_fn`](Self::from_fn) as `|to, from| p[from][to]`.
    ///
    /// ```
    /// use wayfix::DenseTransition;
    ///
    /// let a = DenseTransition::from_rows(&[[0.9, 0.5], [0.1, 0.5]])?;
    /// assert_eq!(a.get(1, 0), 0.1); // to state 1 from state 0
    ///
    /// let error = DenseTransition::from_rows(&[[0.9, 0.1], [0.5, 0.5]]).unwrap_err();
    /// assert!(error.to_string().contains("the rows sum to one: transpose"));
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no states, for a row that does not have n values, for a value that
    /// is NaN, negative or infinite, or for a column that does not sum to one within 1e-9.
    pub fn from_rows<R: AsRef<[f64]>>(rows: &[R]) -> Result<Self, TransitionError> {
        check_rows(rows)?;
        Self::from_fn(rows.len(), |i, j| rows[i].as_ref()[j])
    }

    /// Creates an operator from the rows of A, one after another in one slice:
    /// `matrix[i * n + j]` = A\[i, j\] = p(to i | from j). O(n²).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_rows`](Self::from_rows), or
    /// [`TransitionError::WrongLength`] unless there are n × n values.
    pub fn from_row_major(states: usize, matrix: &[f64]) -> Result<Self, TransitionError> {
        check_square(states, matrix.len())?;
        Self::from_fn(states, |i, j| matrix[i * states + j])
    }

    /// Creates an operator from a function of (to, from). O(n²).
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
        // Filled with zeros first: the padding of columns must be 0 for the products.
        let mut matrix = Dense::filled(states, 0.0);
        let mut sums = vec![0.0; states];
        for (from, sum) in sums.iter_mut().enumerate() {
            for (to, stored) in matrix.column_mut(from).iter_mut().enumerate() {
                let value = entry(to, from);
                // Written so that a NaN, which fails every comparison, is also refused.
                if !(value >= 0.0 && value.is_finite()) {
                    return Err(TransitionError::Entry { to, from, value });
                }
                *stored = value;
                *sum += value;
            }
        }
        check_columns_of(&sums, |to| (0..states).map(|from| matrix.column(from)[to]).sum())?;
        Ok(Self::from_valid(matrix))
    }

    /// Creates an operator from a faer view of A (columns sum to one). O(n²).
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

    /// Returns A as a faer view, without copying.
    #[cfg(feature = "faer")]
    #[must_use]
    pub fn as_faer(&self) -> faer::MatRef<'_, f64> {
        let (n, matrix) = (self.matrix.states(), &self.matrix);
        faer::MatRef::from_column_major_slice_with_stride(matrix.values(), n, n, matrix.stride())
    }

    /// Returns A\[to, from\], or 0 if a state does not exist.
    #[must_use]
    pub fn get(&self, to: usize, from: usize) -> f64 {
        let n = self.matrix.states();
        if to < n && from < n { self.matrix.column(from)[to] } else { 0.0 }
    }

    /// Returns the rows of A, as [`from_rows`](Self::from_rows) takes them. O(n²).
    #[must_use]
    pub fn to_rows(&self) -> Vec<Vec<f64>> {
        let n = self.matrix.states();
        (0..n).map(|to| (0..n).map(|from| self.get(to, from)).collect()).collect()
    }

    /// Creates an operator from entries that are known to be valid.
    pub(super) fn from_valid(matrix: Dense) -> Self {
        // Zeros are exact in any product, so they, and the padding, do not count.
        let no_tiny_entries = matrix.values().iter().all(|&p| p == 0.0 || limits::is_plain(p));
        Self { matrix, no_tiny_entries, log2: OnceLock::new() }
    }

    /// Rows and columns of A.
    pub(super) fn lines(&self) -> (Lines<'_>, Lines<'_>) {
        let values = self.matrix.values();
        // One buffer serves both: it holds the columns, and is the transpose of the rows.
        (Lines::DenseTransposed { values }, Lines::Dense { values })
    }

    /// Entries above 0 of a row.
    pub(super) fn row(&self, to: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        assert!(to < self.matrix.states(), "there is no state {to}");
        // Row `to` holds value `to` of each column, one stride apart.
        let row = self.matrix.values()[to..].iter().step_by(self.matrix.stride()).copied();
        row.enumerate().filter(|entry| entry.1 > 0.0)
    }

    /// Entries above 0 of a column.
    pub(super) fn column(&self, from: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        self.matrix.column(from).iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }

    /// Entries A\[i, j\], column by column.
    #[cfg(feature = "serde")]
    pub(crate) fn values(&self) -> Vec<f64> {
        (0..self.matrix.states()).flat_map(|j| self.matrix.column(j)).copied().collect()
    }
}

#[cfg(feature = "serde")]
use super::Transition;

#[cfg(feature = "serde")]
crate::stored! {
    [] DenseTransition: [], |a| {
        states: usize = a.states(),
        columns: Vec<f64> = a.values(),
    } => if states.checked_mul(states) == Some(columns.len()) {
        Self::from_fn(states, |to, from| columns[from * states + to])
    } else {
        Err(TransitionError::WrongLength { states, found: columns.len() })
    };
}
