//! Expected moves of a sequence by itself, through a stored matrix.
//!
//! ξ_k(j, i) = α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i) (section 9 of the
//! [formulas](crate::guide::formulas)), so that the sum over k is A\[i, j\] times a sum of products of
//! two numbers, as in lanes: nothing is looked up or compared for each move of each step.

use crate::hmm::Hmm;
use crate::kernels::Lines;
use crate::likelihood::LearnLikelihood;
use crate::transition::{LearnTransition, MoveCounts};

/// Sums over steps of α_{k-1}(j) γ_k(i) / p_k(i), for each entry of a matrix.
pub(super) struct EntrySums<'m> {
    columns: Lines<'m>,
    states: usize,
    sums: Vec<f64>,
}

impl<'m> EntrySums<'m> {
    /// `None` if moves are not counted, or not by the entries of a stored matrix. Its entries are at
    /// least 2^-100, so that products without them stay in the range of `f64`.
    pub(super) fn new<A: LearnTransition, B: LearnLikelihood>(
        hmm: &'m Hmm<A, B>,
        statistics: &mut A::Statistics,
    ) -> Option<Self> {
        let (transition, states) = (hmm.transition(), hmm.states());
        let control = transition.no_control()?;
        transition.counts(statistics, control)?;
        if transition.evidence(control).is_some() {
            return None;
        }
        let (_, columns) = transition.stored(control)?.plain_lines()?;
        Some(Self { columns, states, sums: vec![0.0; columns.values().len()] })
    }

    /// Adds a step: α before it, and the ratios γ / p times a scale.
    pub(super) fn add(&mut self, alpha: &[f64], ratio: &[f64], scale: f64) {
        let stride = self.sums.len() / self.states;
        for (from, alpha) in alpha.iter().enumerate() {
            // The ratio of a state that is not predicted may be NaN: nothing possible leads there.
            if *alpha == 0.0 {
                continue;
            }
            match self.columns {
                Lines::Sparse { starts, indices, .. } => {
                    let column = starts[from] as usize..starts[from + 1] as usize;
                    let sums = &mut self.sums[column.clone()];
                    for (sum, to) in sums.iter_mut().zip(&indices[column]) {
                        *sum += alpha * ratio[*to as usize] * scale;
                    }
                }
                Lines::Dense { .. } | Lines::DenseTransposed { .. } => {
                    let sums = &mut self.sums[from * stride..][..self.states];
                    for (sum, ratio) in sums.iter_mut().zip(ratio) {
                        *sum += alpha * ratio * scale;
                    }
                }
            }
        }
    }

    /// Writes p = A α.
    pub(super) fn predict(&self, alpha: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        let stride = self.sums.len() / self.states;
        for (from, alpha) in alpha.iter().enumerate() {
            match self.columns {
                Lines::Sparse { starts, indices, values } => {
                    let column = starts[from] as usize..starts[from + 1] as usize;
                    for (to, p) in indices[column.clone()].iter().zip(&values[column]) {
                        out[*to as usize] += alpha * p;
                    }
                }
                Lines::Dense { values } | Lines::DenseTransposed { values } => {
                    for (sum, p) in out.iter_mut().zip(&values[from * stride..]) {
                        *sum += alpha * p;
                    }
                }
            }
        }
    }

    /// Adds the counts of all entries to the statistics of the operator.
    pub(super) fn finish<A: LearnTransition, B: LearnLikelihood>(
        &self,
        hmm: &Hmm<A, B>,
        statistics: &mut A::Statistics,
    ) {
        let control = hmm.transition().no_control();
        if let Some(counts) = control.and_then(|u| hmm.transition().counts(statistics, u)) {
            counts.merge(&MoveCounts::of_entries(self.columns, self.states, |at| self.sums[at]));
        }
    }
}
