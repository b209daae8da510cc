//! Options of learning, and its result: the learned model, with a record of how learning went, and
//! its information criteria: the likelihood, penalised by the number of free parameters (Akaike
//! 1974; Schwarz 1978).
//!
//! A parameter is free if learning could have changed it. So parameters are counted in the model
//! that learning started from, since those that it took to 0 were free as well.

use crate::error::{LearnError, OutOfRange, SequenceError};
use crate::hmm::{Hmm, Prior};
use crate::inference::LogSum;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

/// Options of [`Hmm::learn`].
///
/// Pseudo-counts are those of a Dirichlet prior: each free parameter counts as if it had been
/// observed that many more times (0 for maximum likelihood, 1 for Laplace's rule). Probabilities of
/// 0 in the model stay 0 in any case: a forbidden move stays forbidden.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// let learning = LearningOptions::default().with_transition_pseudo_count(0.5).with_keep_prior(true);
/// assert_eq!(learning.iterations, 100);
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LearningOptions {
    /// Largest number of re-estimations; 100 by default.
    pub iterations: usize,
    /// Learning stops when a re-estimation gains less than this, in nats of the objective; 1e-3 by
    /// default. With 0, all iterations are made.
    pub tolerance: f64,
    /// True to keep the prior as it is. A [stationary](crate::Prior::Stationary) one then becomes
    /// one at the first observation, with the same numbers, since the operator changes. (To keep
    /// other parts of the model, wrap them in [`Fixed`](crate::Fixed).)
    pub keep_prior: bool,
    /// Pseudo-count of the prior; 0 by default.
    pub prior_pseudo_count: f64,
    /// Pseudo-count of the transition operator; 0 by default.
    pub transition_pseudo_count: f64,
    /// Pseudo-count of the sensor, for tables of probabilities (symbols, events that happen or
    /// not, counts of several kinds, weights of mixtures); 0 by default. Other families ignore it
    /// and have priors of their own (`with_prior`).
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
    /// Sets the largest number of re-estimations.
    #[must_use]
    pub fn with_iterations(self, iterations: usize) -> Self {
        Self { iterations, ..self }
    }

    /// Sets the gain of a re-estimation below which learning stops.
    #[must_use]
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// Sets whether the prior is kept as it is.
    #[must_use]
    pub fn with_keep_prior(self, keep_prior: bool) -> Self {
        Self { keep_prior, ..self }
    }

    /// Sets the pseudo-count of the prior.
    #[must_use]
    pub fn with_prior_pseudo_count(self, prior_pseudo_count: f64) -> Self {
        Self { prior_pseudo_count, ..self }
    }

    /// Sets the pseudo-count of the transition operator.
    #[must_use]
    pub fn with_transition_pseudo_count(self, transition_pseudo_count: f64) -> Self {
        Self { transition_pseudo_count, ..self }
    }

    /// Sets the pseudo-count of the sensor.
    #[must_use]
    pub fn with_likelihood_pseudo_count(self, likelihood_pseudo_count: f64) -> Self {
        Self { likelihood_pseudo_count, ..self }
    }

    #[doc(hidden)]
    pub fn check(&self) -> Result<(), LearnError> {
        for (what, value) in [
            ("tolerance", self.tolerance),
            ("pseudo-count of the prior", self.prior_pseudo_count),
            ("pseudo-count of the transitions", self.transition_pseudo_count),
            ("pseudo-count of the sensor", self.likelihood_pseudo_count),
        ] {
            // Negated, so that NaN is refused.
            if !(value >= 0.0 && value.is_finite()) {
                let (what, expected) = (format!("the {what}"), "a finite value of at least 0");
                return Err(OutOfRange::new(what, value, expected).into());
            }
        }
        Ok(())
    }
}

