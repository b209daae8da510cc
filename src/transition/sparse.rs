//! [`SparseTransition`], which stores only the entries above 0.
//!
//! Invariant: rows and columns hold the same entries, each once, with ascending indices; columns
//! sum to one within 1e-9. Everything else (the sliced copies, the logarithms) derives from these.

use std::fmt;
use std::sync::OnceLock;

use super::Transition;
use super::check::{check_columns_of, check_count, check_rows, check_square};
use super::compressed::Compressed;
use crate::error::TransitionError;
use wayfix_kernels::limits;
use wayfix_kernels::{EntryValues, Lines, Scores, Sliced, max_step};

/// A sparse transition matrix, stored by rows and by columns with 32-bit indices.
///
/// Products cost O(entries). Zeros are not stored. Rows and columns take 24 bytes an entry and 8
/// bytes a state; the sliced copies, which products read by eight rows or columns at a time, take
/// another 17 to 60 bytes an entry; the first Viterbi adds up to 20 bytes an entry.
///
/// With the feature `rayon`, products and the loops of filter and smoother run on all threads of
/// the current pool if there are about 100,000 states or more (the pool may allocate now and then).
/// Results are identical to the bit for any number of threads, and without the feature.
///
/// ```
/// use wayfix::{SparseTransition, Transition};
///
/// // (to, from, probability): each column, the moves out of a state, sums to one.
/// let a = SparseTransition::from_triplets(2, [(0, 0, 0.7), (1, 0, 0.3), (1, 1, 1.0)])?;
/// let mut out = [0.0; 2];
/// a.apply(&(), &[0.5, 0.5], &mut out);
/// assert_eq!(out, [0.35, 0.65]);
/// # Ok::<(), wayfix::TransitionError>(())
/// ```
#[derive(Clone)]
pub struct SparseTransition {
    pub(super) rows: Compressed,
    pub(super) columns: Compressed,
    pub(crate) sliced_rows: Sliced,
    pub(crate) sliced_columns: Sliced,
    /// True if all entries are at least 2^-100.
    pub(crate) no_tiny_entries: bool,
    /// log2 of the values of the rows, computed by the first decoding.
    log2: OnceLock<EntryValues>,
}

impl fmt::Debug for SparseTransition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut out = f.debug_struct("SparseTransition");
        out.field("states", &self.rows.lines());
        out.field("entries", &self.rows.entries()).finish_non_exhaustive()
    }
}

