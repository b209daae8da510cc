//! One step of a pruned belief: prediction and update of all that is known of it.

use super::super::frontier::Frontier;
use super::envelope::{Envelope, LIFT, LOST};
use crate::transition::TransitionEntries;

/// Below this a lifted number may have lost digits, and gets [`LOST`] more.
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

/// The likelihoods of a step, none of them far above one.
pub(super) struct Weights<'a> {
    /// One for each candidate.
    pub(super) listed: &'a [f64],
    /// At least as large as any other.
    pub(super) others: f64,
}

/// What came out of a step before it was scaled.
pub(super) struct Raw {
    /// Σ of the estimates, lifted.
    pub(super) estimate: f64,
    /// Σ of the lower bounds, lifted.
    pub(super) lower: f64,
    /// Σ of all excess.
    pub(super) excess: f64,
    /// Σ of the predicted estimates.
    pub(super) predicted: f64,
    /// The most terms of a sum.
    pub(super) terms: usize,
}

impl Envelope {
    /// Takes all candidates a step on from `before`; lifted, and not yet scaled.
    pub(super) fn advance<A: TransitionEntries<Control = ()>>(
        &mut self,
        before: &Self,
        transition: Option<(&A, Rows)>,
        frontier: &Frontier,
        weights: &Weights<'_>,
    ) -> Raw {
        self.clear();
        let mut raw = Raw { estimate: 0.0, lower: 0.0, excess: 0.0, predicted: 0.0, terms: 1 };
        // What comes to a state from outside only.
        let (each, all) = match transition {
            Some((_, rows)) => {
                let by_row = rows.sum * before.elsewhere;
                (by_row.min(rows.entry * before.outside), COLUMN * before.outside)
            }
            None => (before.elsewhere, before.outside),
        };
        let weigh = |b: f64, x: f64| {
            let possible = b > 0.0 && before.is_open();
            if possible { (b * (x * LIFT)) * ROUNDED_UP + LOST } else { 0.0 }
        };
        for (&i, &b) in frontier.candidates().iter().zip(weights.listed) {
            if !frontier.is_reached(i) {
                let excess = weigh(b, each);
                raw.excess += excess;
                self.push(i, 0.0, 0.0, excess);
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
            raw.terms = raw.terms.max(terms);
            raw.predicted += estimate / LIFT;
            if b == 0.0 {
                continue;
            }
            let inflow = if beyond > 0.0 { beyond * (before.elsewhere * LIFT) } else { 0.0 };
            (estimate, lower, excess) = (b * estimate, b * lower, b * (excess + inflow));
            if lower + excess < SMALL {
                excess += LOST;
            }
            raw.estimate += estimate;
            raw.lower += lower;
            raw.excess += excess;
            self.push(i, estimate, lower, excess);
        }
        (self.elsewhere, self.outside) = (weigh(weights.others, each), weigh(weights.others, all));
        raw.excess += self.outside;
        raw
    }
}
