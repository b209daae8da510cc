//! [`SampleNext`]: draws of observations that depend on the previous one.

use std::borrow::Borrow;

use rand::Rng;

use super::Likelihood;
use crate::error::LikelihoodError;

/// A likelihood that draws an observation given the previous one, for
/// [`Hmm::simulate_after`](crate::Hmm::simulate_after): an autoregressive model, such as
/// `LinearRegression` of wayfix-learn.
pub trait SampleNext: Likelihood {
    /// An observation by value: `Vec<f64>` for rows of numbers.
    type Sample: Borrow<Self::Observation>;

    /// Draws an observation in `state`, which is below [`states`](Likelihood::states), after the
    /// observation `before`.
    ///
    /// # Errors
    ///
    /// [`LikelihoodError`] if nothing can be drawn after this observation. A sensor's own errors
    /// go into [`LikelihoodError::Sensor`].
    fn sample_next<R: Rng + ?Sized>(
        &self,
        state: usize,
        before: &Self::Observation,
        rng: &mut R,
    ) -> Result<Self::Sample, LikelihoodError>;
}
