//! Options of learning, and the learned model with the course of learning.

use super::criteria::Criteria;
use crate::error::{LearnError, Parameter, SequenceError};
use crate::hmm::Hmm;

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
    /// True to keep the prior as it is; a [stationary](crate::Prior::Stationary) one becomes one at
    /// the first observation, with the same numbers, since the operator changes. (Other parts of
    /// the model are kept by [`Fixed`](crate::Fixed).)
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
            // Negated, so that a NaN is refused.
            if !(value >= 0.0 && value.is_finite()) {
                let (what, expected) = (format!("the {what}"), "a finite value of at least 0");
                return Err(Parameter::new(what, value, expected).into());
            }
        }
        Ok(())
    }
}

/// A learned model, with the course of learning.
///
/// Made by [`Hmm::learn`].
#[derive(Debug, Clone)]
pub struct LearnedModel<A, B> {
    pub(super) model: Hmm<A, B>,
    pub(super) start: usize,
    pub(super) ends: usize,
    pub(super) objectives: Vec<f64>,
    pub(super) log_likelihood: f64,
    pub(super) converged: bool,
    pub(super) stopped: bool,
    pub(super) cause: Option<LearnError>,
    pub(super) left_out: Vec<SequenceError>,
    /// Number of free parameters of the given model.
    pub(super) parameters: usize,
    /// Number of observations that were not left out.
    pub(super) observations: usize,
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

    /// Index of the start that the model was learned from, among those given to
    /// [`Hmm::learn_best`]; 0 if there was one alone.
    #[must_use]
    pub fn start(&self) -> usize {
        self.start
    }

    /// Number of different ends of the starts given to [`Hmm::learn_best`], of those that it
    /// learned from to the end and that did not [fail](Self::failed): their objectives differ by
    /// more than the [tolerance](LearningOptions::tolerance). 1 if there was one start alone.
    ///
    /// Where almost every start has an end of its own, others may end higher still.
    #[must_use]
    pub fn ends(&self) -> usize {
        self.ends
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
        // `objectives` is never empty: it begins with the value of the given model.
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

    /// Number of re-estimations.
    #[must_use]
    pub fn iterations(&self) -> usize {
        self.objectives.len() - 1
    }

    /// Returns true if the last re-estimation gained less than the tolerance. Otherwise learning
    /// was [stopped](Self::stopped) or ended with a [cause](Self::cause); if neither, all
    /// [iterations](LearningOptions::iterations) that were allowed were made.
    #[must_use]
    pub fn converged(&self) -> bool {
        self.converged
    }

    /// Returns true if the function given to [`Hmm::learn_with`] broke off, or
    /// [`Hmm::learn_best`] went on from other starts, and the last re-estimation had not converged.
    #[must_use]
    pub fn stopped(&self) -> bool {
        self.stopped
    }

    /// The error that ended learning with the model before it.
    ///
    /// [`LearnError::Fell`] if the last re-estimation made the objective fall, by at most a
    /// thousandth of it: a part does not maximise the objective, such as a sensor with a floor that
    /// is not in its prior. For any other error, see [`failed`](Self::failed).
    #[must_use]
    pub fn cause(&self) -> Option<&LearnError> {
        self.cause.as_ref()
    }

    /// Returns true if the next re-estimation failed, such as that of a covariance from one
    /// observation, or its model ruled out a sequence. The likelihood may have no bound near this
    /// model, so that its value means little beside that of others.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.cause().is_some_and(|cause| !matches!(cause, LearnError::Fell { .. }))
    }

    /// Sequences excluded from learning, with the reason: the given model rules them out, or they
    /// are not valid.
    #[must_use]
    pub fn left_out(&self) -> &[SequenceError] {
        &self.left_out
    }
}
