//! Learning by expectation–maximisation (Baum, Petrie, Soules and Weiss 1970; Rabiner 1989,
//! section III-C).

use std::ops::ControlFlow;

use super::criteria::Criteria;
use crate::error::{LearnError, SequenceError};
use crate::hmm::Hmm;
use crate::likelihood::{LearnLikelihood, Likelihood};
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, Transition};

/// Falls of the objective by less than this part of it are rounding.
const ROUNDING: f64 = 1e-9;
/// Falls by no more than this part end learning with the model before; larger ones are an error.
const SMALL_FALL: f64 = 1e-3;

/// Options of [`Hmm::learn`].
///
/// Pseudo-counts are those of a Dirichlet prior: each free parameter counts as observed so many
/// more times (0 for maximum likelihood, 1 for Laplace's rule). Probabilities of 0 in the model
/// stay 0 in any case: a forbidden move stays forbidden.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// let learning = LearningOptions { transition_pseudo_count: 0.5, keep_prior: true, ..LearningOptions::default() };
/// assert_eq!(learning.iterations, 100);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct LearningOptions {
    /// Largest number of re-estimations; 100 by default.
    pub iterations: usize,
    /// Gain of a re-estimation below which learning stops, in nats of the objective; 1e-3 by
    /// default. With 0, all iterations are made.
    pub tolerance: f64,
    /// True to keep the prior as it is. (Other parts of the model are kept by
    /// [`Fixed`](crate::Fixed).)
    pub keep_prior: bool,
    /// Pseudo-count of the prior; 0 by default.
    pub prior_pseudo_count: f64,
    /// Pseudo-count of the transition operator; 0 by default.
    pub transition_pseudo_count: f64,
    /// Pseudo-count of the sensor, for tables of probabilities (symbols, events that happen or
    /// not, counts of several kinds, weights of mixtures); 0 by default. Other families take no
    /// notice of it: their priors are their own (`with_prior`).
    pub likelihood_pseudo_count: f64,
}

impl Default for LearningOptions {
    fn default() -> Self {
        Self {
            iterations: 100,
            tolerance: 1e-3,
            keep_prior: false,
            prior_pseudo_count: 0.0,
            transition_pseudo_count: 0.0,
            likelihood_pseudo_count: 0.0,
        }
    }
}

impl LearningOptions {
    pub(crate) fn check(&self) -> Result<(), LearnError> {
        for (what, value) in [
            ("tolerance", self.tolerance),
            ("pseudo-count of the prior", self.prior_pseudo_count),
            ("pseudo-count of the transitions", self.transition_pseudo_count),
            ("pseudo-count of the sensor", self.likelihood_pseudo_count),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(LearnError::Parameter { what, value });
            }
        }
        Ok(())
    }
}

/// Reason why learning stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The last re-estimation gained less than the tolerance.
    Converged,
    /// The allowed number of iterations was made.
    Iterations,
    /// The last re-estimation made the objective fall, by at most a thousandth of it, and was
    /// discarded: a part does not maximise the objective, such as a sensor with a floor that is
    /// not in its prior. [`LearnedModel::cause`] has the values.
    Fell,
    /// The next re-estimation failed, such as that of a covariance from one observation, or its
    /// model rules out a sequence, and the model before is kept. [`LearnedModel::cause`] has the
    /// error. The likelihood may have no bound near this model, so that its value means little
    /// beside that of others.
    Failed,
    /// The function given to [`Hmm::learn_with`] broke off.
    Stopped,
}

/// A learned model, with the course of learning.
///
/// Made by [`Hmm::learn`].
#[derive(Debug)]
pub struct LearnedModel<A, B> {
    model: Hmm<A, B>,
    objectives: Vec<f64>,
    log_likelihood: f64,
    reason: StopReason,
    cause: Option<LearnError>,
    left_out: Vec<SequenceError>,
    /// Number of free parameters of the given model.
    parameters: usize,
    /// Number of observations that were not left out.
    observations: usize,
}

impl<A, B> LearnedModel<A, B> {
    /// The learned model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Returns the learned model by value.
    #[must_use]
    pub fn into_model(self) -> Hmm<A, B> {
        self.model
    }

    /// Values of the objective, of the given model and after each re-estimation: ln p of all
    /// observations, plus the logarithm of the Dirichlet density (up to a constant) if there are
    /// pseudo-counts. It never falls, up to rounding.
    #[must_use]
    pub fn objectives(&self) -> &[f64] {
        &self.objectives
    }

