//! Distributions of one number, the components of [`Independent`](super::Independent) families.

mod bernoulli;
mod gamma;
mod log_normal;
mod poisson;
mod von_mises;

pub use bernoulli::Bernoulli;
pub use gamma::Gamma;
pub use log_normal::LogNormal;
pub(super) use poisson::Count;
pub use poisson::Poisson;
pub use von_mises::VonMises;

use std::fmt::Debug;

use rand::Rng;

use super::error::EmissionError;

/// A distribution of one number, with parameters that are learned.
///
/// [`Independent`](super::Independent) makes a family of it: one for each state and component.
///
/// # Implement it yourself
///
/// Waiting times, exponentially distributed:
///
/// ```
/// use rand::{Rng, RngExt};
/// use wayfix::emission::{EmissionError, Independent, Univariate};
///
/// #[derive(Debug, Clone)]
/// struct Waiting {
///     mean: f64,
/// }
///
/// impl Univariate for Waiting {
///     const VALUES: &'static str = "a time above 0";
///     type Point = f64;
///     type Sums = [f64; 2]; // Σ weight and Σ weight y
///
///     fn point(y: f64) -> Option<f64> {
///         (y > 0.0 && y.is_finite()).then_some(y)
///     }
///     fn log_density(&self, y: &f64) -> f64 {
///         -y / self.mean - self.mean.ln()
///     }
///     fn add(&self, sums: &mut [f64; 2], y: &f64, weight: f64) {
///         *sums = [sums[0] + weight, sums[1] + weight * y];
///     }
///     fn add_expected(&self, sums: &mut [f64; 2], of: &Self, count: f64) {
///         self.add(sums, &of.mean, count);
///     }
///     fn expected_log_density(&self, of: &Self) -> f64 {
///         self.log_density(&of.mean) // linear in y
///     }
///     fn maximize(&self, sums: &[f64; 2]) -> Result<Self, EmissionError> {
///         Ok(Self { mean: sums[1] / sums[0] })
///     }
///     fn free_parameters(&self) -> usize {
///         1
///     }
///     fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
///         -self.mean * (1.0 - rng.random::<f64>()).ln()
///     }
/// }
///
/// # use wayfix::inference::LearningOptions;
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior};
/// let times = Independent::from_rows(&[[Waiting { mean: 1.0 }], [Waiting { mean: 10.0 }]])?;
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.8, 0.2], [0.2, 0.8]])?, times)?;
/// let seen = [[2.1], [1.9], [2.0], [40.0], [60.0], [50.0], [48.0]];
/// let learned = hmm.learn(&[seen], &LearningOptions::default())?;
/// assert!(learned.model().likelihood().component(1, 0).is_some_and(|times| times.mean > 40.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Univariate: Clone + Debug {
    /// Valid observations, in words, for errors.
    const VALUES: &'static str;

    /// An observation with what all states compute from it alike, such as its logarithm.
    type Point;

    /// Sufficient statistics: an array that holds the sum of weights first, and then sums of
    /// weighted values. Best centred on the present parameters, as a variance is.
    type Sums: AsRef<[f64]> + AsMut<[f64]> + Default + Clone + Send;

    /// Returns the observation if it is valid. It is never NaN.
    fn point(value: f64) -> Option<Self::Point>;

    /// Logarithm of the density (or probability) of an observation: −∞ where it is 0, never NaN.
    fn log_density(&self, point: &Self::Point) -> f64;

    /// Adds an observation with a weight above 0.
    fn add(&self, sums: &mut Self::Sums, point: &Self::Point, weight: f64);

    /// Adds so many observations distributed as `of`: `count` times the expectation of what
    /// [`add`](Self::add) adds with weight 1.
    fn add_expected(&self, sums: &mut Self::Sums, of: &Self, count: f64);

    /// Expectation of the log density of an observation that is distributed as `of`, up to terms
    /// that are free of the parameters of `self`.
    fn expected_log_density(&self, of: &Self) -> f64;

    /// Adds the pseudo-count of each value that `self` does not rule out, where values are few; by
    /// default nothing.
    fn add_pseudo_count(&self, sums: &mut Self::Sums, pseudo_count: f64) {
        let _ = (sums, pseudo_count);
    }

    /// Log density of the prior that the pseudo-count stands for, without its constant; by
    /// default 0.
    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let _ = pseudo_count;
        0.0
    }

    /// Returns the distribution that maximises the log-likelihood of the observations behind the
    /// sums, which were added by `self`, and have a weight of at least 2.2e-308.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] without state and component, which the family adds, if the sums
    /// determine no valid distribution.
    fn maximize(&self, sums: &Self::Sums) -> Result<Self, EmissionError>;

    /// Number of parameters that learning may change independently of each other.
    fn free_parameters(&self) -> usize;

    /// Draws an observation.
    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64;
}

/// Returns the parameter if it is valid.
pub(super) fn check(
    what: &'static str,
    value: f64,
    valid: bool,
    expected: &'static str,
) -> Result<f64, EmissionError> {
    let (state, component) = (None, None);
    if valid {
        Ok(value)
    } else {
        Err(EmissionError::Parameter { what, state, component, value, expected })
    }
}

/// Sum of `factor` times each value added to the sums.
fn add_scaled<const N: usize>(sums: &mut [f64; N], factor: f64, values: [f64; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

/// Lowest log density that is told apart from that of an impossible observation, which is −∞. It
/// is below what a diagonal may hold, where it is an error and not taken for a density of 0.
pub(super) const LOWEST: f64 = -1e301;

/// Part of a mean square below which a variance is rounding.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Returns a variance, or another measure of spread, if sums with a mean square determine it.
pub(super) fn spread(
    what: &'static str,
    weight: f64,
    variance: f64,
    square: f64,
) -> Result<f64, EmissionError> {
    if variance > ROUNDING * square && square.is_finite() {
        return Ok(variance);
    }
    let reason = "they are alike, so that the spread has no estimate; give a prior";
    Err(EmissionError::TooFew { state: None, component: None, what, weight, reason })
}
