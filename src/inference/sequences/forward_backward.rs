//! Filter and smoother of a whole sequence (sections 2 and 3 of the
//! [formulas](crate::guide::formulas)), and their distributions in one block of rows.
//!
//! The forward pass takes the steps of a filter, and so has its results to the bit. The backward
//! pass goes over the same block: γ of each step overwrites α of the next. At T both are the same.

use std::fmt;
use std::ops::{Deref, Range};
use std::sync::Arc;

use crate::belief::{Belief, BeliefView};
use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::engines::{choice, few_states, lanes};
use crate::inference::step::Step;
use crate::inference::step::forward_backward::{Backward, ForwardPass};
use crate::inference::step::state::{FilterSnapshot, StepScratch};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::Aligned;

/// Distributions over n states for the steps k = 0 … T, in one block of
/// n (T + 1) numbers.
///
/// Step 0 is the state before the first transition, X_0. Under
/// [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) no transition precedes the first
/// observation, so that X_0 is the same state as X_1.
///
/// ```
/// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
/// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, LikelihoodVector::linear(2))?;
/// let smoothing = hmm.smooth(&[[0.9, 0.2], [0.9, 0.2]])?;
/// let posteriors = smoothing.posteriors();
/// assert_eq!(posteriors.steps(), 2);
/// assert!((posteriors.get(2).unwrap().as_slice()[0] - 0.883_357_041_251_778).abs() < 1e-12);
/// assert_eq!(posteriors.modes(), [0, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Posteriors {
    states: usize,
    values: Values,
}

/// Storage of the numbers.
enum Values {
    // Results of many sequences are written to one shared block: copying its parts would take as
    // long as the smoother itself.
    Own { values: Vec<f64>, start: usize },
    Shared(SharedRows),
}

/// Rows of one sequence, in a block shared with others.
pub(crate) struct SharedRows {
    pub(crate) states: usize,
    pub(crate) block: Arc<Aligned>,
    pub(crate) range: Range<usize>,
}

impl Deref for SharedRows {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.block[self.range.clone()]
    }
}

impl Posteriors {
    /// Creates the posteriors from a row for each step from 0.
    pub(crate) fn from_values(states: usize, values: Vec<f64>) -> Self {
        Self { states, values: Values::Own { values, start: 0 } }
    }

    /// Creates the posteriors from a block whose first row is not one of them.
    pub(crate) fn after_a_row(states: usize, values: Vec<f64>) -> Self {
        Self { states, values: Values::Own { values, start: states } }
    }

    /// Creates the posteriors from rows in a shared block.
    pub(crate) fn from_shared(rows: SharedRows) -> Self {
        Self { states: rows.states, values: Values::Shared(rows) }
    }

    /// Number of steps, T.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.as_slice().len() / self.states - 1
    }

    /// Number of states, n.
    #[must_use]
    pub fn states(&self) -> usize {
        self.states
    }

    /// Returns the distribution of step k, from 0 to T, or `None` beyond.
    #[must_use]
    pub fn get(&self, step: usize) -> Option<BeliefView<'_>> {
        // The step may be any number, so the product may overflow.
        let start = step.checked_mul(self.states)?;
        let values = self.as_slice().get(start..start.checked_add(self.states)?)?;
        Some(Belief::view(values))
    }

    /// Returns the distributions of the steps with an observation, 1 to T, in order: as many as
    /// there are observations and [modes](Self::modes).
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, LikelihoodVector::linear(2))?;
    /// let smoothing = hmm.smooth(&[[0.9, 0.2], [0.9, 0.2]])?;
    /// let posteriors = smoothing.posteriors();
    /// assert_eq!((posteriors.iter().len(), posteriors.with_start().len()), (2, 3));
    /// assert_eq!(posteriors.iter().next(), posteriors.get(1));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = BeliefView<'_>> + ExactSizeIterator {
        self.rows(1)
    }

    /// Returns the distributions of steps 0 to T, in order: T + 1 of them, that of X_0 first.
    #[must_use]
    pub fn with_start(
        &self,
    ) -> impl DoubleEndedIterator<Item = BeliefView<'_>> + ExactSizeIterator {
        self.rows(0)
    }

    fn rows(
        &self,
        first: usize,
    ) -> impl DoubleEndedIterator<Item = BeliefView<'_>> + ExactSizeIterator {
        self.as_slice()[first * self.states..].chunks_exact(self.states).map(Belief::view)
    }

    /// Returns the most probable state of each step with an observation, 1 to T, so that
    /// `modes()[k - 1]` belongs to `ys[k - 1]`; ties go to the lowest state. O(n T).
    ///
    /// Each is the best estimate for its own step; together they need not form a legal path. For
    /// paths use [`Hmm::viterbi`](crate::Hmm::viterbi).
    #[must_use]
    pub fn modes(&self) -> Vec<usize> {
        self.iter().map(|belief| belief.mode()).collect()
    }

    /// All numbers, step after step: state i of step k at index k n + i.
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        match &self.values {
            Values::Own { values, start } => &values[*start..],
            Values::Shared(rows) => rows,
        }
    }

    /// Returns all numbers, in the order of [`as_slice`](Self::as_slice). They are moved, or copied
    /// if results of several sequences share a block.
    #[must_use]
    pub fn into_vec(self) -> Vec<f64> {
        match self.values {
            Values::Own { mut values, start } => {
                values.drain(..start);
                values
            }
            Values::Shared(rows) => rows.to_vec(),
        }
    }
}

