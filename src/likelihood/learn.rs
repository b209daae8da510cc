//! [`LearnLikelihood`]: sensors that Baum-Welch re-estimates from observations weighted by the
//! posterior probabilities of the states.

use std::error::Error;

use super::Likelihood;

/// A sensor that can be re-estimated from observations and the posterior probabilities of their
/// states: the new sensor maximises Σ p ln b(y) over all observations y and states, where p is the
/// probability of the state.
///
/// [`TableLikelihood`](crate::TableLikelihood) learns each row; compositions learn their parts;
/// [`Fixed`](crate::Fixed) excludes a sensor from learning. With
/// [`FreeParameters`](crate::inference::FreeParameters), learned parameters have standard errors, in
/// wayfix-learn.
///
/// # Implement it yourself
///
/// Readings with one mean per state, and Gaussian noise of unit variance:
///
/// ```
/// use std::error::Error;
/// use wayfix::likelihood::LearnLikelihood;
/// use wayfix::{Diagonal, Likelihood, LikelihoodError, Scratch};
///
/// #[derive(Clone)]
/// struct Readings(Vec<f64>);
///
/// impl Likelihood for Readings {
///     type Observation = f64;
///     fn states(&self) -> usize {
///         self.0.len()
///     }
///     fn diagonal<'a>(&'a self, y: &f64, scratch: &'a mut Scratch) -> Result<Diagonal<'a>, LikelihoodError> {
///         let logs = scratch.values(self.0.len());
///         logs.iter_mut().zip(&self.0).for_each(|(log, mean)| *log = -0.5 * (y - mean).powi(2));
///         Ok(Diagonal::log(logs))
///     }
/// }
///
/// impl LearnLikelihood for Readings {
///     type Statistics = Vec<(f64, f64)>; // for each state Σ weight and Σ weight y
///     fn statistics(&self) -> Self::Statistics {
///         vec![(0.0, 0.0); self.0.len()]
///     }
///     fn add(&self, statistics: &mut Self::Statistics, y: &f64, posterior: &[f64]) {
///         statistics.iter_mut().zip(posterior).for_each(|(s, p)| *s = (s.0 + p, s.1 + p * y));
///     }
///     fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics) {
///         statistics.iter_mut().zip(other).for_each(|(s, o)| *s = (s.0 + o.0, s.1 + o.1));
///     }
///     fn maximize(&self, statistics: &Self::Statistics, _: f64) -> Result<Self, Box<dyn Error + Send + Sync>> {
///         let means = statistics.iter().zip(&self.0);
///         Ok(Self(means.map(|(s, old)| if s.0 > 0.0 { s.1 / s.0 } else { *old }).collect()))
///     }
///     fn free_parameters(&self) -> usize {
///         self.0.len()
///     }
/// }
///
/// # use wayfix::inference::LearningOptions;
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior};
/// let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.8, 0.2], [0.2, 0.8]])?, Readings(vec![0.0, 1.0]))?;
/// let learned = hmm.learn(&[[-5.1, -4.9, 5.2], [4.8, 5.0, -5.0]], &LearningOptions::default())?;
/// let means = &learned.model().likelihood().0;
/// assert!((means[0] + 5.0).abs() < 0.1 && (means[1] - 5.0).abs() < 0.1);
/// # Ok::<(), Box<dyn Error>>(())
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not say how it is learned",
    note = "to keep it as it is, wrap it in `wayfix::Fixed`"
)]
pub trait LearnLikelihood: Likelihood + Sized {
    /// Sufficient statistics of the observations.
    type Statistics: Send;

    /// Returns empty statistics.
    fn statistics(&self) -> Self::Statistics;

    /// Adds one observation, where `posterior[i]` is the probability of state i at that step.
    fn add(
        &self,
        statistics: &mut Self::Statistics,
        observation: &Self::Observation,
        posterior: &[f64],
    );

    /// Adds the statistics of another sequence.
    fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics);

    /// Returns the sensor that maximises the likelihood of the observations, with `pseudo_count`
    /// added to the count of each free parameter. States without counts (or with less than
    /// 2.2e-308 in all) keep their parameters.
    ///
    /// # Errors
    ///
    /// Any error, if the statistics do not determine a valid sensor.
    fn maximize(
        &self,
        statistics: &Self::Statistics,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>>;

    /// Log density of the prior that the pseudo-counts stand for, without its constant, as
    /// [`LearnTransition::log_prior`](crate::transition::LearnTransition::log_prior). 0 for a
    /// sensor that does not use pseudo-counts.
    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let _ = pseudo_count;
        0.0
    }

    /// Number of parameters that learning may change independently, as information criteria count
    /// them before learning: for a table, the probabilities above 0 less one for each state.
    fn free_parameters(&self) -> usize;
}