/// A learned model, with a record of how learning went.
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
    /// Number of observations in sequences that were not left out.
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
    /// [`Hmm::learn_best`]; 0 if there was only one.
    #[must_use]
    pub fn start(&self) -> usize {
        self.start
    }

    /// Number of different ends of [`Hmm::learn_best`]: objectives that differ by more than the
    /// [tolerance](LearningOptions::tolerance), among starts that were learned to the end and did
    /// not [fail](Self::failed). 1 if there was only one start.
    ///
    /// If almost every start has an end of its own, more starts may well lead to a higher one.
    #[must_use]
    pub fn ends(&self) -> usize {
        self.ends
    }

    /// Values of the objective for the given model and after each re-estimation: ln p of all
    /// observations, plus the logarithm of the Dirichlet density (up to a constant) if there are
    /// pseudo-counts. They never fall, up to rounding.
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

    /// Number of free parameters: those of the model that learning started from
    /// ([`Hmm::free_parameters`]), without its prior if that was
    /// [kept](LearningOptions::keep_prior). Learning may take probabilities to 0, more of them the
    /// longer it runs; they were free parameters all the same.
    #[must_use]
    pub fn free_parameters(&self) -> usize {
        self.parameters
    }

    /// Information criteria of the model, from its [log-likelihood](Self::log_likelihood) and its
    /// [free parameters](Self::free_parameters). Models can be compared by them if they were
    /// learned from the same sequences, with the same ones [left out](Self::left_out).
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # use wayfix::inference::LearningOptions;
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
    /// let start = Hmm::new(prior, DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?,
    /// camera)?; let learned = start.learn(&[[0, 0, 1, 1], [0, 1, 0, 1]],
    /// &LearningOptions::default())?; let criteria = learned.criteria();
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
    /// was [stopped](Self::stopped), ended with a [cause](Self::cause), or made all allowed
    /// [iterations](LearningOptions::iterations).
    #[must_use]
    pub fn converged(&self) -> bool {
        self.converged
    }

    /// Returns true if learning had not converged when the function given to [`Hmm::learn_until`]
    /// stopped it, or when [`Hmm::learn_best`] continued from other starts instead.
    #[must_use]
    pub fn stopped(&self) -> bool {
        self.stopped
    }

    /// Error that ended learning, with the model before it as the result; `None` if there was none.
    ///
    /// [`LearnError::Fell`] means that the last re-estimation lowered the objective by at most a
    /// thousandth of it: some part does not maximise the objective, such as a sensor with a floor
    /// that its prior does not include. For any other error, see [`failed`](Self::failed).
    #[must_use]
    pub fn cause(&self) -> Option<&LearnError> {
        self.cause.as_ref()
    }

    /// Returns true if the next re-estimation failed (as that of a covariance from one observation
    /// does), or its model ruled out a sequence. The likelihood may be unbounded near this model,
    /// so that its value means little in comparison with others.
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

/// Information criteria of a model that was learned from sequences: lower is better.
///
/// Made by [`LearnedModel::criteria`](crate::inference::LearnedModel::criteria) and, for models
/// that were not learned, by [`Hmm::criteria`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Criteria {
    /// Log-likelihood of the observations, L.
    pub log_likelihood: f64,
    /// Number of free parameters, p.
    pub parameters: usize,
    /// Number of observations (steps of all sequences), T.
    pub observations: usize,
}

impl Criteria {
    /// Akaike's criterion, 2 p − 2 L (Akaike 1974).
    #[must_use]
    pub fn aic(&self) -> f64 {
        2.0 * self.parameters as f64 - 2.0 * self.log_likelihood
    }

    /// The Bayesian criterion, p ln T − 2 L (Schwarz 1978).
    #[must_use]
    pub fn bic(&self) -> f64 {
        self.parameters as f64 * (self.observations as f64).ln() - 2.0 * self.log_likelihood
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Number of parameters that learning from this model may change: those of the prior (the
    /// number of its states above 0 less one, or none if it is [stationary](Prior::Stationary)), of
    /// the transition operator and of the sensor. Parts that are [`Fixed`](crate::Fixed) have none.
    ///
    /// For a learned model use
    /// [`LearnedModel::free_parameters`](crate::inference::LearnedModel::free_parameters): this
    /// method would miss probabilities that learning has taken to 0.
    #[must_use]
    pub fn free_parameters(&self) -> usize {
        self.free_in_prior()
            + self.transition().free_parameters()
            + self.likelihood().free_parameters()
    }

    pub(crate) fn free_in_prior(&self) -> usize {
        if matches!(self.prior(), Prior::Stationary(_)) {
            return 0; // it follows from the operator
        }
        self.prior().belief().as_slice().iter().filter(|p| **p > 0.0).count() - 1
    }

    /// Returns the information criteria for these sequences of a model that does not come from
    /// [`learn`](Self::learn), such as one from [labels](Self::fit) or from a file.
    ///
    /// After learning, call [`LearnedModel::criteria`](crate::inference::LearnedModel::criteria)
    /// instead. The parameters counted here are the [free ones of this
    /// model](Self::free_parameters). If its probabilities were learned and some became 0, the
    /// count is too low, and the lower the longer learning went on. Replace it by that of the model
    /// that learning started from:
    ///
    /// ```
    /// use wayfix::inference::Criteria;
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
    /// # let start = Hmm::new(prior, DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?, camera)?;
    /// # let hmm = start.clone();
    /// let seen = [[0, 0, 1, 1], [0, 1, 0, 1]];
    /// let criteria = Criteria { parameters: start.free_parameters(), ..hmm.criteria(&seen)? };
    /// assert_eq!((criteria.parameters, criteria.observations), (1 + 2 + 2, 8));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// The cost is that of [`log_likelihood_all`](Self::log_likelihood_all).
    ///
    /// # Errors
    ///
    /// [`LearnError::Sequence`] for the first sequence that the model rules out or that is not
    /// valid; [`LearnError::Nothing`] without observations.
    pub fn criteria<S>(&self, sequences: &[S]) -> Result<Criteria, LearnError>
    where
        A: Sync,
        B: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let mut sum = LogSum::default();
        // A compensated sum: models may differ by a few nats in millions.
        for log in self.log_likelihood_all(sequences) {
            sum.add(log?);
        }
        let observations = sequences.iter().map(Sequence::steps).sum();
        if observations == 0 {
            return Err(LearnError::nothing(sequences.len(), None));
        }
        let parameters = self.free_parameters();
        Ok(Criteria { log_likelihood: sum.value(), parameters, observations })
    }
}
