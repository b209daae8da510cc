//! Prediction and update of a pruned belief with its bounds: "A step" of section 13 of the
//! [formulas](crate::guide::formulas).
//!
//! The invariant is that of [`Envelope`]: after either part, the exact belief times s is within the
//! bounds. Lower bounds are rounded down or set to 0, upper bounds are rounded up, and each number
//! that may have lost digits to underflow adds [`LOST`] to its excess.

use super::active_set::ActiveSet;
use super::envelope::{Envelope, LOST, PRUNED_LIFT, ROUNDED_UP, Raw};
use super::moves::Moves;
use super::weights::{Weight, Weights};
use crate::transition::TransitionEntries;

/// Lifted number below which digits may be lost, so that [`LOST`] is counted.
const SMALL: f64 = 1e-270;

/// Sums of a prediction.
pub(crate) struct Predicted {
    /// Σ of the predicted estimates.
    pub(crate) sum: f64,
    /// Largest number of terms of a sum.
    terms: usize,
}

/// Sums over the entries into a state, lifted except for `beyond`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    pub(crate) estimate: f64,
    pub(crate) lower: f64,
    pub(crate) excess: f64,
    /// Sum of the entries out of inactive states.
    pub(crate) beyond: f64,
    /// Upper bound on the number of entries.
    pub(crate) terms: usize,
}

impl Envelope {
    /// Predicts all candidates from `before`. The results are lifted.
    pub(crate) fn predict<A: TransitionEntries>(
        &mut self,
        before: &Self,
        moves: Option<&Moves<'_, A>>,
        active_set: &ActiveSet,
    ) -> Predicted {
        self.predict_by(before, moves, active_set, |i| before.sums(i, moves, active_set))
    }

    /// Predicts all candidates, with sums computed by `sums`.
    pub(crate) fn predict_by<A: TransitionEntries>(
        &mut self,
        before: &Self,
        moves: Option<&Moves<'_, A>>,
        active_set: &ActiveSet,
        mut sums: impl FnMut(usize) -> Sums,
    ) -> Predicted {
        self.clear();
        let mut predicted = Predicted { sum: 0.0, terms: 1 };
        // δ' = min(R δ, m t) for each state that only inactive states lead to, and t' for all of
        // them together. Lifted before the product, since evidence may make bounds on entries tiny:
        // whatever still underflows is below the 1e-290 that is added.
        let (elsewhere, outside) =
            (before.others.elsewhere * PRUNED_LIFT, before.others.outside * PRUNED_LIFT);
        let (one, all) = match moves {
            Some(Moves { bounds, .. }) => {
                let by_row = times(bounds.row, elsewhere);
                (by_row.min(times(bounds.entry, outside)), times(bounds.column, outside))
            }
            None => (elsewhere, outside),
        };
        let round_up = |x: f64| if before.is_open() { x * ROUNDED_UP + LOST } else { 0.0 };
        (self.others.elsewhere, self.others.outside) = (round_up(one), round_up(all));
        for &i in active_set.candidates() {
            // Only the sensor names this candidate: no active state leads to it, so that it has no
            // estimate, and the upper bound of any inactive state.
            if !active_set.is_reached(i) {
                self.push(i, 0.0, 0.0, self.others.elsewhere);
                continue;
            }
            let Sums { estimate, lower, mut excess, beyond, terms } = sums(i);
            predicted.terms = predicted.terms.max(terms);
            predicted.sum += estimate / PRUNED_LIFT;
            // δ Σ_{j not in S} A[i, j]: no inactive state has more than `elsewhere`.
            excess += times(beyond, elsewhere);
            // NaN comes from an entry of 0 times an infinite excess: nothing is known.
            let excess = if excess.is_nan() { f64::INFINITY } else { excess };
            let (lower, excess) = count_lost(estimate, lower, excess);
            self.push(i, estimate, lower, excess);
        }
        predicted
    }

    /// Computes the sums over the entries into a state, one entry at a time.
    #[inline]
    fn sums<A: TransitionEntries>(
        &self,
        i: usize,
        moves: Option<&Moves<'_, A>>,
        active_set: &ActiveSet,
    ) -> Sums {
        let (mut estimate, mut lower, mut excess) = (0.0, 0.0, 0.0);
        let (mut beyond, mut terms) = (0.0, 0);
        let mut add = |j: usize, a: f64, off: f64| {
            terms += 1;
            if let Some(at) = active_set.place(j) {
                estimate += a * (self.estimate[at] * PRUNED_LIFT);
                // The entry lies between a (1 − off) and a (1 + off): the lower bound takes the
                // former, and the excess below covers the difference to the latter, 2 off a.
                let least = self.lower[at] * PRUNED_LIFT;
                lower += a * (1.0 - off) * least;
                excess += a * (1.0 + off) * (self.excess[at] * PRUNED_LIFT);
                if off > 0.0 {
                    // An entry below the range of `f64` was passed as 0, with this error.
                    let tiny = 2.0 * f64::MIN_POSITIVE;
                    excess += 2.0 * off * (a * least) * ROUNDED_UP;
                    excess += tiny * (least + self.excess[at] * PRUNED_LIFT);
                }
            } else {
                let most = if off > 0.0 { 2.0 * f64::MIN_POSITIVE } else { 0.0 };
                beyond += a * (1.0 + off) + most;
            }
        };
        match moves {
            Some(moves) => moves.incoming(i, add),
            None => add(i, 1.0, 0.0),
        }
        Sums { estimate, lower, excess, beyond, terms }
    }

    /// Multiplies the candidates by their likelihoods, and drops those that the sensor rules out.
    pub(crate) fn weigh(
        &mut self,
        Predicted { terms, .. }: Predicted,
        likelihoods: &[f64],
        weights: &Weights,
    ) -> Raw {
        let mut raw = Raw { estimate: 0.0, lower: 0.0, excess: 0.0, terms };
        let candidates = self.states.len();
        // Compacted in place: `kept` never passes `at`.
        let mut kept = 0;
        for (at, &b) in (0..candidates).zip(likelihoods) {
            let Weight { value, least, most } = weights.of(b);
            if most == 0.0 {
                continue;
            }
            let (lower, excess) = (self.lower[at], self.excess[at]);
            // The exact value is between least · lower and most · (lower + excess). The former
            // becomes the lower bound, and the difference the excess.
            let excess = times(most, excess) + times(most - least, lower);
            let estimate = value * self.estimate[at];
            let (lower, excess) = count_lost(estimate, least * lower, excess);
            self.states[kept] = self.states[at];
            self.estimate[kept] = estimate;
            self.lower[kept] = lower;
            self.excess[kept] = excess;
            raw.estimate += estimate;
            raw.lower += lower;
            raw.excess += excess;
            kept += 1;
        }
        self.truncate(kept);
        let open = self.is_open() && weights.others > 0.0;
        let weigh = |x| if open { times(weights.others, x) * ROUNDED_UP + LOST } else { 0.0 };
        (self.others.elsewhere, self.others.outside) =
            (weigh(self.others.elsewhere), weigh(self.others.outside));
        raw.excess += self.others.outside;
        raw
    }
}

/// Returns a lower bound and an excess that cover the digits that these two and the estimate may
/// have lost to underflow. A lower bound that may have lost digits becomes 0.
#[inline]
fn count_lost(estimate: f64, lower: f64, excess: f64) -> (f64, f64) {
    if estimate < SMALL || lower < SMALL { (0.0, excess + (lower + LOST)) } else { (lower, excess) }
}

/// Returns the product of two non-negative numbers that may be infinite; 0 if either is 0.
#[inline]
fn times(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}
