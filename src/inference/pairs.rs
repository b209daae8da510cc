//! Pairwise posteriors: the move from one step to the next, given all observations.

use std::f64::consts::LN_2;
use std::fmt;

use super::form::Held;
use crate::error::InferenceError;
use crate::range;
use crate::transition::{Move, MoveCounts, Transition, TransitionEntries};

/// Pairwise posterior p(X_{k-1} = j, X_k = i | y_1 … y_T) of one step k, as a product that is
/// never stored: α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i).
///
/// Handed out by [`SmoothedStep::pairs`](super::SmoothedStep::pairs).
pub struct Pairs<'a, A: Transition> {
    pub(super) transition: &'a A,
    pub(super) control: &'a A::Control,
    pub(super) alpha: Held<'a>,
    /// γ_k / p_k over `scale`, or its logarithm.
    pub(super) ratio: &'a [f64],
    pub(super) in_logs: bool,
    pub(super) scale: f64,
}

impl<A: Transition> fmt::Debug for Pairs<'_, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pairs").field("states", &self.ratio.len()).finish_non_exhaustive()
    }
}

impl<A: TransitionEntries> Pairs<'_, A> {
    /// Returns the moves that the operator of this step allows, out of state 0 first, in
    /// ascending order; they sum to one, up to rounding (and up to entries below 1e-323 that an
    /// operator does not list as logarithms either). Moves out of a state of probability 0 may be
    /// left out. O(E) in all.
    pub fn moves(&self) -> impl Iterator<Item = Move> {
        let states = 0..self.ratio.len();
        let (linear, logs) = if self.in_logs { (0..0, states) } else { (states, 0..0) };
        let linear = linear.filter(|&from| self.alpha.linear[from] > 0.0).flat_map(move |from| {
            let outgoing = self.transition.outgoing(self.control, from);
            outgoing.map(move |(to, p)| {
                let weight = self.alpha.linear[from] * (p * self.ratio[to]) * self.scale;
                Move { from, to, weight }
            })
        });
        let logs = logs.flat_map(move |from| {
            let outgoing = self.transition.outgoing_log2(self.control, from);
            outgoing.map(move |(to, log2)| {
                let log = self.alpha.log(from) + log2 * LN_2 + self.ratio[to];
                Move { from, to, weight: log.exp() }
            })
        });
        linear.chain(logs)
    }

    /// Adds the moves of this step to others. They must sum to one, since an operator may list
    /// other entries than its product has.
    pub(super) fn add_to(
        &self,
        counts: &mut MoveCounts,
        step: usize,
    ) -> Result<(), InferenceError> {
        let sum = counts.add(self.moves());
        if range::is_one(sum) { Ok(()) } else { Err(InferenceError::PredictedSum { step, sum }) }
    }
}
