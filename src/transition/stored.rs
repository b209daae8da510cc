//! Operators of the stored matrices, [`SparseTransition`] and [`DenseTransition`], and [`Stored`],
//! by which inference recognises them and fuses the product with its other loops.

use super::{DenseTransition, SparseTransition, Transition, TransitionEntries, check_slices, log};
use crate::error::TransitionError;
use wayfix_kernels::{Lines, Panels};

/// A stored matrix that this crate has specialised loops for.
///
/// Returned by [`Transition::stored`](super::Transition::stored).
#[derive(Debug, Clone, Copy)]
pub struct Stored<'a>(Form<'a>);

/// Storage format.
#[derive(Debug, Clone, Copy)]
enum Form<'a> {
    Sparse(&'a SparseTransition),
    Dense(&'a DenseTransition),
}

impl<'a> Stored<'a> {
    pub(crate) fn sparse(matrix: &'a SparseTransition) -> Self {
        Self(Form::Sparse(matrix))
    }

    pub(crate) fn dense(matrix: &'a DenseTransition) -> Self {
        Self(Form::Dense(matrix))
    }

    /// A column of the matrix.
    pub(crate) fn column(self, from: usize) -> Vec<f64> {
        fn dense(states: usize, column: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
            let mut values = vec![0.0; states];
            column.for_each(|(to, p)| values[to] = p);
            values
        }
        match self.0 {
            Form::Sparse(matrix) => dense(matrix.states(), matrix.outgoing(&(), from)),
            Form::Dense(matrix) => dense(matrix.states(), matrix.outgoing(&(), from)),
        }
    }

    /// The matrix, if it is sparse.
    pub(crate) fn as_sparse(self) -> Option<&'a SparseTransition> {
        match self.0 {
            Form::Sparse(matrix) => Some(matrix),
            Form::Dense(_) => None,
        }
    }

    /// True if all values above 0 are at least 2^-100.
    pub(crate) fn has_no_tiny_entries(self) -> bool {
        match self.0 {
            Form::Sparse(matrix) => matrix.no_tiny_entries,
            Form::Dense(matrix) => matrix.no_tiny_entries,
        }
    }

    /// Rows and columns.
    pub(crate) fn lines(self) -> (Lines<'a>, Lines<'a>) {
        match self.0 {
            Form::Sparse(matrix) => matrix.lines(),
            Form::Dense(matrix) => matrix.lines(),
        }
    }
}

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

impl Transition for SparseTransition {
    type Control = ();

    fn states(&self) -> usize {
        self.rows.lines()
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.sliced_rows.multiply(x, out);
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.sliced_columns.multiply(x, out);
    }

    fn stored(&self, (): &()) -> Option<Stored<'_>> {
        Some(Stored::sparse(self))
    }

    // Row by row, not by bands: rows are short, and one band costs as much as all of their sums
    // (see "The product in logarithms" in the formulas).

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = log::sum(self.rows.line(i), x);
        }
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = log::sum(self.columns.line(j), x);
        }
    }
}

impl TransitionEntries for SparseTransition {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.rows.line(to)
    }

    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.columns.line(from)
    }

    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        // Without likelihoods: the caller adds its own.
        self.maximize(x, None, out, from);
    }
}

impl Transition for DenseTransition {
    type Control = ();

    fn states(&self) -> usize {
        self.matrix.states()
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        self.matrix.multiply(x, out);
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        self.matrix.multiply_transpose(x, out);
    }

    fn stored(&self, (): &()) -> Option<Stored<'_>> {
        Some(Stored::dense(self))
    }

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        log::by_lines(x, out, |x, out| self.matrix.multiply(x, out), |i| self.row(i));
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        let product = |x: &[f64], out: &mut [f64]| self.matrix.multiply_transpose(x, out);
        log::by_lines(x, out, product, |j| self.column(j));
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
        check_slices(self.states(), x, out);
        // Logarithms are taken once, by the first decoding, and cost as much memory as the matrix.
        let entry = |i, j| self.matrix.column(j)[i];
        self.log2.get_or_init(|| Panels::log2(self.states(), entry)).maximize(x, out, from);
    }
}