impl SparseTransition {
    /// Creates an operator from entries (to, from, probability) in any order. O(n + entries),
    /// plus the sorting of the entries within every eight rows and columns.
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no states, an index out of range, a value that
    /// is NaN, negative or infinite, an entry above 0 given twice, a column that does
    /// not sum to one within 1e-9, or more than 2^31 − 1 states or
    /// 2^32 − 1 entries.
    pub fn from_triplets(
        states: usize,
        triplets: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, TransitionError> {
        let (rows, columns) = Self::compressed(states, triplets)?;
        Ok(Self::from_compressed(rows, columns))
    }

    /// Validated entries, by rows and by columns.
    pub(crate) fn compressed(
        states: usize,
        triplets: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<(Compressed, Compressed), TransitionError> {
        let wrong = |(to, from, value)| TransitionError::Entry { to, from, value };
        let entries = Self::above_zero(states, triplets, wrong)?;
        check_count("entries", entries.len())?;
        // Two counting sorts: the first groups by column in any order; the transpose then visits
        // the columns in order, so that the indices within each row ascend. Each stage is dropped
        // as soon as the next exists, since a large map may barely fit twice.
        let unsorted = Compressed::new(states, entries.iter().copied());
        drop(entries);
        let rows = unsorted.transposed();
        drop(unsorted);
        let mut sums = vec![0.0; states];
        for to in 0..states {
            // Indices ascend, so a duplicate is next to its twin.
            if let Some(twice) = rows.indices(to).windows(2).find(|pair| pair[0] == pair[1]) {
                return Err(TransitionError::Duplicate { to, from: twice[0] as usize });
            }
            rows.line(to).for_each(|(from, value)| sums[from] += value);
        }
        check_columns_of(&sums, |to| rows.line(to).map(|entry| entry.1).sum())?;
        let columns = rows.transposed();
        Ok((rows, columns))
    }

    /// Checks triplets, and returns those above 0 as (from, to, value); `wrong` makes the error for
    /// a value that is NaN, negative or infinite.
    #[doc(hidden)]
    pub fn above_zero(
        states: usize,
        triplets: impl IntoIterator<Item = (usize, usize, f64)>,
        wrong: impl Fn((usize, usize, f64)) -> TransitionError,
    ) -> Result<Vec<(u32, u32, f64)>, TransitionError> {
        if states == 0 {
            return Err(TransitionError::Empty);
        }
        // Hardware gathers read 32-bit indices as signed, hence 2^31 − 1 and not 2^32 − 1.
        if i32::try_from(states).is_err() {
            return Err(TransitionError::TooMany { what: "states", count: states });
        }
        let triplets = triplets.into_iter();
        let mut entries = Vec::with_capacity(triplets.size_hint().0);
        for (to, from, value) in triplets {
            if to >= states || from >= states {
                return Err(TransitionError::OutOfRange { to, from, states });
            }
            if !(value >= 0.0 && value.is_finite()) {
                return Err(wrong((to, from, value)));
            }
            if value > 0.0 {
                entries.push((from as u32, to as u32, value));
            }
        }
        Ok(entries)
    }

    pub(super) fn from_compressed(rows: Compressed, columns: Compressed) -> Self {
        // The two slicings are independent of each other and of the number of threads.
        let (sliced_rows, sliced_columns) = (|| rows.sliced(), || columns.sliced());
        #[cfg(feature = "rayon")]
        let (sliced_rows, sliced_columns) = rayon::join(sliced_rows, sliced_columns);
        #[cfg(not(feature = "rayon"))]
        let (sliced_rows, sliced_columns) = (sliced_rows(), sliced_columns());
        let no_tiny_entries =
            (0..rows.lines()).all(|i| rows.line(i).all(|(_, p)| limits::is_plain(p)));
        let log2 = OnceLock::new();
        Self { rows, columns, sliced_rows, sliced_columns, no_tiny_entries, log2 }
    }

    /// Creates an operator from the rows of A, including zeros:
    /// `rows[i][j]` = A\[i, j\] = p(to i | from j), so that **columns** sum to one. O(n²).
    ///
    /// ```
    /// use wayfix::SparseTransition;
    ///
    /// // A one-way street from state 0 to state 1, where the vehicle parks.
    /// let a = SparseTransition::from_rows(&[[0.75, 0.0], [0.25, 1.0]])?;
    /// assert_eq!((a.get(1, 0), a.get(0, 1)), (0.25, 0.0)); // (to, from)
    ///
    /// let error = SparseTransition::from_rows(&[[0.75, 0.25], [0.0, 1.0]]).unwrap_err();
    /// assert!(error.to_string().contains("the rows sum to one: transpose"));
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_triplets`](Self::from_triplets), or
    /// [`TransitionError::RowLength`] for a row that does not have n values.
    pub fn from_rows<R: AsRef<[f64]>>(rows: &[R]) -> Result<Self, TransitionError> {
        check_rows(rows)?;
        let entries = rows
            .iter()
            .enumerate()
            .flat_map(|(i, row)| row.as_ref().iter().enumerate().map(move |(j, &p)| (i, j, p)));
        // Zeros are skipped first, so that no memory is reserved for them.
        Self::from_triplets(rows.len(), entries.filter(|entry| entry.2 != 0.0))
    }

    /// Creates an operator from the rows of A, one after another in one slice:
    /// `matrix[i * n + j]` = A\[i, j\] = p(to i | from j). O(n²).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_triplets`](Self::from_triplets), or
    /// [`TransitionError::WrongLength`] unless there are n × n values.
    pub fn from_row_major(states: usize, matrix: &[f64]) -> Result<Self, TransitionError> {
        check_square(states, matrix.len())?;
        // Zeros are skipped first, so that no memory is reserved for them.
        let entries = matrix.iter().enumerate().filter(|entry| *entry.1 != 0.0);
        Self::from_triplets(states, entries.map(|(at, &p)| (at / states, at % states, p)))
    }

    /// Creates an operator from a dense faer view of A (columns sum to one). O(n²).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_triplets`](Self::from_triplets), or
    /// [`TransitionError::NotSquare`].
    #[cfg(feature = "faer")]
    pub fn from_faer(matrix: faer::MatRef<'_, f64>) -> Result<Self, TransitionError> {
        let (n, columns) = (matrix.nrows(), matrix.ncols());
        if n != columns {
            return Err(TransitionError::NotSquare { rows: n, columns });
        }
        let entries = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
        Self::from_triplets(n, entries.map(|(i, j)| (i, j, matrix[(i, j)])))
    }

    /// Creates an operator from a sparse faer view of A (columns sum to one). O(n + entries).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_triplets`](Self::from_triplets), or
    /// [`TransitionError::NotSquare`].
    #[cfg(feature = "faer")]
    pub fn from_faer_sparse(
        matrix: faer::sparse::SparseColMatRef<'_, usize, f64>,
    ) -> Result<Self, TransitionError> {
        let (n, columns) = (matrix.nrows(), matrix.ncols());
        if n != columns {
            return Err(TransitionError::NotSquare { rows: n, columns });
        }
        Self::from_triplets(n, matrix.triplet_iter().map(|t| (t.row, t.col, *t.val)))
    }

    /// Number of entries above 0, E.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.rows.entries()
    }

