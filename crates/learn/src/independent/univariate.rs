//! Traits of a distribution of one number, for [`Independent`](super::Independent) families.

use std::fmt::Debug;

use rand::Rng;

use crate::{EmissionError, Tails};

/// A distribution of one number whose parameters are learned.
///
/// [`Independent`](super::Independent) makes a family of it, with one for each state and component.
///
/// # Implement it yourself
///
/// Waiting times, exponentially distributed:
///
/// ```
/// use rand::{Rng, RngExt};
/// use wayfix_learn::{EmissionError, Independent, Univariate};
///
/// #[derive(Debug, Clone)]
/// struct Waiting {
///     mean: f64,
/// }
///
/// impl Univariate for Waiting {
///     const VALUES: &'static str = "a time above 0";
///     type Point = f64;
///     type Statistics = [f64; 2]; // 1 and y
///
///     fn point(y: f64) -> Option<f64> {
///         (y > 0.0 && y.is_finite()).then_some(y)
///     }
///     fn log_density(&self, y: &f64) -> f64 {
///         -y / self.mean - self.mean.ln()
///     }
///     fn statistics(&self, y: &f64) -> [f64; 2] {
///         [1.0, *y]
///     }
///     fn expectations(&self, of: &Self) -> [f64; 2] {
///         [1.0, of.mean]
///     }
///     fn expected_log_density(&self, &[_, mean]: &[f64; 2]) -> f64 {
///         self.log_density(&mean) // linear in y
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

    /// True if 0 is an observation with a probability of its own, as among counts, rather than a
    /// density. [`ExtraZeros`](super::ExtraZeros) needs to know.
    const HAS_ZERO: bool = false;

    /// True if [`maximize`](Self::maximize) finds the maximum at once; false if it takes several
    /// steps, which [`starts`](crate::starts) then makes.
    const EXACT: bool = true;

    /// An observation together with what is the same for all states, such as its logarithm.
    type Point;

    /// Sufficient statistics of one or more observations: an array whose first entry is their
    /// number or the sum of their weights, or a pair of such a number and other [`Sums`]. They are
    /// best centred on the present parameters, as a variance is on the mean.
    type Statistics: Sums;

    /// Returns the observation if it is valid. It is never NaN.
    fn point(value: f64) -> Option<Self::Point>;

    /// Logarithm of the density (or probability) of an observation: −∞ where it is 0, never NaN.
    fn log_density(&self, point: &Self::Point) -> f64;

    /// Statistics of one observation; those of many are the weighted sum.
    fn statistics(&self, point: &Self::Point) -> Self::Statistics;

    /// Expectations of the [statistics](Self::statistics) of an observation distributed as `of`.
    fn expectations(&self, of: &Self) -> Self::Statistics;

    /// Expected log density of an observation whose statistics have these expectations, up to terms
    /// that do not depend on the parameters.
    fn expected_log_density(&self, expectations: &Self::Statistics) -> f64;

    /// Adds the pseudo-count of each value that `self` does not rule out, for distributions on a
    /// few values; by default nothing.
    fn add_pseudo_count(&self, sums: &mut Self::Statistics, pseudo_count: f64) {
        let _ = (sums, pseudo_count);
    }

    /// Log density of the prior that the pseudo-count stands for, up to its constant; by default 0.
    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let _ = pseudo_count;
        0.0
    }

    /// Returns the distribution that maximises the log-likelihood of the observations behind the
    /// sums, which were added by `self` and have a total weight of at least 2.2e-308. Without a
    /// finite-dimensional sufficient statistic, it returns one with a higher likelihood than
    /// `self`, if one exists.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] without state and component, which the family adds, if the sums
    /// determine no valid distribution.
    fn maximize(&self, sums: &Self::Statistics) -> Result<Self, EmissionError>;

    /// Number of free parameters in learning.
    fn free_parameters(&self) -> usize;

    /// Draws an observation.
    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64;
}

/// A distribution of one number with the probabilities on both sides of a value, for
/// [pseudo-residuals](crate::PseudoResiduals) and [forecasts](crate::Predictive).
///
/// All distributions of this crate implement it. For one of your own, such as the waiting times of
/// [`Univariate`]:
///
/// ```
/// use wayfix_learn::Tails;
///
/// fn tails(mean: f64, y: f64) -> Tails {
///     let y = y.max(0.0); // all is above what is below 0
///     Tails { below: -(-y / mean).exp_m1(), at: 0.0, above: (-y / mean).exp() }
/// }
/// assert_eq!(tails(2.0, 1e3).above, (-500.0_f64).exp()); // 1 − below would be 0
/// ```
pub trait Cumulative: Univariate {
    /// Probabilities below, at and above any number but NaN, including numbers that cannot be
    /// observed, such as 0.5 among counts, and ±∞. Compute each tail by itself: 1 less the other
    /// has no digits where it is small.
    fn tails(&self, y: f64) -> Tails;

    /// Canonical number of a valid observation: for an angle, the one from −π to π with the same
    /// direction. By default the observation itself.
    #[must_use]
    fn principal(value: f64) -> f64 {
        value
    }
}

/// Weighted sums of the statistics of observations. Implemented for arrays whose first entry is the
/// sum of the weights, and for pairs of one weight and other sums.
pub trait Sums: Default + Clone + Send {
    /// Sum of the weights.
    fn weight(&self) -> f64;

    /// Adds `factor` times the sums of other observations.
    fn add(&mut self, factor: f64, other: &Self);
}

impl<const N: usize> Sums for [f64; N]
where
    Self: Default,
{
    fn weight(&self) -> f64 {
        self[0]
    }

    #[inline]
    fn add(&mut self, factor: f64, other: &Self) {
        self.iter_mut().zip(other).for_each(|(sum, value)| *sum += factor * value);
    }
}

/// Returns a finite number above 0 with its logarithm, or `None` for others.
pub(super) fn positive(value: f64) -> Option<[f64; 2]> {
    (value > 0.0 && value.is_finite()).then(|| [value, value.ln()])
}
