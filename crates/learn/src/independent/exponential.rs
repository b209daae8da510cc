//! Exponential distribution: times between independent events, ln p(y) = ln λ − λ y.

use rand::Rng;
use rand_distr::{Distribution, Exp1};

use super::Independent;
use super::univariate::{Cumulative, Univariate, positive};
use crate::error::{LOG_DENSITY_FLOOR, check};
use crate::{EmissionError, Tails};

/// Exponential distribution of a positive number, such as the time until the next event.
///
/// With rates λ_c, a [family](Self::family) of d numbers has p(y) = Π_c λ_c exp(−λ_c y_c), of
/// finite y_c above 0: the mean is 1 / λ. It is the [`Gamma`](super::Gamma) and the
/// [`Weibull`](super::Weibull) distribution of shape 1.
///
/// Learning sets 1 / λ to the weighted mean. The [prior](Independent::with_prior) of c observations
/// with rate r is the gamma density of λ with shape c + 1 and rate c / r (Gelman et al., *Bayesian
/// Data Analysis*, 2013).
///
/// ```
/// use wayfix_learn::Exponential;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     Exponential::family(&[[0.5], [0.02]])?, // events each 2 and each 50 seconds
/// )?;
/// assert_eq!(hmm.viterbi(&[[1.2], [0.7], [90.0], [24.0], [41.0]])?.states(), [0, 0, 1, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exponential {
    rate: f64,
    ln_rate: f64,
}

impl Exponential {
    /// Creates the distribution with this rate.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the rate is from 2.3e-308 to 4.4e307, so that the mean
    /// is in range as well.
    pub fn new(rate: f64) -> Result<Self, EmissionError> {
        let valid = (2.3e-308..=4.4e307).contains(&rate);
        let rate = check("rate", rate, valid, "a value from 2.3e-308 to 4.4e307")?;
        Ok(Self { rate, ln_rate: rate.ln() })
    }

    /// Creates a family from one row for each state, with the rate λ of each component.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, or a rate
    /// outside 2.3e-308 to 4.4e307.
    pub fn family<R: AsRef<[f64]>>(rates: &[R]) -> Result<Independent<Self>, EmissionError> {
        Independent::of_one("list of rates", rates, Self::new)
    }

    /// Rate λ. The mean is 1 / λ.
    #[must_use]
    pub fn rate(&self) -> f64 {
        self.rate
    }
}

impl Univariate for Exponential {
    const VALUES: &'static str = "a finite value above 0";
    type Point = f64;
    /// 1 and λ y, which is y relative to the present mean.
    type Statistics = [f64; 2];

    fn point(value: f64) -> Option<f64> {
        positive(value).map(|[y, _]| y)
    }

    fn log_density(&self, &y: &f64) -> f64 {
        (self.ln_rate - self.rate * y).max(LOG_DENSITY_FLOOR)
    }

    #[inline]
    fn statistics(&self, &y: &f64) -> [f64; 2] {
        [1.0, self.rate * y]
    }

    fn expectations(&self, of: &Self) -> [f64; 2] {
        [1.0, self.rate / of.rate]
    }

    fn expected_log_density(&self, &[_, mean]: &[f64; 2]) -> f64 {
        self.ln_rate - mean
    }

    fn maximize(&self, &[weight, sum]: &[f64; 2]) -> Result<Self, EmissionError> {
        // 1 / λ is the weighted mean. The sum is in units of the present mean, and does not
        // overflow where a sum of y would.
        Self::new(self.rate / (sum / weight))
    }

    fn free_parameters(&self) -> usize {
        1
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let draw: f64 = Exp1.sample(rng);
        // A draw beyond the range of doubles becomes the nearest valid one.
        (draw / self.rate).clamp(f64::from_bits(1), f64::MAX)
    }
}

impl Cumulative for Exponential {
    fn tails(&self, y: f64) -> Tails {
        // 1 − exp(−λ y) by `exp_m1`, which keeps the digits of a small lower tail.
        let fall = -self.rate * y.max(0.0);
        Tails::between([-fall.exp_m1(), fall.exp()])
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Exponential for Independent<self::Exponential>: [], |family| {
        rates: Vec<Vec<f64>> = family.parameters(self::Exponential::rate),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Exponential>, f64)> = family.prior(),
    } => self::Exponential::family(&rates).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