    /// Returns the entries (to, from, probability), row by row, as
    /// [`from_triplets`](Self::from_triplets) takes them.
    ///
    /// ```
    /// # use wayfix::SparseTransition;
    /// let entries = [(0, 0, 0.7), (1, 0, 0.3), (1, 1, 1.0)];
    /// let a = SparseTransition::from_triplets(2, entries)?;
    /// assert!(a.triplets().eq(entries));
    /// assert_eq!(format!("{a:?}"), "SparseTransition { states: 2, entries: 3, .. }");
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    pub fn triplets(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let rows = 0..self.rows.lines();
        rows.flat_map(|to| self.rows.line(to).map(move |(from, p)| (to, from, p)))
    }

    /// Returns A\[to, from\], or 0 if the entry is not stored or a state does not exist.
    /// O(log entries of the row).
    #[must_use]
    pub fn get(&self, to: usize, from: usize) -> f64 {
        let states = self.rows.lines();
        if to >= states || from >= states {
            return 0.0;
        }
        // The cast is exact: from < states < 2^31.
        let at = self.rows.indices(to).binary_search(&(from as u32)).ok();
        at.and_then(|at| self.rows.line(to).nth(at)).map_or(0.0, |entry| entry.1)
    }
}

impl SparseTransition {
    /// Entries by rows.
    #[doc(hidden)]
    #[must_use]
    pub fn rows(&self) -> &Compressed {
        &self.rows
    }

    /// Entries by columns.
    #[doc(hidden)]
    #[must_use]
    pub fn columns(&self) -> &Compressed {
        &self.columns
    }

    /// Positions of the entries out of a state among all entries, column by column.
    pub(crate) fn positions(&self, from: usize) -> std::ops::Range<usize> {
        self.columns.range(from)
    }

    /// Position of an entry among those out of a state. O(log entries of the column).
    pub(crate) fn position(&self, to: usize, from: usize) -> Option<usize> {
        self.columns.indices(from).binary_search_by_key(&to, |index| *index as usize).ok()
    }

    /// Rows and columns.
    pub(super) fn lines(&self) -> (Lines<'_>, Lines<'_>) {
        (self.rows.as_lines(), self.columns.as_lines())
    }

    /// Computes the max-product of a Viterbi step; see [`max_step`].
    pub(crate) fn maximize(
        &self,
        x: &[f64],
        likelihoods: Option<Scores<'_>>,
        next: &mut [f64],
        from: &mut [u32],
    ) -> f64 {
        let log2 = self.log2.get_or_init(|| self.sliced_rows.log2());
        max_step(&self.sliced_rows, log2, x, likelihoods, next, from)
    }
}

#[cfg(feature = "serde")]
use super::TransitionEntries;

