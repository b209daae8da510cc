//! [`Scratch`], memory for diagonals that is kept from step to step, so that a step allocates
//! nothing.
//!
//! The diagonal of a sparse observation is written over that of the previous step: all n states are
//! written only if the value of the unlisted ones changes.

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
    /// True if diagonals are for a decoder, which takes base-2 logarithms.
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
        // Never shrinks: dropped parts would lose their memory.
        self.parts.resize_with(parts.max(self.parts.len()), Scratch::default);
        (&mut self.values, &mut self.parts[..parts])
    }

    /// Asks for base-2 logarithms with diagonals for which they cost nothing.
    pub(crate) fn ask_for_log2(&mut self) {
        self.with_log2 = true;
    }

    /// True if base-2 logarithms are asked for.
    pub(super) fn takes_log2(&self) -> bool {
        self.with_log2
    }

    /// Returns the diagonal with valid likelihoods for some states, which exist and differ, and one
    /// value for all others.
    pub(super) fn sparse(
        &mut self,
        states: usize,
        listed: &[(usize, f64)],
        elsewhere: f64,
    ) -> Diagonal<'_> {
        self.sparse.write(states, listed, elsewhere, self.with_log2)
    }

    /// Returns a diagonal of ones for this number of states.
    pub(super) fn ones(&mut self, states: usize) -> Diagonal<'_> {
        self.sparse.write(states, &[], 1.0, self.with_log2)
    }
}

/// Diagonal of the last sparse observation, and memory for the next one.
#[derive(Debug, Clone, Default)]
struct SparseDiagonal {
    linear: Vec<f64>,
    /// Base-2 logarithms, if they have been asked for; otherwise empty.
    log2: Vec<f64>,
    elsewhere: f64,
    /// States that were listed: all others have the value `elsewhere`.
    written: Vec<usize>,
}

impl SparseDiagonal {
    /// Writes a diagonal over the last one; likelihoods are valid, and states exist and differ.
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
        // Only states written last time differ from `elsewhere`, so that resetting those is enough,
        // if the value and the shape are the same. Bits are compared: −0 and 0 differ.
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
        // `elsewhere` counts for the maximum only if some state has it.
        let others = if listed.len() < states { elsewhere } else { 0.0 };
        let largest = listed.iter().fold(others, |largest, entry| largest.max(entry.1));
        Diagonal::checked(linear, largest, with_log2.then_some(log2))
    }
}
