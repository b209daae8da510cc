//! State of a pruned filter, as plain data.

use std::mem;
use std::ops::Deref;

use super::envelope::Envelope;
use super::step::{LARGEST_SHARE, LEAST_SHARE};
use super::{Certificate, PrunedFilter, Pruning};
use crate::belief::SUM_TOLERANCE;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::{LogSum, MOST_STEPS};
use crate::likelihood::LocalLikelihood;
use crate::transition::TransitionEntries;

/// State of a pruned filter after k steps, with its certificate and its limits: plain data, to be
/// kept, compared, sent elsewhere and restored. Memory: 32 bytes for each active state.
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
    pub(crate) log: LogSum,
    pub(crate) log_excess: LogSum,
    pub(crate) log_lost: bool,
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

    /// Checks that all numbers can be those of a filter; they may be damaged.
    pub(crate) fn checked(self) -> Result<Self, String> {
        let Self { states, steps, belief, bound, share, .. } = &self;
        if *steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        if !belief.states.is_sorted_by(|a, b| a < b)
            || belief.states.last().is_none_or(|last| last >= states)
        {
            return Err(format!("the active states are not below {states} in ascending order"));
        }
        let values = [&belief.estimate, &belief.lower, &belief.excess];
        let others = [belief.elsewhere, belief.outside];
        for value in values.into_iter().flatten().chain(&others) {
            if value.is_nan() || *value < 0.0 {
                return Err(format!("{value} is in the belief, expected at least 0"));
            }
        }
        let sum: f64 = belief.estimate.iter().sum();
        if values.iter().any(|values| values.len() != belief.states.len()) {
            return Err(format!(
                "{}, {} and {} numbers of {} active states",
                belief.estimate.len(),
                belief.lower.len(),
                belief.excess.len(),
                belief.states.len()
            ));
        }
        if (sum - 1.0).abs() > SUM_TOLERANCE {
            return Err(format!("the probabilities sum to {sum}, expected 1"));
        }
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
        let LogSum { sum, lost } = self.log;
        if !self.log.is_finite() {
            return Err(format!(
                "the log-likelihood is the sum of {sum} and {lost}, expected finite values"
            ));
        }
        let LogSum { sum, lost } = self.log_excess;
        if !(lost.is_finite() && self.log_excess.value() >= 0.0) {
            return Err(format!(
                "the log-likelihood may be {sum} and {lost} more, expected at least 0"
            ));
        }
        Ok(self)
    }
}

impl<M, A, B> PrunedFilter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: LocalLikelihood,
{
    /// Returns a copy of the filter's state. A filter that is [restored](Self::restore) from it
    /// continues with identical bits. O(active states).
    #[must_use]
    pub fn snapshot(&self) -> PrunedFilterSnapshot {
        PrunedFilterSnapshot {
            states: self.model.states(),
            steps: self.steps,
            pruning: self.pruning,
            belief: self.belief.clone(),
            bound: self.bound,
            log: self.log.known(),
            log_excess: self.log_excess.known(),
            log_lost: self.log_lost,
            share: self.share,
        }
    }

    /// Restores a snapshot, of this filter or another, and takes over its limits on the pruning.
    /// Allocates nothing, unless the active states are more than ever before. O(active states).
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if it has another number of states.
    pub fn restore(&mut self, snapshot: &PrunedFilterSnapshot) -> Result<(), InferenceError> {
        let (found, expected) = (snapshot.states, self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "snapshot", found, expected });
        }
        self.next.copy_from(&snapshot.belief);
        self.active_set.follow(&self.belief.states, &self.next.states);
        mem::swap(&mut self.belief, &mut self.next);
        (self.steps, self.pruning) = (snapshot.steps, snapshot.pruning);
        (self.bound, self.share) = (snapshot.bound, snapshot.share);
        (self.log, self.log_excess) = (snapshot.log, snapshot.log_excess);
        self.log_lost = snapshot.log_lost;
        Ok(())
    }
}
