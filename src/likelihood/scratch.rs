//! Memory for diagonals, kept from step to step, so that a step allocates nothing.
//!
//! A diagonal of a few states is written over the one of the step before: all n states are written
//! only where the value of the others changes.

use super::Diagonal;
use wayfix_kernels as kernels;

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

/// Diagonal of a sparse observation, and memory for the next one.
#[derive(Debug, Clone, Default)]
struct SparseDiagonal {
    linear: Vec<f64>,
    /// Logarithms to base 2, if they have been asked for.
    log2: Vec<f64>,
    elsewhere: f64,
    /// States with other values than `elsewhere`.
    written: Vec<usize>,
}

impl SparseDiagonal {
    /// Writes a diagonal of valid likelihoods, of states that exist and differ, over the last one.
    fn write(
        &mut self,
        states: usize,
        listed: &[(usize, f64)],
        elsewhere: f64,
        with_log2: bool,
    ) -> Diagonal<'_> {
        let Self { linear, log2, written, .. } = self;
        let (wanted, log2_elsewhere) =
            if with_log2 { (states, kernels::log2(elsewhere)) } else { (0, 0.0) };
        let same = self.elsewhere.to_bits() == elsewhere.to_bits();
        if same && linear.len() == states && log2.len() == wanted {
            written.iter().for_each(|&state| linear[state] = elsewhere);
            if with_log2 {
                written.iter().for_each(|&state| log2[state] = log2_elsewhere);
            }
        } else {
            self.elsewhere = elsewhere;
            linear.clear();
            linear.resize(states, elsewhere);
            log2.clear();
            log2.resize(wanted, log2_elsewhere);
        }
        written.clear();
        written.extend(listed.iter().map(|entry| entry.0));
        listed.iter().for_each(|&(state, b)| linear[state] = b);
        if with_log2 {
            listed.iter().for_each(|&(state, b)| log2[state] = kernels::log2(b));
        }
        let others = if listed.len() < states { elsewhere } else { 0.0 };
        let largest = listed.iter().fold(others, |largest, entry| largest.max(entry.1));
        Diagonal::checked(linear, largest, with_log2.then_some(log2))
    }
}
