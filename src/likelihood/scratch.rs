//! Memory for diagonals, kept from step to step, so that a step allocates nothing.

use super::Diagonal;
use super::sparse_diagonal::SparseDiagonal;

/// Reusable memory for the values of a diagonal, kept from step to step.
///
/// ```
/// let mut scratch = wayfix::Scratch::default();
/// let b = scratch.values(3);
/// assert_eq!(b.len(), 3);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    values: Vec<f64>,
    parts: Vec<Scratch>,
    sparse: SparseDiagonal,
    /// True if diagonals are for a decoder, which takes logarithms to base 2.
    with_log2: bool,
}

impl Scratch {
    /// Returns a slice of `count` values to fill. Their initial contents are left over from
    /// earlier steps. Allocates only when it grows.
    #[inline]
    pub fn values(&mut self, count: usize) -> &mut [f64] {
        self.values.resize(count, 0.0);
        &mut self.values
    }

    /// Returns `count` values to fill, and `parts` separate scratches for the parts of a composed
    /// likelihood.
    pub fn with_parts(&mut self, count: usize, parts: usize) -> (&mut [f64], &mut [Scratch]) {
        self.values.resize(count, 0.0);
        self.parts.resize_with(parts.max(self.parts.len()), Scratch::default);
        (&mut self.values, &mut self.parts[..parts])
    }

    /// Asks for logarithms to base 2 with diagonals for which they cost nothing.
    pub(crate) fn ask_for_log2(&mut self) {
        self.with_log2 = true;
    }

    /// True if logarithms to base 2 are asked for.
    pub(super) fn takes_log2(&self) -> bool {
        self.with_log2
    }

    /// Returns the diagonal of valid likelihoods of some states, which exist and differ, and of all
    /// others.
    pub(super) fn sparse(
        &mut self,
        states: usize,
        listed: &[(usize, f64)],
        elsewhere: f64,
    ) -> Diagonal<'_> {
        self.sparse.write(states, listed, elsewhere, self.with_log2)
    }

    /// Returns the diagonal of ones for so many states.
    pub(super) fn ones(&mut self, states: usize) -> Diagonal<'_> {
        self.sparse.write(states, &[], 1.0, self.with_log2)
    }
}
