//! Sensors whose far tails need not be kept.

use std::ops::Deref;

use rand::Rng;

use super::{Diagonal, Likelihood, LocalLikelihood, SampleObservation, Scratch, Unlisted};
use crate::error::LikelihoodError;

/// A sensor after which filter and smoother may round to 0 what is below
/// 2.2e-308 of the whole (the smallest normal double); else the same.
///
/// For sensors with tails that are not to be believed, such as those of a
/// Gaussian: on a map they make nearly every belief hold values beyond doubles,
/// and keeping these in logarithms takes some ten times as long. The price: a
/// state so improbable does not come back, even if all later observations speak
/// for it.
///
/// ```
/// use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior, RoundedTails};
///
/// let stay = DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?;
/// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let exact = Hmm::new(prior, stay, LikelihoodVector::log(2))?;
/// let seen = [[0.0, -800.0], [-1000.0, 0.0]];
/// assert_eq!(exact.smooth(&seen)?.posteriors().modes(), [1, 1]);
///
/// let sensor = RoundedTails(LikelihoodVector::log(2));
/// let rounded = Hmm::new(exact.prior().clone(), exact.transition(), sensor)?;
/// assert_eq!(rounded.smooth(&seen)?.posteriors().modes(), [0, 0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(transparent))]
pub struct RoundedTails<B>(
    /// The sensor.
    pub B,
);

impl<B> Deref for RoundedTails<B> {
    type Target = B;

    fn deref(&self) -> &B {
        &self.0
    }
}

impl<B: Likelihood> Likelihood for RoundedTails<B> {
    type Observation = B::Observation;

    fn states(&self) -> usize {
        self.0.states()
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let diagonal = self.0.diagonal(observation, scratch)?;
        Ok(Diagonal { tails_rounded: true, ..diagonal })
    }

    fn rounds_tails(&self) -> bool {
        true
    }

    fn is_at_hand(&self) -> bool {
        self.0.is_at_hand()
    }
}

impl<B: LocalLikelihood> LocalLikelihood for RoundedTails<B> {
    fn local(
        &self,
        observation: &B::Observation,
        states: &[usize],
        out: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<Unlisted, LikelihoodError> {
        self.0.local(observation, states, out, scratch)
    }

    fn standing_out(&self, observation: &B::Observation, states: &mut Vec<usize>) {
        self.0.standing_out(observation, states);
    }
}

impl<B: SampleObservation> SampleObservation for RoundedTails<B> {
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> B::Observation {
        self.0.sample(state, rng)
    }
}