    /// Log-likelihood of all observations that were not [left out](Self::left_out), under the
    /// learned model.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// The last of the [objectives](Self::objectives).
    #[must_use]
    pub fn objective(&self) -> f64 {
        // The value of the given model is always there.
        self.objectives.last().copied().unwrap_or(f64::NEG_INFINITY)
    }

    /// Number of free parameters: those of the model that was given
    /// ([`Hmm::free_parameters`]), without its prior if that was
    /// [kept](LearningOptions::keep_prior). Learning may take probabilities to 0, more of
    /// them the longer it goes on; the parameters that they belong to were free all the same.
    #[must_use]
    pub fn free_parameters(&self) -> usize {
        self.parameters
    }

    /// Information criteria of the model, from its [log-likelihood](Self::log_likelihood) and its
    /// [free parameters](Self::free_parameters). Those of several models can be compared if they
    /// were learned from the same sequences, and [left out](Self::left_out) the same.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # use wayfix::inference::LearningOptions;
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
    /// let start = Hmm::new(prior, DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?, camera)?;
    /// let learned = start.learn(&[[0, 0, 1, 1], [0, 1, 0, 1]], &LearningOptions::default())?;
    /// let criteria = learned.criteria();
    /// assert_eq!((criteria.parameters, criteria.observations), (1 + 2 + 2, 8));
    /// assert!(criteria.bic() > criteria.aic());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn criteria(&self) -> Criteria {
        let &Self { log_likelihood, parameters, observations, .. } = self;
        Criteria { log_likelihood, parameters, observations }
    }

    fn stopped(self, reason: StopReason, cause: Option<LearnError>) -> Self {
        Self { reason, cause, ..self }
    }

    /// Number of re-estimations.
    #[must_use]
    pub fn iterations(&self) -> usize {
        self.objectives.len() - 1
    }

    /// Reason why learning stopped.
    #[must_use]
    pub fn reason(&self) -> StopReason {
        self.reason
    }

    /// The error behind [`StopReason::Fell`] or [`StopReason::Failed`].
    #[must_use]
    pub fn cause(&self) -> Option<&LearnError> {
        self.cause.as_ref()
    }

    /// Sequences excluded from learning, with the reason: the given model rules them out, or they
    /// are not valid.
    #[must_use]
    pub fn left_out(&self) -> &[SequenceError] {
        &self.left_out
    }
}

