//! [`Fixed`], a wrapper that excludes a part of a model from learning. It delegates everything
//! else; the traits are implemented beside the traits.

use std::ops::Deref;

/// A transition operator or a sensor that [learning](crate::Hmm::learn) does not change. In all
/// other respects it is the wrapped part.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// use wayfix::Fixed;
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
/// # let motion = DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?;
/// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
///
/// let hmm = Hmm::new(prior, motion, Fixed(camera))?;
/// let learned = hmm.learn(&[[0, 0, 1, 1]], &LearningOptions::default())?;
/// assert_eq!(learned.model().likelihood().probability(0, 0), Some(0.7));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(transparent))]
pub struct Fixed<T>(
    /// The wrapped part.
    pub T,
);

impl<T> Deref for Fixed<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}
