//! Pairwise posteriors: the move from one step to the next, given all observations.

use std::f64::consts::LN_2;
use std::fmt;
use std::ops::Range;

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
        let logs =
            self.log_moves_from(logs).map(|(from, to, log)| Move { from, to, weight: log.exp() });
        linear.chain(logs)
    }

    /// Moves out of these states, with the logarithms of their probabilities.
    fn log_moves_from(&self, states: Range<usize>) -> impl Iterator<Item = (usize, usize, f64)> {
        states.flat_map(move |from| {
            let outgoing = self.transition.outgoing_log2(self.control, from);
            outgoing.map(move |(to, log2)| {
                (from, to, self.alpha.log(from) + log2 * LN_2 + self.ratio[to])
            })
        })
    }

    /// Adds the moves of this step to others. They must sum to one, since an operator may list
    /// other entries than its product has.
    pub(super) fn add_to(
        &self,
        counts: &mut MoveCounts,
        step: usize,
    ) -> Result<(), InferenceError> {
        if self.in_logs {
            return self.add_logs_to(counts, step);
        }
        let sum = counts.add(self.moves());
        if range::is_one(sum) { Ok(()) } else { Err(InferenceError::PredictedSum { step, sum }) }
    }

    /// As [`add_to`](Self::add_to) from logarithms, which sum to one up to their digits: those of
    /// two likely moves may differ by the rounding of log-likelihoods of −1e15.
    #[cold]
    fn add_logs_to(&self, counts: &mut MoveCounts, step: usize) -> Result<(), InferenceError> {
        let logs = || self.log_moves_from(0..self.ratio.len());
        let largest = logs().fold(f64::NEG_INFINITY, |most, (_, _, log)| most.max(log));
        let sum = largest + logs().map(|(_, _, log)| (log - largest).exp()).sum::<f64>().ln();
        let terms = (0..self.ratio.len())
            .map(|state| self.alpha.log(state))
            .chain(self.ratio.iter().copied());
        let size =
            terms.filter(|log| log.is_finite()).fold(0.0, |size, log| f64::max(size, log.abs()));
        // Without a possible move the sum is NaN here, and 0.
        if sum.is_nan() || sum.abs() > range::log_rounding(size) {
            return Err(InferenceError::PredictedSum { step, sum: f64::max(sum.exp(), 0.0) });
        }
        counts.add(logs().map(|(from, to, log)| Move { from, to, weight: (log - sum).exp() }));
        Ok(())
    }
}
