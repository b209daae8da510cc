//! Proven bounds on the exact belief: the limits ℓ, c, δ and t of section 13 of the
//! [formulas](crate::guide::formulas), through prediction, update, scaling and dropping, and the
//! bound that follows.
//!
//! | formulas | here |
//! |---|---|
//! | ℓ(i) | `lower` |
//! | c(i) | `excess` |
//! | δ | `each_inactive` |
//! | t | `all_inactive` |
//!
//! The invariant is that of [`Envelope`]: after each part of a step, the exact belief times s is
//! within the bounds. Lower bounds are rounded down or set to 0, upper bounds are rounded up, and
//! each number that may have lost digits to underflow adds [`UNDERFLOW_LOSS`] to its excess.

use super::active_set::ActiveSet;
use super::operator::StepOperator;
use crate::likelihood::Diagonal;
use crate::transition::TransitionEntries;
use wayfix_kernels::limits::power;

/// Lift of the numbers, 2^900. Lifted products keep their digits down to 1e-578, and bounds up to
/// 1e37 do not overflow.
pub(crate) const PRUNED_LIFT: f64 = power(900);
/// Upper bound on the loss of a lifted sum by underflow.
pub(crate) const UNDERFLOW_LOSS: f64 = 1e-290;
/// Probability up to which states are dropped in any case.
pub(crate) const LEAST_KEPT: f64 = 1e-290;
/// Factor on a bound that covers a dozen roundings.
pub(crate) const ROUNDED_UP: f64 = 1.0 + 12.0 * f64::EPSILON;
/// Factor by which a dropped upper bound may exceed the threshold of estimates. Without it, a state
/// that only the sensor names would be followed, with all states that it leads to.
const EXCESS_FACTOR: f64 = 256.0;

/// Estimate of the belief, with bounds on the exact belief α times an unknown factor s, the same
/// for all states. The bounds also hold for the estimate times another such factor:
///
/// ```text
/// lower(i) ≤ s α(i) ≤ lower(i) + excess(i)     for the active states
///            s α(i) ≤ each_inactive            for every other state,
///          Σ s α(i) ≤ all_inactive             over all of these
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

/// Upper bounds on the inactive states: on each (`each_inactive`), and on their sum
/// (`all_inactive`).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Others {
    pub(crate) each_inactive: f64,
    pub(crate) all_inactive: f64,
}

