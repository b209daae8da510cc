//! Proven bounds on the exact belief: the limits ℓ, c, δ and t of section 13 of the
//! [formulas](crate::guide::formulas), their scaling, dropping, and the bound that follows.
//!
//! | formulas | here |
//! |---|---|
//! | ℓ(i) | `lower` |
//! | c(i) | `excess` |
//! | δ | `elsewhere` |
//! | t | `outside` |

use wayfix_kernels::limits::power;

/// Lift of the numbers, 2^900. Lifted products keep their digits down to 1e-578, and bounds up to
/// 1e37 do not overflow.
pub(crate) const PRUNED_LIFT: f64 = power(900);
/// Upper bound on the loss of a lifted sum by underflow.
pub(crate) const LOST: f64 = 1e-290;
/// Probability up to which states are dropped in any case.
pub(crate) const LEAST_KEPT: f64 = 1e-290;
/// Factor on a bound that covers a dozen roundings.
pub(crate) const ROUNDED_UP: f64 = 1.0 + 12.0 * f64::EPSILON;
/// Factor by which a dropped upper bound may exceed the threshold of estimates. Without it, a state
/// that only the sensor names would be followed, with all states that it leads to.
const IDLE: f64 = 256.0;

/// Estimate of the belief, with bounds on the exact belief α times an unknown factor s, the same
/// for all states. The bounds also hold for the estimate times another such factor:
///
/// ```text
/// lower(i) ≤ s α(i) ≤ lower(i) + excess(i)     for the active states
///            s α(i) ≤ elsewhere                for every other state,
///          Σ s α(i) ≤ outside                  over all of these
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Envelope {
    /// Active states, in ascending order.
    pub(crate) states: Vec<usize>,
    /// Estimates of the active states; they sum to one.
    pub(crate) estimate: Vec<f64>,
    /// Lower bounds of the active states; they sum to one, unless nothing is known.
    pub(crate) lower: Vec<f64>,
    pub(crate) excess: Vec<f64>,
    pub(crate) others: Others,
}

/// Upper bounds on the inactive states: on each (`elsewhere`), and on their sum (`outside`).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Others {
    pub(crate) elsewhere: f64,
    pub(crate) outside: f64,
}

/// Sums of a step before they are scaled.
pub(crate) struct Raw {
    /// Σ of the estimates, lifted.
    pub(crate) estimate: f64,
    /// Σ of the lower bounds, lifted.
    pub(crate) lower: f64,
    /// Σ of all excess, including that of the inactive states.
    pub(crate) excess: f64,
    /// Largest number of terms of a sum.
    pub(crate) terms: usize,
}

