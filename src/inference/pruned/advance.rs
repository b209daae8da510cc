//! A step of a pruned belief: prediction and update of all that is known of it.

use super::super::frontier::Frontier;
use super::envelope::{Envelope, LIFT, LOST};
use super::weights::{Weight, Weights};
use crate::transition::TransitionEntries;

/// Below this a lifted number may have lost digits, and [`LOST`] is counted for it.
const SMALL: f64 = 1e-270;
/// For what a bound may lose by a dozen roundings.
const ROUNDED_UP: f64 = 1.0 + 12.0 * f64::EPSILON;
/// How far columns may be off one.
const COLUMN: f64 = 1.0 + 1.1e-9;

/// The largest entry of A, and the largest sum of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows {
    entry: f64,
    sum: f64,
}

impl Rows {
    /// O(E).
    pub(super) fn of<A: TransitionEntries<Control = ()>>(transition: &A) -> Self {
        let mut largest = Self { entry: 0.0, sum: 0.0 };
        for i in 0..transition.states() {
            let (mut sum, mut terms) = (0.0, 0_u32);
            for (_, a) in transition.incoming(&(), i) {
                largest.entry = f64::max(largest.entry, a);
                sum += a;
                terms += 1;
            }
            largest.sum = f64::max(largest.sum, sum * (1.0 + f64::from(terms) * f64::EPSILON));
        }
        largest
    }
}

/// The sums of a prediction.
pub(super) struct Predicted {
    /// Σ of the predicted estimates.
    pub(super) sum: f64,
    /// The most terms of a sum.
    terms: usize,
}

/// The sums of a step before it is scaled.
pub(super) struct Raw {
    /// Σ of the estimates, lifted.
    pub(super) estimate: f64,
    /// Σ of the lower bounds, lifted.
    pub(super) lower: f64,
    /// Σ of all excess.
    pub(super) excess: f64,
    /// The most terms of a sum.
    pub(super) terms: usize,
}

impl Envelope {
    /// Predicts all candidates from `before`; lifted.
    pub(super) fn predict<A: TransitionEntries<Control = ()>>(
        &mut self,
        before: &Self,
        transition: Option<(&A, Rows)>,
        frontier: &Frontier,
    ) -> Predicted {
        self.clear();
        let mut predicted = Predicted { sum: 0.0, terms: 1 };
        // What comes to a state from outside only.
        let (each, all) = match transition {
            Some((_, rows)) => {
                let by_row = rows.sum * before.elsewhere;
                (by_row.min(rows.entry * before.outside), COLUMN * before.outside)
            }
            None => (before.elsewhere, before.outside),
        };
        let lift = |x: f64| if before.is_open() { x * LIFT * ROUNDED_UP + LOST } else { 0.0 };
        (self.elsewhere, self.outside) = (lift(each), lift(all));
        for &i in frontier.candidates() {
            if !frontier.is_reached(i) {
                self.push(i, 0.0, 0.0, self.elsewhere);
                continue;
            }
            let (mut estimate, mut lower, mut excess) = (0.0, 0.0, 0.0);
            let (mut beyond, mut terms) = (0.0, 0);
            let mut add = |j: usize, a: f64| {
                terms += 1;
                if let Some(at) = frontier.place(j) {
                    estimate += a * (before.estimate[at] * LIFT);
                    lower += a * (before.lower[at] * LIFT);
                    excess += a * (before.excess[at] * LIFT);
                } else {
                    beyond += a;
                }
            };
            match transition {
                Some((a, _)) => a.incoming(&(), i).for_each(|(j, a)| add(j, a)),
                None => add(i, 1.0),
            }
            predicted.terms = predicted.terms.max(terms);
            predicted.sum += estimate / LIFT;
            excess += times(beyond, before.elsewhere * LIFT);
            // NaN is an entry of 0 times an infinite excess: nothing is known.
            let excess = if excess.is_nan() { f64::INFINITY } else { excess };
            let (lower, excess) = count_lost(estimate, lower, excess);
            self.push(i, estimate, lower, excess);
        }
        predicted
    }

    /// Takes the likelihoods of the candidates, and drops what they rule out.
    pub(super) fn weigh(
        &mut self,
        Predicted { terms, .. }: Predicted,
        likelihoods: &[f64],
        weights: &Weights,
    ) -> Raw {
        let mut raw = Raw { estimate: 0.0, lower: 0.0, excess: 0.0, terms };
        let candidates = self.states.len();
        let mut kept = 0;
        for (at, &b) in (0..candidates).zip(likelihoods) {
            let Weight { value, least, most } = weights.of(b);
            if most == 0.0 {
                continue;
            }
            let (lower, excess) = (self.lower[at], self.excess[at]);
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
        (self.elsewhere, self.outside) = (weigh(self.elsewhere), weigh(self.outside));
        raw.excess += self.outside;
        raw
    }
}

/// A lower bound and an excess, with what they and the estimate may have lost below the
/// smallest double. A lower bound that may have lost digits is none.
#[inline]
fn count_lost(estimate: f64, lower: f64, excess: f64) -> (f64, f64) {
    if estimate < SMALL || lower < SMALL { (0.0, excess + (lower + LOST)) } else { (lower, excess) }
}

/// The product of two numbers of which one may be infinite; 0 if one of them is.
#[inline]
fn times(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}