impl SparseTransition {
    /// Creates a stored copy of any operator without a control, by one product per state. Useful
    /// for frequent decoding with an operator whose entries are expensive.
    /// O(n · (a product) + n log n + entries).
    ///
    /// # Errors
    ///
    /// [`TransitionError`] as [`from_triplets`](Self::from_triplets).
    pub fn from_operator<A>(operator: &A) -> Result<Self, TransitionError>
    where
        A: Transition<Control = ()> + ?Sized,
    {
        let n = operator.states();
        let (mut unit, mut column) = (vec![0.0; n], vec![0.0; n]);
        let mut entries = Vec::new();
        for from in 0..n {
            // A e_j is column j. Only one value of the unit vector is reset, not all n.
            unit[from] = 1.0;
            operator.apply(&(), &unit, &mut column);
            unit[from] = 0.0;
            let reached = column.iter().enumerate().filter(|(_, value)| **value != 0.0);
            entries.extend(reached.map(|(to, &value)| (to, from, value)));
        }
        Self::from_triplets(n, entries)
    }

    /// Returns the operator of `exponent` steps, A^m, for motion that is observed only at every m-th
    /// step; 0 steps are the identity. O(m n E).
    ///
    /// A power fills in: its entries are sums over the paths between two states.
    ///
    /// ```
    /// use wayfix::SparseTransition;
    ///
    /// let step = SparseTransition::from_rows(&[[0.5, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.5, 1.0]])?;
    /// let twice = step.power(2)?;
    /// assert_eq!([0, 1, 2].map(|to| twice.get(to, 0)), [0.25, 0.5, 0.25]);
    /// # Ok::<(), wayfix::TransitionError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError::TooMany`] for more than 2^32 − 1 entries.
    pub fn power(&self, exponent: u32) -> Result<Self, TransitionError> {
        let n = self.states();
        let mut entries = Vec::new();
        let (mut column, mut next) = (vec![0.0; n], vec![0.0; n]);
        for from in 0..n {
            // A^m e_j by m products, so that no power is rounded twice.
            column.fill(0.0);
            column[from] = 1.0;
            for _ in 0..exponent {
                self.apply(&(), &column, &mut next);
                std::mem::swap(&mut column, &mut next);
            }
            let reached = column.iter().enumerate().filter(|(_, p)| **p > 0.0);
            entries.extend(reached.map(|(to, &p)| (to, from, p)));
        }
        Self::from_triplets(n, entries)
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] SparseTransition: [], |a| {
        states: usize = a.states(),
        to: Vec<u32> = entries(a, |to, _, _| to as u32),
        from: Vec<u32> = entries(a, |_, from, _| from as u32),
        probability: Vec<f64> = entries(a, |_, _, p| p),
    } => sparse(states, &to, &from, &probability);
}

/// Maps each entry (to, from, probability), column by column.
#[cfg(feature = "serde")]
fn entries<T>(a: &SparseTransition, part: impl Fn(usize, usize, f64) -> T) -> Vec<T> {
    let columns = (0..a.states()).map(|from| (from, a.outgoing(&(), from)));
    let part = &part;
    columns.flat_map(|(from, column)| column.map(move |(to, p)| part(to, from, p))).collect()
}

#[cfg(feature = "serde")]
fn sparse(
    states: usize,
    to: &[u32],
    from: &[u32],
    probability: &[f64],
) -> Result<SparseTransition, TransitionError> {
    for (what, found) in [("from", from.len()), ("probability", probability.len())] {
        if found != to.len() {
            let what = format!("the number of values in `{what}`");
            let expected = "as many as in `to`";
            return Err(crate::error::OutOfRange::new(what, found as f64, expected).into());
        }
    }
    if to.len() < states {
        // Some state has no way out. An error before any allocation keeps a wrong number of
        // states from exhausting memory.
        let mut left = vec![false; to.len() + 1];
        for &from in from {
            if let Some(left) = left.get_mut(from as usize) {
                *left = true;
            }
        }
        let column = left.iter().position(|left| !left).unwrap_or(0);
        return Err(TransitionError::ColumnSum { column, sum: 0.0 });
    }
    let entries = to.iter().zip(from).zip(probability);
    SparseTransition::from_triplets(
        states,
        entries.map(|((&to, &from), &p)| (to as usize, from as usize, p)),
    )
}
