//! Likelihoods that are computed elsewhere: the observation is the diagonal.

use super::{Diagonal, Likelihood, Scratch};
use crate::error::LikelihoodError;

/// The observation is the vector of likelihoods itself, one per state.
///
/// ```
/// use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
///
/// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let transition = DenseTransition::from_rows(2, &[0.7, 0.3, 0.3, 0.7])?;
/// let hmm = Hmm::new(prior, transition, LikelihoodVector::new(2))?;
/// let smoothing = hmm.smooth(&[[0.9, 0.2], [0.9, 0.2]])?;
/// assert!((smoothing.log_likelihood() - (0.55f64 * 0.639_090_909_090_909).ln()).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LikelihoodVector {
    states: usize,
}

impl LikelihoodVector {
    /// For vectors of `states` likelihoods, each finite and at least 0.
    #[must_use]
    pub fn new(states: usize) -> Self {
        Self { states }
    }
}

impl Likelihood for LikelihoodVector {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a [f64],
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        Ok(Diagonal::linear(observation))
    }
}

/// The observation is the vector of log-likelihoods itself, one per state.
///
/// Natural logarithms of any size; −∞ rules a state out.
///
/// ```
/// use wayfix::{Belief, DenseTransition, Hmm, LogLikelihoodVector, Prior};
///
/// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let transition = DenseTransition::from_rows(2, &[0.5; 4])?;
/// let hmm = Hmm::new(prior, transition, LogLikelihoodVector::new(2))?;
/// let mut filter = hmm.filter();
/// filter.step(&[-100_000.0, -100_000.0 + 3f64.ln()])?;
/// assert!((filter.belief().as_slice()[1] - 0.75).abs() < 1e-10);
/// assert!((filter.log_likelihood() - (-100_000.0 + 2f64.ln())).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogLikelihoodVector {
    states: usize,
}

impl LogLikelihoodVector {
    /// For vectors of `states` log-likelihoods, each finite or −∞.
    #[must_use]
    pub fn new(states: usize) -> Self {
        Self { states }
    }
}

impl Likelihood for LogLikelihoodVector {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a [f64],
        _: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        Ok(Diagonal::log(observation))
    }
}