/// Sums of a step before they are scaled.
pub(crate) struct UnscaledSums {
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
        self.others.all_inactive > 0.0
    }

    /// Returns true if there is a lower bound above 0.
    pub(crate) fn is_known(&self) -> bool {
        self.lower.iter().any(|p| *p > 0.0)
    }

    /// Scales the results of a step, counts their rounding, and drops small states and all but the
    /// `limit` largest. `ranked` is scratch memory. Returns the logarithm of the divisor of the
    /// lower bounds.
    pub(crate) fn scale_and_drop(
        &mut self,
        sums: &UnscaledSums,
        threshold: f64,
        limit: usize,
        ranked: &mut Vec<f64>,
    ) -> f64 {
        // Fewer than `terms` + 8 roundings of EPSILON / 2 each make a relative error r, by which
        // computed lower bounds may be too high. Lowering all by one factor is free, since s
        // absorbs it, but each excess grows by 2 r; making the bounds hold for the estimate too
        // takes another 2 r. Together 4 r.
        let rounding = 2.0 * (sums.terms + 8) as f64 * f64::EPSILON;
        // If all lower bounds are 0, scaling by the estimate at least keeps the numbers in range.
        let scale = if sums.lower > 0.0 { sums.lower } else { sums.estimate };
        if self.is_open() {
            self.others.each_inactive =
                self.others.each_inactive / scale * (1.0 + rounding) + UNDERFLOW_LOSS;
            self.others.all_inactive =
                self.others.all_inactive / scale * (1.0 + rounding) + UNDERFLOW_LOSS;
        }
        for at in 0..self.states.len() {
            let lower = self.lower[at] / scale;
            let excess = self.excess[at] / scale;
            let estimate = self.estimate[at] / sums.estimate;
            // A subnormal lower bound becomes 0 and is added to the excess instead.
            let normal = estimate >= f64::MIN_POSITIVE && lower >= f64::MIN_POSITIVE;
            let lost = f64::MIN_POSITIVE + if normal { 0.0 } else { lower };
            self.estimate[at] = estimate;
            self.lower[at] = if normal { lower } else { 0.0 };
            self.excess[at] = (excess + rounding * lower + lost) * (1.0 + rounding);
        }
        // Relative to the sum of all bounds (K + D): dropping a small part of a large total excess
        // hardly changes the bound of section 13.
        let relevant = EXCESS_FACTOR * threshold * (1.0 + sums.excess / scale);
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
        log + self.renormalize()
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
                let most = (lower + excess).max(UNDERFLOW_LOSS);
                self.others.each_inactive = self.others.each_inactive.max(most);
                // Rounded up, so that the sum is a bound however many states are dropped.
                self.others.all_inactive = (self.others.all_inactive + most).next_up();
            }
        }
        self.truncate(kept);
    }

    /// Normalises estimates and lower bounds after states were dropped. Returns the logarithm of
    /// the sum of the lower bounds.
    pub(crate) fn renormalize(&mut self) -> f64 {
        let sum: f64 = self.estimate.iter().sum();
        self.estimate.iter_mut().for_each(|p| *p /= sum);
        self.normalize()
    }

    /// Scales all bounds so that the lower bounds sum to one. Returns the logarithm of their former
    /// sum.
    fn normalize(&mut self) -> f64 {
        // A sum of m non-negative numbers has a relative error of at most m roundings, so the sum of
        // the lower bounds below may be too large by a rounding for each kept state; all is divided
        // by it. No inactive state has more than the sum over all of them.
        let up = 1.0 + (self.states.len() + 4) as f64 * f64::EPSILON;
        self.others.all_inactive *= up;
        self.others.each_inactive = self.others.each_inactive.min(self.others.all_inactive);
        let sum: f64 = self.lower.iter().sum();
        if sum == 0.0 {
            return 0.0;
        }
        self.lower.iter_mut().for_each(|p| *p /= sum);
        self.excess.iter_mut().for_each(|p| *p /= sum);
        (self.others.each_inactive, self.others.all_inactive) =
            (self.others.each_inactive / sum, self.others.all_inactive / sum);
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
        // s is divided by a number from 1 to 1 + ρ such that s α of the mode equals its lower
        // bound. The other upper bounds stay valid, and the other lower bounds shrink by 1 + ρ;
        // `factor` is rounded down. A lower bound that becomes subnormal is set to 0.
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
        (self.excess.iter().sum::<f64>() + self.others.all_inactive) * up
    }

    /// Returns an upper bound on the total variation between the estimate and the exact belief.
    pub(crate) fn bound(&self) -> f64 {
        let sum: f64 = self.lower.iter().sum();
        let deficit = self.deficit();
        // Nothing is known: one is the largest possible total variation.
        if sum == 0.0 || !deficit.is_finite() {
            return 1.0;
        }
        // D / (K + D) of section 13 of `guide::formulas`, with the deficit D. The sum K of the
        // lower bounds is 1 up to a rounding for each state, which `rounding` covers with a few to
        // spare.
        let rounding = (self.states.len() + 8) as f64 * f64::EPSILON;
        (deficit / (1.0 + deficit) + rounding).min(1.0)
    }
}

/// Lifted number below which digits may be lost, so that [`UNDERFLOW_LOSS`] is counted.
const SMALL: f64 = 1e-270;

/// Sums of a prediction.
pub(crate) struct Predicted {
    /// Σ of the predicted estimates.
    pub(crate) sum: f64,
    /// Largest number of terms of a sum.
    terms: usize,
}

/// Sums over the entries into a state, lifted except for `inactive_entries`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    pub(crate) estimate: f64,
    pub(crate) lower: f64,
    pub(crate) excess: f64,
    /// Sum of the entries out of inactive states.
    pub(crate) inactive_entries: f64,
    /// Upper bound on the number of entries.
    pub(crate) terms: usize,
}

impl Envelope {
    /// Predicts all candidates from `before`. The results are lifted.
    pub(crate) fn predict<A: TransitionEntries>(
        &mut self,
        before: &Self,
        operator: Option<&StepOperator<'_, A>>,
        active_set: &ActiveSet,
    ) -> Predicted {
        self.predict_by(before, operator, active_set, |i| before.sums(i, operator, active_set))
    }

