//! [`LogLikelihoodFn`], log-likelihoods computed by a closure. Its values are taken as logarithms
//! whatever their size, and checked by the caller.

use std::fmt;
use std::marker::PhantomData;

use super::{Diagonal, Likelihood, Scratch};
use crate::error::LikelihoodError;

/// A sensor given by the function ln p(y | state) of observation and state.
///
/// The function is called once per state and step. If readings are sometimes entirely wrong, give
/// it a floor, such as `((-0.5 * z * z).exp() + 1e-6).ln()` for a Gaussian; otherwise one wild
/// reading outweighs all before it. To name the type in a struct, use a function pointer:
/// `LogLikelihoodFn<fn(&f64, usize) -> f64, f64>`.
///
/// ```
/// use wayfix::likelihood::LogLikelihoodFn;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// // A position along a road, measured with a standard deviation of 20 m.
/// let places = [0.0, 100.0, 200.0];
/// let likelihood = LogLikelihoodFn::new(3, move |metres: &f64, i| {
///     -0.5 * ((metres - places[i]) / 20.0_f64).powi(2)
/// });
/// let prior = Prior::AtFirstObservation(Belief::uniform(3)?);
/// let hmm = Hmm::new(prior, DenseTransition::from_fn(3, |_, _| 1.0 / 3.0)?, likelihood)?;
/// let mut filter = hmm.filter();
/// filter.step(&95.0)?;
/// assert_eq!(filter.belief().mode(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct LogLikelihoodFn<F, Y: ?Sized> {
    states: usize,
    function: F,
    observation: PhantomData<fn(&Y)>,
}

impl<F: Fn(&Y, usize) -> f64, Y: ?Sized> LogLikelihoodFn<F, Y> {
    /// Creates a sensor of `states` states. The function returns a value of at most 1e300 in
    /// magnitude, or −∞.
    pub fn new(states: usize, function: F) -> Self {
        Self { states, function, observation: PhantomData }
    }
}

impl<F: Fn(&Y, usize) -> f64, Y: ?Sized> Likelihood for LogLikelihoodFn<F, Y> {
    type Observation = Y;

    fn states(&self) -> usize {
        self.states
    }

    fn diagonal<'a>(
        &'a self,
        observation: &'a Y,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let logs = scratch.values(self.states);
        logs.iter_mut().enumerate().for_each(|(i, log)| *log = (self.function)(observation, i));
        Ok(Diagonal::log(logs))
    }
}

impl<F: Clone, Y: ?Sized> Clone for LogLikelihoodFn<F, Y> {
    fn clone(&self) -> Self {
        Self { function: self.function.clone(), ..*self }
    }
}

impl<F, Y: ?Sized> fmt::Debug for LogLikelihoodFn<F, Y> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LogLikelihoodFn").field("states", &self.states).finish_non_exhaustive()
    }
}
