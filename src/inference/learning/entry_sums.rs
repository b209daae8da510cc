//! Expected moves of a sequence by itself, through a stored matrix.
//!
//! ξ_k(j, i) = α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i) (section 9 of the
//! [formulas](crate::guide::formulas)), so that the sum over k is A\[i, j\] times a sum of products of
//! two numbers, as in lanes: nothing is looked up or compared for each move of each step.

use crate::hmm::Hmm;
use crate::inference::sequences::pairwise::Pairs;
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

    /// Adds the moves of a step in linear space; false if it is in logarithms.
    pub(super) fn add<A: LearnTransition>(&mut self, pairs: &Pairs<'_, A>) -> bool {
        if pairs.in_logs {
            return false;
        }
        let stride = self.sums.len() / self.states;
        for (from, alpha) in pairs.alpha.linear.iter().enumerate() {
            // The ratio of a state that is not predicted may be NaN: nothing possible leads there.
            if *alpha == 0.0 {
                continue;
            }
            match self.columns {
                Lines::Sparse { starts, indices, .. } => {
                    let column = starts[from] as usize..starts[from + 1] as usize;
                    let sums = &mut self.sums[column.clone()];
                    for (sum, to) in sums.iter_mut().zip(&indices[column]) {
                        *sum += alpha * pairs.ratio[*to as usize] * pairs.scale;
                    }
                }
                Lines::Dense { .. } | Lines::DenseTransposed { .. } => {
                    let sums = &mut self.sums[from * stride..][..self.states];
                    for (sum, ratio) in sums.iter_mut().zip(pairs.ratio) {
                        *sum += alpha * ratio * pairs.scale;
                    }
                }
            }
        }
        true
    }

    /// Counts of all entries.
    pub(super) fn counts(&self) -> MoveCounts {
        MoveCounts::of_entries(self.columns, self.states, |at| self.sums[at])
    }
}
