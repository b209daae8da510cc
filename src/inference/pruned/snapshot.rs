//! State of a pruned filter as plain data, its limits on the pruning, and its certificate: the
//! bound D / (K + D) of section 13 of the [formulas](crate::guide::formulas), compared with the
//! tolerance.

use std::ops::RangeInclusive;

use super::envelope::{Envelope, LEAST_KEPT};
use crate::inference::step::state::LogSum;

/// Initial and largest share of the tolerance that a step may drop. It is this small because an
/// observation that contradicts the belief multiplies the dropped mass, and because a tenth of the
/// share needs hardly more states.
pub(crate) const LARGEST_SHARE: f64 = 1e-8;
/// Smallest share of the tolerance that a step may drop.
pub(crate) const LEAST_SHARE: f64 = 1e-30;
/// Share of the tolerance above which the bound makes steps drop less.
const NEAR: f64 = 1e-3;
/// Factors on the share from one step to the next: if the bound is above [`NEAR`], and otherwise.
const LESS: f64 = 0.1;
const MORE: f64 = 1.01;

/// Limits on the pruning of a [`PrunedFilter`](crate::PrunedFilter).
///
/// ```
/// use wayfix::inference::Pruning;
///
/// let pruning = Pruning::default().with_tolerance(1e-9);
/// assert_eq!(pruning.most_active, usize::MAX);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Pruning {
    /// Tolerated distance of the belief from the exact one, in total variation; 1e-6 by default.
    /// At 0 (or less, or NaN) only states below 1e-290 are dropped.
    pub tolerance: f64,
    /// Largest number of active states, unlimited by default. It bounds the time of a step, and
    /// takes precedence over the tolerance.
    pub most_active: usize,
}

impl Pruning {
    /// Sets the tolerated distance of the belief from the exact one.
    #[must_use]
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// Sets the largest number of active states.
    #[must_use]
    pub fn with_most_active(self, most_active: usize) -> Self {
        Self { most_active, ..self }
    }
}

impl Default for Pruning {
    fn default() -> Self {
        Self { tolerance: 1e-6, most_active: usize::MAX }
    }
}

/// Proven bound on the distance of a pruned belief from the exact one in total variation, with the
/// answer whether it is within the tolerance.
///
/// The total variation is the largest error in the probability of any event: half the sum of all
/// absolute differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Certificate {
    /// A bound that is at most the tolerance.
    Within(f64),
    /// A bound that is above the tolerance. The belief is still the best estimate, and the bound
    /// may recover.
    Exceeded(f64),
}

impl Certificate {
    pub(crate) fn of(bound: f64, pruning: Pruning) -> Self {
        // Every comparison with a NaN tolerance is false, so no bound is within it.
        if bound <= pruning.tolerance { Self::Within(bound) } else { Self::Exceeded(bound) }
    }

    /// Returns the bound, from 0 to 1.
    #[must_use]
    pub fn bound(self) -> f64 {
        let (Self::Within(bound) | Self::Exceeded(bound)) = self;
        bound
    }

    /// Returns true if the bound is at most the tolerance.
    #[must_use]
    pub fn holds(self) -> bool {
        matches!(self, Self::Within(_))
    }
}

/// State of a pruned filter after k steps, with its certificate and its limits: plain data that can
/// be kept, compared, sent elsewhere and restored. Memory: 32 bytes for each active state.
///
/// ```
/// # use wayfix::inference::Pruning;
/// # use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
/// # let hmm = Hmm::new(prior, SparseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
/// let mut filter = hmm.pruned_filter(Pruning::default());
/// filter.step(&0)?;
/// let snapshot = filter.snapshot();
/// let certificate = filter.step(&1)?;
///
/// let mut next = hmm.pruned_filter(Pruning::default());
/// next.restore(&snapshot)?;
/// assert_eq!(next.step(&1)?, certificate);
/// assert_eq!(next.snapshot(), filter.snapshot());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PrunedFilterSnapshot {
    /// Number of states of the model, n.
    pub(crate) states: usize,
    pub(crate) steps: usize,
    pub(crate) pruning: Pruning,
    pub(crate) belief: Envelope,
    pub(crate) bound: f64,
    /// Lower bound on ln p(y_1 … y_k). The upper bound is higher by `log_excess` and the deficit.
    pub(crate) log: LogSum,
    pub(crate) log_excess: LogSum,
    /// True if nothing is known about the likelihood any more.
    pub(crate) log_lost: bool,
    /// Share of the tolerance that a step may drop.
    pub(crate) share: f64,
}

