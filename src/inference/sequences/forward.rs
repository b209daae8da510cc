//! Forward pass over a whole sequence (section 2 of the [formulas](crate::guide::formulas)), by the
//! steps of a filter, and so with its results to the bit.

use super::posteriors::Posteriors;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::engines::{choice, few_states};
use crate::inference::step::Step;
use crate::inference::step::forward_pass::ForwardPass;
use crate::inference::step::state::{FilterSnapshot, StepScratch};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Filtered distributions of a whole sequence, with the log-likelihood of each observation.
///
/// Made by [`Hmm::forward`].
#[derive(Debug, Clone, PartialEq)]
pub struct FilteredSequence {
    posteriors: Posteriors,
    log_likelihoods: Vec<f64>,
    log_likelihood: f64,
    steps_in_logs: usize,
}

impl FilteredSequence {
    /// Creates the result of a routine that takes no steps in logarithms.
    pub(crate) fn new(
        posteriors: Posteriors,
        log_likelihoods: Vec<f64>,
        log_likelihood: f64,
    ) -> Self {
        Self { posteriors, log_likelihoods, log_likelihood, steps_in_logs: 0 }
    }

    /// Filtered distributions p(X_k | y_1 … y_k) for k = 0 … T; the prior at 0.
    #[must_use]
    pub fn posteriors(&self) -> &Posteriors {
        &self.posteriors
    }

    /// Returns the distributions without the rest of the result.
    #[must_use]
    pub fn into_posteriors(self) -> Posteriors {
        self.posteriors
    }

    /// Log-likelihoods ln p(y_k | y_1 … y_{k-1}) at index k − 1, for k = 1 … T.
    #[must_use]
    pub fn log_likelihoods(&self) -> &[f64] {
        &self.log_likelihoods
    }

    /// Log-likelihood ln p(y_1 … y_T).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Number of steps taken in logarithms, as counted by
    /// [`FilterSnapshot::steps_in_logs`]. With up to eight states it may be lower than that of a
    /// filter: the faster algorithms for them need logarithms less often.
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.steps_in_logs
    }
}

/// # Whole sequences
impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Filters a whole sequence: the forward pass (paper eq. 10), scaled.
    ///
    /// Results equal those of a [filter](Self::filter) to the bit; for more than 64 steps with up
    /// to eight states and no control they are equal up to rounding, and computed many times
    /// faster. Costs one product with A and O(n) a step; the result holds n (T + 1) numbers.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
    /// let filtering = hmm.forward(&[0, 0, 1])?;
    /// assert_eq!(filtering.posteriors().modes(), [0, 0, 1]);
    /// assert!((filtering.log_likelihoods()[0] - 0.55_f64.ln()).abs() < 1e-15);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`InferenceError`] with the step at which an observation is impossible
    /// or has no valid likelihood, or a control is not valid.
    pub fn forward<S>(&self, sequence: &S) -> Result<FilteredSequence, InferenceError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        // The engine for few states returns `None` for anything out of the ordinary. Then the
        // steps below start over: they report every error, and can use logarithms.
        if choice::is_whole(self.states(), sequence.steps())
            && let Some((rows, logs, log_likelihood)) = few_states::filter(self, sequence)
        {
            let posteriors = Posteriors::from_values(self.states(), rows);
            return Ok(FilteredSequence::new(posteriors, logs, log_likelihood));
        }
        let mut log_likelihoods = Vec::with_capacity(sequence.steps());
        let (pass, last) = ForwardPass::over(self, sequence, 0, |log| log_likelihoods.push(log))?;
        let posteriors = Posteriors::from_values(self.states(), pass.rows.into_values());
        let (log_likelihood, steps_in_logs) = (last.log_likelihood(), last.steps_in_logs());
        Ok(FilteredSequence { posteriors, log_likelihoods, log_likelihood, steps_in_logs })
    }

    /// Returns ln p(y_1 … y_T), without storing anything for each step.
    ///
    /// Costs one product with A and O(n) a step, and O(n) memory. Equals the sum of the
    /// logarithms that a [filter](Self::filter) returns; with up to eight states and no control it
    /// is equal up to rounding, and computed several times faster.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let hmm = |stay: f64| -> Result<_, Box<dyn std::error::Error>> {
    /// #     let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// #     let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// #     let a = DenseTransition::from_rows(&[[stay, 1.0 - stay], [1.0 - stay, stay]])?;
    /// #     Ok(Hmm::new(prior, a, table)?)
    /// # };
    /// # let (slow, fast) = (hmm(0.9)?, hmm(0.5)?);
    /// // Which of two models explains the sightings better, and by how much?
    /// let seen = [0, 0, 0, 0, 1, 1, 1, 1];
    /// let log_odds = slow.log_likelihood(&seen)? - fast.log_likelihood(&seen)?;
    /// assert!(log_odds > 0.0); // the slow one
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`forward`](Self::forward).
    pub fn log_likelihood<S>(&self, sequence: &S) -> Result<f64, InferenceError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        if choice::is_whole(self.states(), sequence.steps())
            && let Some(log_likelihood) = few_states::log_likelihood(self, sequence)
        {
            return Ok(log_likelihood);
        }
        // The same steps without rows: the state sums the logarithms in the same order.
        let prior = self.prior().belief().as_slice();
        let (mut state, mut scratch) = (FilterSnapshot::start(prior), StepScratch::new(prior));
        for number in 1..=sequence.steps() {
            let step = Step::of(self, sequence, number);
            state.advance(&step, sequence.observation(number), &mut scratch)?;
        }
        Ok(state.log_likelihood())
    }
}