    /// Predicts all candidates, with sums computed by `sums`.
    pub(crate) fn predict_by<A: TransitionEntries>(
        &mut self,
        before: &Self,
        operator: Option<&StepOperator<'_, A>>,
        active_set: &ActiveSet,
        mut sums: impl FnMut(usize) -> Sums,
    ) -> Predicted {
        self.clear();
        let mut predicted = Predicted { sum: 0.0, terms: 1 };
        // Section 13 of `guide::formulas`, "A step": δ' = min(R δ, m t) for each state that only
        // inactive states lead to, and t' for all of them together. δ and t are lifted before the
        // product, since evidence may make bounds on entries tiny: whatever still underflows is
        // below the 1e-290 that is added.
        let (each_inactive, all_inactive) =
            (before.others.each_inactive * PRUNED_LIFT, before.others.all_inactive * PRUNED_LIFT);
        let (one, all) = match operator {
            Some(StepOperator { bounds, .. }) => {
                let by_row = times(bounds.row, each_inactive);
                (by_row.min(times(bounds.entry, all_inactive)), times(bounds.column, all_inactive))
            }
            None => (each_inactive, all_inactive),
        };
        let round_up =
            |x: f64| if before.is_open() { x * ROUNDED_UP + UNDERFLOW_LOSS } else { 0.0 };
        (self.others.each_inactive, self.others.all_inactive) = (round_up(one), round_up(all));
        for &i in active_set.candidates() {
            // Only the sensor names this candidate: no active state leads to it. So it has no
            // estimate, and the upper bound of any inactive state.
            if !active_set.is_reached(i) {
                self.push(i, 0.0, 0.0, self.others.each_inactive);
                continue;
            }
            let Sums { estimate, lower, mut excess, inactive_entries, terms } = sums(i);
            predicted.terms = predicted.terms.max(terms);
            predicted.sum += estimate / PRUNED_LIFT;
            // δ Σ_{j not in S} A[i, j]: no inactive state has more than `each_inactive`.
            excess += times(inactive_entries, each_inactive);
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
        operator: Option<&StepOperator<'_, A>>,
        active_set: &ActiveSet,
    ) -> Sums {
        let (mut estimate, mut lower, mut excess) = (0.0, 0.0, 0.0);
        let (mut inactive_entries, mut terms) = (0.0, 0);
        let mut add = |j: usize, a: f64, relative_error: f64| {
            terms += 1;
            if let Some(at) = active_set.position(j) {
                estimate += a * (self.estimate[at] * PRUNED_LIFT);
                // The entry lies between a (1 − relative_error) and a (1 + relative_error): the
                // lower bound takes the former, and the excess below covers the difference to the
                // latter, 2 relative_error a.
                let least = self.lower[at] * PRUNED_LIFT;
                lower += a * (1.0 - relative_error) * least;
                excess += a * (1.0 + relative_error) * (self.excess[at] * PRUNED_LIFT);
                if relative_error > 0.0 {
                    // An entry below the range of `f64` was passed as 0, with this error.
                    let tiny = 2.0 * f64::MIN_POSITIVE;
                    excess += 2.0 * relative_error * (a * least) * ROUNDED_UP;
                    excess += tiny * (least + self.excess[at] * PRUNED_LIFT);
                }
            } else {
                let most = if relative_error > 0.0 { 2.0 * f64::MIN_POSITIVE } else { 0.0 };
                inactive_entries += a * (1.0 + relative_error) + most;
            }
        };
        match operator {
            Some(operator) => operator.incoming(i, add),
            None => add(i, 1.0, 0.0),
        }
        Sums { estimate, lower, excess, inactive_entries, terms }
    }

    /// Multiplies the candidates by their likelihoods, and drops those that the sensor rules out.
    pub(crate) fn weigh(
        &mut self,
        Predicted { terms, .. }: Predicted,
        likelihoods: &[f64],
        scale: &LikelihoodScale,
    ) -> UnscaledSums {
        let mut sums = UnscaledSums { estimate: 0.0, lower: 0.0, excess: 0.0, terms };
        let candidates = self.states.len();
        // Compacted in place: `kept` never passes `at`.
        let mut kept = 0;
        for (at, &b) in (0..candidates).zip(likelihoods) {
            let ScaledLikelihood { value, least, most } = scale.of(b);
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
            sums.estimate += estimate;
            sums.lower += lower;
            sums.excess += excess;
            kept += 1;
        }
        self.truncate(kept);
        let open = self.is_open() && scale.others > 0.0;
        let weigh =
            |x| if open { times(scale.others, x) * ROUNDED_UP + UNDERFLOW_LOSS } else { 0.0 };
        (self.others.each_inactive, self.others.all_inactive) =
            (weigh(self.others.each_inactive), weigh(self.others.all_inactive));
        sums.excess += self.others.all_inactive;
        sums
    }
}

/// Returns a lower bound and an excess that cover the digits that these two and the estimate may
/// have lost to underflow. A lower bound that may have lost digits becomes 0.
#[inline]
fn count_lost(estimate: f64, lower: f64, excess: f64) -> (f64, f64) {
    if estimate < SMALL || lower < SMALL {
        (0.0, excess + (lower + UNDERFLOW_LOSS))
    } else {
        (lower, excess)
    }
}

/// Returns the product of two non-negative numbers that may be infinite; 0 if either is 0.
#[inline]
fn times(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}

/// Power of two by which the likelihoods of states that the belief leads to may fall short of the
/// largest of all, so that the range of `f64` holds both.
const SPREAD: f64 = 500.0;
/// Range of factors that are not divided out.
const UNSCALED: std::ops::RangeInclusive<f64> = 1.0 / 65536.0..=65536.0;

/// Likelihood divided by a factor common to all states, with lower and upper bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ScaledLikelihood {
    pub(crate) value: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
}