impl PrunedFilterSnapshot {
    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Limits on the pruning.
    #[must_use]
    pub fn pruning(&self) -> Pruning {
        self.pruning
    }

    /// Certificate of the belief after these steps.
    #[must_use]
    pub fn certificate(&self) -> Certificate {
        Certificate::of(self.bound, self.pruning)
    }

    /// Active states, in ascending order.
    #[must_use]
    pub fn active(&self) -> &[usize] {
        &self.belief.states
    }

    /// Probabilities of the active states, in the same order; they sum to one.
    #[must_use]
    pub fn probabilities(&self) -> &[f64] {
        &self.belief.estimate
    }

    /// Most probable state; ties go to the lowest. O(active states).
    #[must_use]
    pub fn mode(&self) -> usize {
        // States are in ascending order, so the first of several is the lowest.
        let mut best = (0, f64::NEG_INFINITY);
        for (&state, &p) in self.belief.states.iter().zip(&self.belief.estimate) {
            if p > best.1 {
                best = (state, p);
            }
        }
        best.0
    }

    /// Interval that contains the log-likelihood ln p(y_1 … y_k) of the observations so far, up to
    /// rounding.
    #[must_use]
    pub fn log_likelihood(&self) -> RangeInclusive<f64> {
        // Once all lower bounds were 0, the scale is unknown at that step and all later ones.
        if self.log_lost {
            return f64::NEG_INFINITY..=f64::INFINITY;
        }
        // From K / s to (K + D) / s, with K = 1 and s known up to the product of the 1 + ρ (section
        // 13 of `guide::formulas`, "The likelihood").
        let low = self.log.value();
        low..=low + self.log_excess.value() + self.belief.deficit().ln_1p()
    }

    /// Creates the state before any step, whose belief is set next.
    pub(super) fn start(states: usize, pruning: Pruning) -> Self {
        let zero = LogSum::default();
        Self {
            states,
            steps: 0,
            pruning,
            belief: Envelope::default(),
            bound: 0.0,
            log: zero,
            log_excess: zero,
            log_lost: false,
            share: LARGEST_SHARE,
        }
    }

    /// Returns the probability up to which a step with this number of candidates drops states. It
    /// is below the mean of the candidates, so that the most probable one is kept.
    pub(super) fn threshold(&self, candidates: usize) -> f64 {
        let count = candidates as f64;
        let threshold = self.pruning.tolerance.max(0.0) * self.share / count;
        threshold.clamp(LEAST_KEPT, 0.5 / count)
    }

    /// Adapts the share: less if the bound is near the tolerance, slowly more if it is far below.
    pub(super) fn adapt(&mut self) {
        let used = self.bound / self.pruning.tolerance;
        // Down fast and up slowly: one observation that contradicts the belief may multiply the
        // mass that was dropped.
        let factor = if used > NEAR { LESS } else { MORE };
        self.share = (self.share * factor).clamp(LEAST_SHARE, LARGEST_SHARE);
    }
}

#[cfg(feature = "serde")]
use super::envelope::Others;
#[cfg(feature = "serde")]
use crate::belief::SUM_TOLERANCE;
#[cfg(feature = "serde")]
use crate::inference::step::state::MOST_STEPS;
#[cfg(feature = "serde")]
use crate::stored::{finite, or_infinite};

