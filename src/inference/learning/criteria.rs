//! Information criteria of models: their likelihood, penalised by the number of free parameters
//! (Akaike 1974; Schwarz 1978).
//!
//! A parameter is free if learning could have changed it. So parameters are counted in the model
//! that learning started from, since those that it took to 0 were free as well.

use crate::error::LearnError;
use crate::hmm::{Hmm, Prior};
use crate::inference::LogSum;
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

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
