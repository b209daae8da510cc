//! Pairwise posteriors: the move from one step to the next, given all observations (ξ_k of section
//! 4 of the [formulas](crate::guide::formulas)).
//!
//! The product is never stored; it is enumerated over the entries of A. Its sum must be one, which
//! every routine that adds moves up checks.

use std::f64::consts::LN_2;
use std::fmt;
use std::ops::Range;

use crate::error::InferenceError;
use crate::inference::step::in_logs::BeliefRef;
use crate::transition::{LearnTransition, Move, MoveCounts, Transition, TransitionEntries, log};
use wayfix_kernels as kernels;
use wayfix_kernels::limits;

/// Pairwise posterior p(X_{k-1} = j, X_k = i | y_1 … y_T) of one step k, as a product that is
/// never stored: α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i).
pub(crate) struct Pairs<'a, A: Transition> {
    pub(crate) transition: &'a A,
    pub(crate) control: &'a A::Control,
    pub(crate) alpha: BeliefRef<'a>,
    /// γ_k / p_k divided by `scale`, or its logarithm.
    pub(crate) ratio: &'a [f64],
    pub(crate) in_logs: bool,
    pub(crate) scale: f64,
}

impl<A: Transition> fmt::Debug for Pairs<'_, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pairs").field("states", &self.ratio.len()).finish_non_exhaustive()
    }
}

impl<A: TransitionEntries> Pairs<'_, A> {
    /// Returns the moves, as [`SmoothedStep::moves`](crate::inference::SmoothedStep::moves) does.
    pub(crate) fn moves(&self) -> impl Iterator<Item = Move> {
        let states = 0..self.ratio.len();
        // One iterator type for both forms: one of the two ranges is empty.
        let (linear, logs) = if self.in_logs { (0..0, states) } else { (states, 0..0) };
        let linear = linear
            .filter(|&from| self.alpha.linear[from] > 0.0)
            .flat_map(move |from| self.out_of(from, self.transition.outgoing(self.control, from)));
        let list = |from| self.transition.outgoing_log2(self.control, from);
        let logs =
            self.log_moves(logs, list).map(|(from, to, log)| Move { from, to, weight: log.exp() });
        linear.chain(logs)
    }

    /// Moves out of a state along its entries, in linear space.
    fn out_of(
        &self,
        from: usize,
        entries: impl Iterator<Item = (usize, f64)>,
    ) -> impl Iterator<Item = Move> {
        entries.map(move |(to, p)| {
            // A small belief may meet a large ratio: the entry times the ratio is computed first,
            // and the common scale is applied last.
            let weight = self.alpha.linear[from] * (p * self.ratio[to]) * self.scale;
            Move { from, to, weight }
        })
    }

    /// Adds the moves of this step to the counts. They must sum to one, which fails if an operator
    /// lists other entries than its products have.
    pub(crate) fn add_to(
        &self,
        counts: &mut MoveCounts,
        step: usize,
    ) -> Result<(), InferenceError> {
        if !self.in_logs {
            return one(counts.add(self.moves()), step);
        }
        let list = |from| self.transition.outgoing_log2(self.control, from);
        self.add_logs_to(counts, step, list, f64::NEG_INFINITY)
    }

    /// Moves out of these states along their entries, with the logarithms of their probabilities.
    fn log_moves<I: Iterator<Item = (usize, f64)>>(
        &self,
        states: Range<usize>,
        list: impl Fn(usize) -> I,
    ) -> impl Iterator<Item = (usize, usize, f64)> {
        states.flat_map(move |from| {
            let log = self.alpha.log(from);
            list(from).map(move |(to, log2)| (from, to, log + log2 * LN_2 + self.ratio[to]))
        })
    }

    /// Adds moves given by logarithms. Together with exp(`others`) they must sum to one, up to the
    /// rounding of the logarithms, which is large for log-likelihoods of −1e15.
    #[cold]
    fn add_logs_to<I: Iterator<Item = (usize, f64)>>(
        &self,
        counts: &mut MoveCounts,
        step: usize,
        list: impl Fn(usize) -> I,
        others: f64,
    ) -> Result<(), InferenceError> {
        let logs = || self.log_moves(0..self.ratio.len(), &list);
        // Log-sum-exp: terms that underflow relative to the largest do not matter.
        let largest = logs().fold(others, |most, (_, _, log)| most.max(log));
        let sum: f64 = logs().map(|(_, _, log)| (log - largest).exp()).sum();
        let sum = largest + (sum + (others - largest).exp()).ln();
        // A sum of logarithms rounds relative to the largest of its terms.
        let terms = (0..self.ratio.len())
            .map(|state| self.alpha.log(state))
            .chain(self.ratio.iter().copied());
        let size =
            terms.filter(|log| log.is_finite()).fold(0.0, |size, log| f64::max(size, log.abs()));
        // Without a possible move, `sum` is NaN (−∞ minus −∞); the error then reports 0, since
        // `max` ignores a NaN.
        if sum.is_nan() || sum.abs() > limits::log_rounding(size) {
            return Err(InferenceError::PredictedSum { step, sum: f64::max(sum.exp(), 0.0) });
        }
        // Normalised, so that this rounding does not accumulate in the counts.
        counts.add(logs().map(|(from, to, log)| Move { from, to, weight: (log - sum).exp() }));
        Ok(())
    }
}