/// Common divisor of the likelihoods of a step: near the largest of them or, if those of the states
/// that the belief leads to are far below that, within 2^500 of the largest of these.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LikelihoodScale {
    is_log: bool,
    /// Common factor, or its logarithm.
    factor: f64,
    /// Upper bound on the weight of any state that the sensor was not asked about.
    pub(crate) others: f64,
    pub(crate) log_factor: f64,
}

impl LikelihoodScale {
    /// Creates the scale from the likelihoods of some states, the bound on those of all others,
    /// the largest of all, and the largest among the states that the belief leads to (`likely`),
    /// all in one form.
    pub(crate) fn new(local: &Diagonal<'_>, others: f64, largest: f64, likely: f64) -> Self {
        let is_log = local.is_log();
        let (factor, log) = if is_log {
            let spread = SPREAD * std::f64::consts::LN_2;
            let factor = if likely.is_finite() { largest.min(likely + spread) } else { largest };
            let factor = if factor.is_finite() { factor } else { 0.0 };
            (factor, factor)
        } else {
            let most = if likely > 0.0 { likely * SPREAD.exp2() } else { f64::INFINITY };
            let factor = largest.min(most);
            // If the factor is near one, likelihoods are not divided, which would round them.
            let unscaled = UNSCALED.contains(&factor) || factor == 0.0;
            let factor = if unscaled { 1.0 } else { factor };
            (factor, factor.ln())
        };
        let log_factor = local.log_factor() + log;
        let scale = Self { is_log, factor, others: 0.0, log_factor };
        let others = scale.of(others).most * (1.0 + 4.0 * f64::EPSILON);
        Self { others, ..scale }
    }

    /// Returns the weight of a state whose likelihood, or its logarithm, is `b`.
    #[inline]
    pub(crate) fn of(&self, b: f64) -> ScaledLikelihood {
        let (value, relative_error) = if self.is_log {
            let log = b - self.factor;
            // The difference rounds relative to |log|, which becomes a relative error of the
            // exponential; exp adds its own.
            (log.exp(), (log.abs() + 4.0) * f64::EPSILON)
        } else {
            (if self.factor == 1.0 { b } else { b / self.factor }, 0.0)
        };
        // Only a likelihood of 0 excludes a state. A quotient that underflows or overflows is
        // known only to lie below 2^-1021, or above the largest double.
        if b == if self.is_log { f64::NEG_INFINITY } else { 0.0 } {
            ScaledLikelihood { value: 0.0, least: 0.0, most: 0.0 }
        } else if value < f64::MIN_POSITIVE {
            ScaledLikelihood { value: 0.0, least: 0.0, most: 2.0 * f64::MIN_POSITIVE }
        } else if value > f64::MAX {
            ScaledLikelihood { value: 0.0, least: 0.0, most: f64::INFINITY }
        } else {
            ScaledLikelihood {
                value,
                least: value * (1.0 - relative_error),
                most: value * (1.0 + relative_error),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_double_does_not_hold_lies_between_bounds() {
        let tiny = ScaledLikelihood { value: 0.0, least: 0.0, most: 2.0 * f64::MIN_POSITIVE };
        let nothing = ScaledLikelihood { value: 0.0, least: 0.0, most: 0.0 };
        let new = |local: Diagonal<'_>, others, largest, likely| {
            LikelihoodScale::new(&local, others, largest, likely)
        };
        let logs = new(Diagonal::log(&[]), -800.0, 0.0, 0.0);
        assert_eq!((logs.of(-800.0), logs.of(f64::NEG_INFINITY)), (tiny, nothing));
        assert!(logs.others >= f64::MIN_POSITIVE);
        let one = logs.of(0.0);
        assert!(one.value == 1.0 && one.least < 1.0 && one.most > 1.0 && one.most < 1.0 + 1e-15);
        let linear = new(Diagonal::linear(&[]), 1e-300, 1e300, 1e300);
        assert_eq!((linear.of(1e-300), linear.of(0.0)), (tiny, nothing));
        // The belief leads only to likelihoods far below the largest.
        let far = new(Diagonal::log(&[]), -3.0, 0.0, -1000.0);
        assert!(far.of(-1000.0).value > 1e-151 && far.others > 1e280);
        assert_eq!(new(Diagonal::log(&[]), 0.0, 0.0, -1e5).others, f64::INFINITY);
        let far = new(Diagonal::linear(&[]), 1e-3, 1e-3, 1e-300);
        assert!(far.of(1e-300).value > 1e-151);
    }
}