/// # Learning
impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Learns prior, transitions and sensor from sequences of observations, of any lengths:
    /// Baum–Welch, from this model to a local maximum.
    ///
    /// States that are alike in this model (equal rows of the table, equal moves) stay alike: start
    /// from different ones, or from several random models, and keep the one with the highest
    /// [`log_likelihood`](LearnedModel::log_likelihood).
    ///
    /// Sequences that this model rules out are excluded: [`LearnedModel::left_out`] names them.
    ///
    /// Structure is kept: probabilities of 0 stay 0. Parts that must not be learned are wrapped
    /// in [`Fixed`](crate::Fixed). An iteration passes twice through each sequence, O(E) a step.
    /// With a stored matrix, eight sequences run in lanes, with 128 n T bytes for such a
    /// group; others, and those outside the range of `f64`, run one by one as in
    /// [`smooth_each`](Self::smooth_each), with O(n + E) memory and the sensor's statistics for
    /// each of 64 that are processed together. Empty sequences have no influence. Runs in
    /// parallel with the feature `rayon`, with the same result to the bit.
    ///
    /// ```
    /// use wayfix::inference::LearningOptions;
    /// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    ///
    /// let hmm = Hmm::new(
    ///     Prior::AtFirstObservation(Belief::uniform(2)?),
    ///     DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?,
    ///     TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?,
    /// )?;
    /// let seen = [vec![0, 0, 0, 0, 1, 1, 1], vec![1, 1, 1, 0, 0, 0, 0, 0]];
    /// let learned = hmm.learn(&seen, &LearningOptions::default())?;
    /// assert!(learned.log_likelihood() > learned.objectives()[0] + 2.0);
    /// assert!(learned.model().transition().get(0, 0) > 0.8); // it seldom changes
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError`] if there is no observation to learn from, a number of `learning` is not valid,
    /// a prior rules out what was learned, a part cannot be re-estimated the first time or
    /// then rules out a sequence, or the objective falls by more than a thousandth (which an
    /// operator or sensor of your own may cause). Later, smaller trouble ends learning with the
    /// best model; see [`LearnedModel::reason`].
    pub fn learn<S>(
        &self,
        sequences: &[S],
        learning: &LearningOptions,
    ) -> Result<LearnedModel<A, B>, LearnError>
    where
        A: LearnTransition,
        B: LearnLikelihood,
        Self: Clone + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        self.learn_with(sequences, learning, |_| ControlFlow::Continue(()))
    }

    /// Learns as [`learn`](Self::learn), and shows the model after each re-estimation to `each`,
    /// which may print or store it, and may break off.
    ///
    /// ```
    /// use std::ops::ControlFlow;
    /// use wayfix::inference::{LearningOptions, StopReason};
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let hmm = Hmm::new(
    /// #     Prior::AtFirstObservation(Belief::uniform(2)?),
    /// #     DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?,
    /// #     TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?,
    /// # )?;
    /// let seen = [vec![0, 0, 0, 0, 1, 1, 1], vec![1, 1, 1, 0, 0, 0, 0, 0]];
    /// let learned = hmm.learn_with(&seen, &LearningOptions::default(), |now| {
    ///     println!("{}: {}", now.iterations(), now.objective());
    ///     if now.iterations() < 3 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    /// })?;
    /// assert_eq!((learned.iterations(), learned.reason()), (3, StopReason::Stopped));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError`] as [`learn`](Self::learn).
    pub fn learn_with<S>(
        &self,
        sequences: &[S],
        learning: &LearningOptions,
        mut each: impl FnMut(&LearnedModel<A, B>) -> ControlFlow<()>,
    ) -> Result<LearnedModel<A, B>, LearnError>
    where
        A: LearnTransition,
        B: LearnLikelihood,
        Self: Clone + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        learning.check()?;
        let all: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
        let (expected, left_out) = self.expectations_of(&all);
        let out = |index: &usize| left_out.binary_search_by_key(index, |e| e.sequence).is_ok();
        let kept: Vec<_> = all.into_iter().filter(|(index, _)| !out(index)).collect();
        let observations = kept.iter().map(|(_, sequence)| sequence.steps()).sum();
        if observations == 0 {
            let sequences = sequences.len();
            return Err(LearnError::Nothing { sequences, first: left_out.into_iter().next() });
        }
        let log_likelihood = expected.log_likelihood();
        let objectives = vec![log_likelihood + self.log_prior(learning)];
        let of_prior = if learning.keep_prior { self.free_in_prior() } else { 0 };
        let mut best = LearnedModel {
            model: self.clone(),
            objectives,
            log_likelihood,
            reason: StopReason::Iterations,
            cause: None,
            left_out,
            parameters: self.free_parameters() - of_prior,
            observations,
        };
        let mut expected = expected;
        for iteration in 1..=learning.iterations {
            let model = match best.model.maximize_checked(&expected, learning) {
                Ok(model) => model,
                Err(error) if iteration == 1 => return Err(error),
                Err(error) => return Ok(best.stopped(StopReason::Failed, Some(error))),
            };
            let failed;
            (expected, failed) = model.expectations_of(&kept);
            match failed.into_iter().next().map(LearnError::Sequence) {
                Some(error) if iteration == 1 => return Err(error),
                Some(error) => return Ok(best.stopped(StopReason::Failed, Some(error))),
                None => {}
            }
            let log_likelihood = expected.log_likelihood();
            let log_prior = model.log_prior(learning);
            if !log_prior.is_finite() {
                return Err(LearnError::LogPrior { iteration, value: log_prior });
            }
            let objective = log_likelihood + log_prior;
            let before = best.objective();
            let fall = (before - objective) / objective.abs().max(1.0);
            if fall.is_nan() || fall > ROUNDING {
                let fell = LearnError::Fell { iteration, before, after: objective };
                let small = fall <= SMALL_FALL;
                return if small {
                    Ok(best.stopped(StopReason::Fell, Some(fell)))
                } else {
                    Err(fell)
                };
            }
            best.objectives.push(objective);
            best = LearnedModel { model, log_likelihood, ..best };
            let stopped = each(&best).is_break();
            if objective - before < learning.tolerance {
                return Ok(best.stopped(StopReason::Converged, None));
            }
            if stopped {
                return Ok(best.stopped(StopReason::Stopped, None));
            }
        }
        Ok(best)
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    fn log_prior(&self, learning: &LearningOptions) -> f64 {
        let prior = if learning.keep_prior || learning.prior_pseudo_count == 0.0 {
            0.0
        } else {
            let possible = self.prior().belief().as_slice().iter().filter(|p| **p > 0.0);
            learning.prior_pseudo_count * possible.map(|p| p.ln()).sum::<f64>()
        };
        prior
            + self.transition().log_prior(learning.transition_pseudo_count)
            + self.likelihood().log_prior(learning.likelihood_pseudo_count)
    }
}
