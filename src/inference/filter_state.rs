//! What a filter knows, as plain data.

use super::LogSum;
use super::held::Held;
use crate::belief::Belief;

/// The most steps that a filter takes and a snapshot holds: a double can count them.
pub(crate) const MOST_STEPS: usize =
    if usize::BITS > 53 { (1_u64 << 53) as usize } else { usize::MAX };

/// All that a filter knows after k steps: plain data, to be kept, compared,
/// sent elsewhere, and restored.
///
/// ```
/// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?, LikelihoodVector::linear(2))?;
/// let mut filter = hmm.filter();
/// filter.step(&[0.9, 0.2])?;
/// let snapshot = filter.snapshot();
/// filter.step(&[0.1, 0.8])?;
/// filter.restore(&snapshot)?;
/// assert_eq!(filter.snapshot(), snapshot);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct FilterState {
    pub(crate) steps: usize,
    pub(crate) belief: Belief,
    /// The logarithms of the belief, if it has values that doubles do not hold.
    pub(crate) logs: Option<Vec<f64>>,
    pub(crate) log_likelihood: LogSum,
}

impl FilterState {
    pub(super) fn held(&self) -> Held<'_> {
        Held { linear: self.belief.as_slice(), logs: self.logs.as_deref() }
    }

    /// How many steps have been taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The belief after these steps.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        &self.belief
    }

    /// ln p(y_1 … y_k), over the observations made.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood.value()
    }
}
