//! The M-step of learning: the model that fits expectations best (section 9 of the
//! [formulas](crate::guide::formulas)).
//!
//! The expected log-likelihood Q is a sum of terms for prior, operator and sensor, so that each is
//! maximised by itself; only a stationary prior is maximised together with the operator.
//! Probabilities of 0 stay 0.

use super::expectations::Expectations;
use super::learned_model::LearningOptions;
use super::stationary;
use crate::belief::Belief;
use crate::error::LearnError;
use crate::hmm::{Hmm, Prior};
use crate::likelihood::LearnLikelihood;
use crate::transition::LearnTransition;

/// # Learning in parts
impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Returns the model that best fits expectations computed under this model: the M-step. The
    /// options used are the pseudo-counts and `keep_prior`.
    ///
    /// # Errors
    ///
    /// [`LearnError`] if an option is not valid, the expectations are those of another model or
    /// of no sequences ([`LearnError::Nothing`]), or a part cannot be re-estimated.
    pub fn maximize(
        &self,
        expectations: &Expectations<B, A::Statistics>,
        learning: &LearningOptions,
    ) -> Result<Self, LearnError> {
        learning.check()?;
        let (found, expected) = (expectations.first.len(), self.states());
        if found != expected {
            return Err(LearnError::Expectations { found, expected });
        }
        // Every sequence with an observation adds one to the sum of `first`.
        if expectations.first.iter().all(|p| *p == 0.0) {
            return Err(LearnError::nothing(0, None));
        }
        self.maximize_unchecked(expectations, learning)
    }

    /// Returns the model that best fits the expectations, without checking these.
    pub(crate) fn maximize_unchecked(
        &self,
        expected: &Expectations<B, A::Statistics>,
        learning: &LearningOptions,
    ) -> Result<Self, LearnError> {
        let (transition, pseudo_count) = (self.transition(), learning.transition_pseudo_count);
        let belief = self.prior().belief();
        // π(i) ∝ F(i) + c_π.
        let known = belief.as_slice().iter().zip(&expected.first);
        let first: Vec<f64> = known
            .map(|(&old, &seen)| {
                // A pseudo-count must not make possible a state that the model rules out.
                if old > 0.0 { seen + learning.prior_pseudo_count } else { 0.0 }
            })
            .collect();
        let (prior, transition) = match self.prior() {
            Prior::Stationary(_) if learning.keep_prior => {
                // The numbers are kept, but they are no longer those of the new operator's
                // stationary distribution.
                let prior = Prior::AtFirstObservation(belief.clone());
                (prior, transition.maximize(&expected.moves, pseudo_count)?)
            }
            Prior::Stationary(_) => {
                let (transition, belief) =
                    stationary::maximize(transition, &expected.moves, &first, pseudo_count)?;
                (Prior::Stationary(belief), transition)
            }
            prior => {
                // Labelled drives may all begin at unknown states: then nothing is learned about
                // the prior, and it stays.
                let unseen =
                    learning.prior_pseudo_count == 0.0 && expected.first.iter().all(|p| *p == 0.0);
                let belief = if learning.keep_prior || unseen {
                    belief.clone()
                } else {
                    Belief::from_weights(first)?
                };
                (prior.with_belief(belief), transition.maximize(&expected.moves, pseudo_count)?)
            }
        };
        let likelihood = self
            .likelihood()
            .maximize(&expected.sensor, learning.likelihood_pseudo_count)
            .map_err(LearnError::likelihood)?;
        Ok(Self::new(prior, transition, likelihood)?.rounding_tails(self.rounds_tails()))
    }
}
