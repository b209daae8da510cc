//! Parts of a model that learning leaves as they are.

use std::error::Error;
use std::ops::Deref;

use crate::error::TransitionError;
use crate::inference::{LearnLikelihood, LearnTransition, MoveCounts};
use crate::likelihood::Likelihood;
use crate::transition::TransitionEntries;

/// A transition operator or a sensor that [learning](crate::Hmm::learn) leaves
/// as it is; else the same.
///
/// ```
/// use wayfix::{Fixed, Learning};
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
/// # let motion = DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?;
/// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
///
/// let hmm = Hmm::new(prior, motion, Fixed(camera))?;
/// let learned = hmm.learn(&[[0, 0, 1, 1]], &Learning::default())?;
/// assert_eq!(learned.model().likelihood().probability(0, 0), Some(0.7));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(transparent))]
pub struct Fixed<T>(
    /// The part.
    pub T,
);

impl<T> Deref for Fixed<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

impl<A: TransitionEntries + Clone> LearnTransition for Fixed<A> {
    /// None: no moves need to be counted.
    fn families(&self) -> usize {
        0
    }

    fn reestimate(&self, _: &[MoveCounts], _: f64) -> Result<Self, TransitionError> {
        Ok(self.clone())
    }

    fn log_prior(&self, _: f64) -> f64 {
        0.0
    }
}

impl<B: Likelihood + Clone> LearnLikelihood for Fixed<B> {
    type Statistics = ();

    fn statistics(&self) {}

    fn add(&self, (): &mut (), _: &B::Observation, _: &[f64]) {}

    fn merge(&self, (): &mut (), (): &()) {}

    fn reestimate(&self, (): &(), _: f64) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(self.clone())
    }
}
