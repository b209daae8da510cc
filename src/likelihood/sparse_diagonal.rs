//! A diagonal of a few states, written over the one of the step before: all n states are written
//! only where the value of the others changes.

use super::Diagonal;
use crate::kernels;

/// Diagonal of a sparse observation, and memory for the next one.
#[derive(Debug, Clone, Default)]
pub(super) struct SparseDiagonal {
    linear: Vec<f64>,
    /// Logarithms to base 2, if they have been asked for.
    log2: Vec<f64>,
    elsewhere: f64,
    /// States with other values than `elsewhere`.
    written: Vec<usize>,
}

impl SparseDiagonal {
    /// Writes a diagonal of valid likelihoods, of states that exist and differ, over the last one.
    pub(super) fn write(
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