#[cfg(feature = "serde")]
impl PrunedFilterSnapshot {
    /// Checks that the numbers, which may be damaged, can be those of a filter.
    fn checked(self) -> Result<Self, String> {
        let Self { states, steps, belief, bound, share, .. } = &self;
        if *steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        if !belief.states.is_sorted_by(|a, b| a < b)
            || belief.states.last().is_none_or(|last| last >= states)
        {
            return Err(format!("the active states are not below {states} in ascending order"));
        }
        // Non-negative; ∞ is valid in an upper bound. (Lengths and sums are checked below.)
        let values = [&belief.estimate, &belief.lower, &belief.excess];
        let others = [belief.others.each_inactive, belief.others.all_inactive];
        for value in values.into_iter().flatten().chain(&others) {
            if value.is_nan() || *value < 0.0 {
                return Err(format!("a number of the belief is {value}, expected at least 0"));
            }
        }
        let sum: f64 = belief.estimate.iter().sum();
        if values.iter().any(|values| values.len() != belief.states.len()) {
            return Err(format!(
                "{}, {} and {} numbers for {} active states",
                belief.estimate.len(),
                belief.lower.len(),
                belief.excess.len(),
                belief.states.len()
            ));
        }
        if (sum - 1.0).abs() > SUM_TOLERANCE {
            return Err(format!("the probabilities sum to {sum}, expected 1"));
        }
        // All 0 means that nothing is known, which is a valid state of a filter.
        let lower: f64 = belief.lower.iter().sum();
        if lower != 0.0 && (lower - 1.0).abs() > SUM_TOLERANCE {
            return Err(format!("the lower bounds sum to {lower}, expected 1 or 0"));
        }
        if !(0.0..=1.0).contains(bound) {
            return Err(format!("the bound is {bound}, expected a value from 0 to 1"));
        }
        if !(LEAST_SHARE..=LARGEST_SHARE).contains(share) {
            return Err(format!(
                "a step may drop {share} of the tolerance, expected {LEAST_SHARE} to {LARGEST_SHARE}"
            ));
        }
        let LogSum { sum, compensation } = self.log;
        if !self.log.is_finite() {
            return Err(format!(
                "the log-likelihood is the sum of {sum} and {compensation}, expected finite values"
            ));
        }
        // The excess may have become infinite, but never negative.
        let LogSum { sum, compensation } = self.log_excess;
        if !(compensation.is_finite() && self.log_excess.value() >= 0.0) {
            return Err(format!(
                "the log-likelihood may be {sum} and {compensation} more, expected at least 0"
            ));
        }
        Ok(self)
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [] PrunedFilterSnapshot: [], |state| {
        states: usize = state.states,
        steps: usize = state.steps,
        tolerance: Option<f64> = match state.pruning.tolerance {
            // JSON has neither NaN nor infinity: a finite number that means the same stands for
            // them. NaN and −∞ mean the same as any value below 0.
            tolerance if tolerance < f64::INFINITY => Some(tolerance.max(f64::MIN)),
            tolerance => Some(-1.0).filter(|_| tolerance.is_nan()),
        },
        // No limit is written as null, which means the same on a machine with another `usize`.
        most_active: Option<usize> = Some(state.pruning.most_active).filter(|most| *most < usize::MAX),
        active: Vec<usize> = state.belief.states,
        estimate: Vec<f64> = state.belief.estimate,
        lower: Vec<f64> = state.belief.lower,
        excess: Vec<Option<f64>> =
            state.belief.excess.iter().copied().map(finite).collect::<Vec<_>>(),
        others: [Option<f64>; 2] =
            [state.belief.others.each_inactive, state.belief.others.all_inactive].map(finite),
        bound: f64 = state.bound,
        log_likelihood: [f64; 2] = [state.log.sum, state.log.compensation],
        log_excess: [Option<f64>; 2] =
            [state.log_excess.sum, state.log_excess.compensation].map(finite),
        log_lost: bool = state.log_lost,
        share: f64 = state.share,
    } => {
        let log_sum = |[sum, compensation]: [f64; 2]| LogSum { sum, compensation };
        let [each_inactive, all_inactive] = others.map(or_infinite);
        let belief = Envelope {
            states: active,
            estimate,
            lower,
            excess: excess.into_iter().map(or_infinite).collect(),
            others: Others { each_inactive, all_inactive },
        };
        let pruning = Pruning {
            tolerance: or_infinite(tolerance),
            most_active: most_active.unwrap_or(usize::MAX),
        };
        let state = self::PrunedFilterSnapshot {
            states,
            steps,
            pruning,
            belief,
            bound,
            log: log_sum(log_likelihood),
            log_excess: log_sum(log_excess.map(or_infinite)),
            log_lost,
            share,
        };
        state.checked()
    };
}