impl Envelope {
    /// Copies another envelope into existing memory.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.states.clone_from(&other.states);
        self.estimate.clone_from(&other.estimate);
        self.lower.clone_from(&other.lower);
        self.excess.clone_from(&other.excess);
        self.others = other.others;
    }

    /// Starts from an exact belief, with nothing pruned.
    pub(crate) fn start(&mut self, belief: &[f64]) {
        self.clear();
        for (state, &p) in belief.iter().enumerate().filter(|entry| *entry.1 > 0.0) {
            self.push(state, p, p, 0.0);
        }
        self.others = Others::default();
    }

    pub(crate) fn clear(&mut self) {
        self.states.clear();
        self.estimate.clear();
        self.lower.clear();
        self.excess.clear();
    }

    pub(crate) fn push(&mut self, state: usize, estimate: f64, lower: f64, excess: f64) {
        self.states.push(state);
        self.estimate.push(estimate);
        self.lower.push(lower);
        self.excess.push(excess);
    }

    pub(crate) fn truncate(&mut self, kept: usize) {
        self.states.truncate(kept);
        self.estimate.truncate(kept);
        self.lower.truncate(kept);
        self.excess.truncate(kept);
    }

    /// Returns true if inactive states may have some probability.
    pub(crate) fn is_open(&self) -> bool {
        self.others.outside > 0.0
    }

    /// Returns true if there is a lower bound above 0.
    pub(crate) fn is_known(&self) -> bool {
        self.lower.iter().any(|p| *p > 0.0)
    }

    /// Scales the results of a step, counts their rounding, and drops small states and all but the
    /// `limit` largest. `ranked` is scratch memory. Returns the logarithm of the divisor of the
    /// lower bounds.
    pub(crate) fn settle(
        &mut self,
        raw: &Raw,
        threshold: f64,
        limit: usize,
        ranked: &mut Vec<f64>,
    ) -> f64 {
        // Fewer than m + 8 roundings of EPSILON / 2 each make a relative error r, by which computed
        // lower bounds may be too high. Lowering all by one factor is free, since s absorbs it, but
        // each excess grows by 2 r; making the bounds hold for the estimate too takes another 2 r.
        // Together 4 r.
        let rounding = 2.0 * (raw.terms + 8) as f64 * f64::EPSILON;
        // If all lower bounds are 0, scaling by the estimate at least keeps the numbers in range.
        let scale = if raw.lower > 0.0 { raw.lower } else { raw.estimate };
        if self.is_open() {
            self.others.elsewhere = self.others.elsewhere / scale * (1.0 + rounding) + LOST;
            self.others.outside = self.others.outside / scale * (1.0 + rounding) + LOST;
        }
        for at in 0..self.states.len() {
            let lower = self.lower[at] / scale;
            let excess = self.excess[at] / scale;
            let estimate = self.estimate[at] / raw.estimate;
            // A subnormal lower bound becomes 0 and is added to the excess instead.
            let normal = estimate >= f64::MIN_POSITIVE && lower >= f64::MIN_POSITIVE;
            let lost = f64::MIN_POSITIVE + if normal { 0.0 } else { lower };
            self.estimate[at] = estimate;
            self.lower[at] = if normal { lower } else { 0.0 };
            self.excess[at] = (excess + rounding * lower + lost) * (1.0 + rounding);
        }
        // Relative to K + D: dropping a small part of a large total excess hardly changes the
        // bound.
        let relevant = IDLE * threshold * (1.0 + raw.excess / scale);
        // A state is kept if its estimate matters, or if its excess would raise the bound on all
        // inactive states.
        self.retain(|estimate, excess| estimate > threshold || excess > relevant);
        if self.states.len() > limit {
            // Keeps all above the value at rank `limit`, and as many equal to it as there is room
            // for, the lowest states first.
            ranked.clear();
            ranked.extend_from_slice(&self.estimate);
            let (_, &mut cut, _) = ranked.select_nth_unstable_by(limit, |a, b| b.total_cmp(a));
            let above = self.estimate.iter().filter(|p| **p > cut).count();
            let mut ties = limit - above;
            self.retain(|estimate, _| {
                let tie = estimate == cut && ties > 0;
                ties -= usize::from(tie);
                estimate > cut || tie
            });
        }
        // One logarithm of the unlifted scale, if that is a normal number, rounds less than a
        // difference of two.
        let unlifted = scale / PRUNED_LIFT;
        let log = if unlifted.is_normal() { unlifted.ln() } else { scale.ln() - PRUNED_LIFT.ln() };
        log + self.close()
    }

    /// Keeps the states for which `keep(estimate, excess)` is true, and counts the others as
    /// inactive: δ becomes at least their upper bounds, and t grows by these.
    fn retain(&mut self, mut keep: impl FnMut(f64, f64) -> bool) {
        let mut kept = 0;
        for at in 0..self.states.len() {
            let (lower, excess) = (self.lower[at], self.excess[at]);
            if keep(self.estimate[at], excess) {
                self.states[kept] = self.states[at];
                self.estimate[kept] = self.estimate[at];
                (self.lower[kept], self.excess[kept]) = (lower, excess);
                kept += 1;
            } else {
                let most = (lower + excess).max(LOST);
                self.others.elsewhere = self.others.elsewhere.max(most);
                self.others.outside += most;
            }
        }
        self.truncate(kept);
    }

    /// Normalises estimates and lower bounds after states were dropped. Returns the logarithm of
    /// the sum of the lower bounds.
    pub(crate) fn close(&mut self) -> f64 {
        let sum: f64 = self.estimate.iter().sum();
        self.estimate.iter_mut().for_each(|p| *p /= sum);
        self.normalize()
    }

    /// Scales all bounds so that the lower bounds sum to one. Returns the logarithm of their former
    /// sum.
    fn normalize(&mut self) -> f64 {
        // `outside` was summed over at most the states in question: a sum of m non-negative numbers
        // has a relative error of at most m roundings. None of the inactive states has more than
        // their sum.
        let up = 1.0 + (self.states.len() + 4) as f64 * f64::EPSILON;
        self.others.outside *= up;
        self.others.elsewhere = self.others.elsewhere.min(self.others.outside);
        let sum: f64 = self.lower.iter().sum();
        if sum == 0.0 {
            return 0.0;
        }
        self.lower.iter_mut().for_each(|p| *p /= sum);
        self.excess.iter_mut().for_each(|p| *p /= sum);
        (self.others.elsewhere, self.others.outside) =
            (self.others.elsewhere / sum, self.others.outside / sum);
        sum.ln()
    }

    /// Removes uncertainty about the scale ("Forgetting" in the formulas): if most of the belief is
    /// in one state, s is chosen anew so that this state is known exactly. Returns the logarithms
    /// of the divisor of the lower bounds, and of an upper bound on the additional divisor of s.
    pub(crate) fn rebase(&mut self) -> (f64, f64) {
        let mut mode = 0;
        let mut rest = 0.0;
        for (at, &lower) in self.lower.iter().enumerate() {
            rest += lower;
            if lower > self.lower[mode] {
                mode = at;
            }
        }
        let known = self.lower[mode];
        let ratio = self.excess[mode] / known;
        rest -= known;
        // The deficit D changes by (1 − κ) ρ / (1 + ρ) − κ ρ, with κ = `known` of a total of one
        // and ρ = `ratio`: rebase only if it falls. (False for a NaN or infinite ratio.)
        if !(ratio.is_finite() && rest / (1.0 + ratio) < known) {
            return (0.0, 0.0);
        }
        // s is divided by a number from 1 to 1 + ρ, so that s α of the mode equals its lower bound.
        // The other upper bounds stay valid, and the other lower bounds shrink by 1 + ρ; `factor`
        // is rounded down. A lower bound that becomes subnormal is set to 0.
        let factor = (1.0 - 4.0 * f64::EPSILON) / (1.0 + ratio);
        for (lower, excess) in self.lower.iter_mut().zip(&mut self.excess) {
            let reduced = *lower * factor;
            let reduced = if reduced < f64::MIN_POSITIVE { 0.0 } else { reduced };
            *excess = (*excess + (*lower - reduced)) * (1.0 + 4.0 * f64::EPSILON);
            *lower = reduced;
        }
        (self.lower[mode], self.excess[mode]) = (known, 0.0);
        (self.normalize(), ratio.ln_1p())
    }

    /// Returns D, an upper bound on the mass that the lower bounds miss, relative to their sum.
    pub(crate) fn deficit(&self) -> f64 {
        let up = 1.0 + (self.states.len() + 4) as f64 * f64::EPSILON;
        (self.excess.iter().sum::<f64>() + self.others.outside) * up
    }

    /// Returns an upper bound on the total variation between the estimate and the exact belief.
    pub(crate) fn bound(&self) -> f64 {
        let sum: f64 = self.lower.iter().sum();
        let deficit = self.deficit();
        // Nothing is known: one is the largest total variation there is.
        if sum == 0.0 || !deficit.is_finite() {
            return 1.0;
        }
        // D / (K + D) with K = 1.
        let rounding = (self.states.len() + 8) as f64 * f64::EPSILON;
        (deficit / (1.0 + deficit) + rounding).min(1.0)
    }
}