impl<A: LearnTransition> Pairs<'_, A> {
    /// Adds the moves of this step that learning counts to its statistics, as
    /// [`add_to`](Self::add_to) does. Restarts, which may come from any state, are not counted but
    /// belong to the sum that is checked: they have (Σ_j α_{k-1}(j)) Σ_i ε r(i) γ_k(i) / p_k(i)
    /// ("Restart" in section 10 of the [formulas](crate::guide::formulas)).
    pub(crate) fn count_to(
        &self,
        statistics: &mut A::Statistics,
        step: usize,
    ) -> Result<(), InferenceError> {
        let (transition, states) = (self.transition, 0..self.ratio.len());
        if !self.in_logs {
            let (before, after) = (self.alpha.linear, self.ratio);
            let added = transition.add_step(statistics, self.control, before, after, self.scale);
            // The operator has added the step itself, in one pass over its matrix.
            if let Some(sum) = added {
                return one(sum, step);
            }
        }
        let Some(counts) = transition.counts(statistics, self.control) else { return Ok(()) };
        let restart = |to: usize| transition.restart_log2(self.control, to);
        if !self.in_logs {
            let from = states.clone().filter(|&from| self.alpha.linear[from] > 0.0);
            let sum = counts.add(
                from.flat_map(|from| self.out_of(from, transition.counted(self.control, from))),
            );
            let into = |to: usize| match restart(to) {
                f64::NEG_INFINITY => 0.0,
                log2 => log2.exp2() * self.ratio[to],
            };
            // Restarts are equally likely from all states, so that their mass is a product of two
            // sums instead of a sum over n² moves.
            let restarts: f64 = states.map(into).sum();
            let before = if restarts > 0.0 { kernels::sum(self.alpha.linear) } else { 0.0 };
            return one(sum + before * restarts * self.scale, step);
        }
        let sum = |logs: &mut dyn Iterator<Item = f64>| logs.fold(f64::NEG_INFINITY, log::add);
        // The ratio of a state that no move leads to may be NaN, so states without a restart are
        // dropped before it is read.
        let restarted = states.clone().map(|to| (to, restart(to) * LN_2));
        let restarted = restarted.filter(|entry| entry.1 > f64::NEG_INFINITY);
        let restarts = sum(&mut restarted.map(|(to, log)| log + self.ratio[to]));
        let others = restarts + sum(&mut states.map(|from| self.alpha.log(from)));
        let list = |from| transition.counted_log2(self.control, from);
        self.add_logs_to(counts, step, list, others)
    }
}

/// Returns an error unless the moves of a step sum to one.
fn one(sum: f64, step: usize) -> Result<(), InferenceError> {
    if limits::is_one(sum) { Ok(()) } else { Err(InferenceError::PredictedSum { step, sum }) }
}