impl fmt::Debug for Posteriors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut all = f.debug_struct("Posteriors");
        all.field("states", &self.states).field("values", &self.as_slice()).finish()
    }
}

impl Clone for Posteriors {
    /// Copies the numbers into memory of their own.
    fn clone(&self) -> Self {
        Self::from_values(self.states, self.as_slice().to_vec())
    }
}

impl PartialEq for Posteriors {
    fn eq(&self, other: &Self) -> bool {
        self.states == other.states && self.as_slice() == other.as_slice()
    }
}

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
    /// [`HmmError`] with the step at which an observation is impossible
    /// or has no valid likelihood, or a control is not valid.
    pub fn forward<S>(&self, sequence: &S) -> Result<FilteredSequence, HmmError>
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
    pub fn log_likelihood<S>(&self, sequence: &S) -> Result<f64, HmmError>
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

/// Smoothed distributions of a whole sequence.
///
/// Made by [`Hmm::smooth`].
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedSequence {
    posteriors: Posteriors,
    log_likelihood: f64,
    steps_in_logs: usize,
}

impl SmoothedSequence {
    /// Creates the result of a routine that takes no steps in logarithms.
    pub(crate) fn new(posteriors: Posteriors, log_likelihood: f64) -> Self {
        Self { posteriors, log_likelihood, steps_in_logs: 0 }
    }

    /// Smoothed distributions p(X_k | y_1 … y_T) for k = 0 … T; at T, the filtered one.
    #[must_use]
    pub fn posteriors(&self) -> &Posteriors {
        &self.posteriors
    }

    /// Returns the distributions without the rest of the result.
    #[must_use]
    pub fn into_posteriors(self) -> Posteriors {
        self.posteriors
    }

    /// Log-likelihood ln p(y_1 … y_T).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Number of steps taken in logarithms, forward or backward, which is several times slower.
    /// With up to eight states it may be lower than that of a filter. If there are many, and the
    /// tails of the model are not credible anyway, [rounded tails](Hmm::with_rounded_tails) are
    /// faster.
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.steps_in_logs
    }
}

impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Smooths a sequence of observations (paper eqs. 10 to 14): returns the distribution of
    /// every step given all of them.
    ///
    /// An empty sequence is allowed: the posterior of X_0 is then the prior.
    ///
    /// Costs two products with A or A' and O(n) a step (three where the sensor has to compute its
    /// likelihoods). The result holds at most n (T + 2) numbers; other memory grows by one number a
    /// step, and by n for each step outside the range of `f64`.
    ///
    /// Models with up to eight states and no control use specialised algorithms, which are faster;
    /// with five states or more these take n T additional `f64`s. With more than eight states and a
    /// dense matrix, or with a sparse one of a few dozen states, a sequence of 2,048 steps or more
    /// runs in lanes if the model forgets fast enough: in segments that are joined as those of
    /// [`learn`](Self::learn), with the same bound on the error and up to 64 MB of other memory.
    ///
    /// For very long sequences use [`smooth_each`](Self::smooth_each), for live ones
    /// [`fixed_lag`](Self::fixed_lag).
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
    /// let smoothing = hmm.smooth(&[0, 0, 1, 0, 0])?;
    /// let third = smoothing.posteriors().get(3).unwrap();
    /// assert!((third.as_slice()[0] - 0.307_483_576_006_617_7).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`HmmError`] with the step at which an observation is impossible
    /// or has no valid likelihood, or a control is not valid.
    pub fn smooth<S>(&self, sequence: &S) -> Result<SmoothedSequence, HmmError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (states, steps) = (self.states(), sequence.steps());
        let whole = if choice::is_whole(states, steps) {
            few_states::smooth(self, sequence)
        } else if choice::smooths_in_lanes(states, steps) {
            lanes::smooth(self, sequence)
        } else {
            None
        };
        if let Some((rows, log_likelihood)) = whole {
            let posteriors = Posteriors::from_values(states, rows);
            return Ok(SmoothedSequence::new(posteriors, log_likelihood));
        }
        // One extra row, where the backward pass begins (see `ForwardPass::begin_backward`).
        let (mut pass, last) = ForwardPass::over(self, sequence, 1, |_| ())?;
        let mut backward = Backward::new(self.states());
        pass.begin_backward();
        let mut steps_in_logs = 0;
        for number in (1..=sequence.steps()).rev() {
            let step = Step::of(self, sequence, number);
            let seen = pass.seen(number, sequence.observation(number));
            let (alpha, out, gamma) = pass.backward_rows(number);
            backward.step_back_from(&step, &seen, alpha, gamma, out)?;
            // A step counts once, whether it was forward, backward or both.
            steps_in_logs += usize::from(pass.taken_in_logs(number) || backward.ratio_in_logs);
        }
        let posteriors = Posteriors::after_a_row(self.states(), pass.rows.into_values());
        let log_likelihood = last.log_likelihood.value();
        Ok(SmoothedSequence { posteriors, log_likelihood, steps_in_logs })
    }
}
