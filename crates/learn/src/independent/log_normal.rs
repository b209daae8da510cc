//! Log-normal distribution: durations and speeds, by the normal distribution of their logarithm.

use std::f64::consts::TAU;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Independent;
use super::univariate::{Cumulative, Univariate, positive};
use crate::error::{LOG_DENSITY_FLOOR, check, check_spread};
use crate::{EmissionError, Tails};

/// Log-normal distribution of a positive number, such as a duration or a speed: its logarithm is
/// Gaussian.
///
/// A [family](Self::family) of d numbers has
/// p(y) = Π_c exp(−(ln y_c − μ_c)² / 2σ_c²) / (y_c σ_c √2π), of finite y_c above 0. The median is
/// exp(μ), the mean exp(μ + σ² / 2).
///
/// Learning sets μ and σ² to the weighted mean and variance of the logarithms. Observations that
/// are all alike determine no variance, an [error](EmissionError::TooFew), unless there is a prior.
/// A prior of c [observations](Independent::with_prior) with parameters m and r has the density of
/// μ and σ proportional to σ^−c exp(−c ((μ − m)² + r²) / 2σ²), which is normal-inverse-gamma.
///
/// ```
/// use wayfix_learn::LogNormal;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let walk_or_ride: [f64; 2] = [1.4, 5.0]; // m/s
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.95, 0.05], [0.05, 0.95]])?,
///     LogNormal::family(&walk_or_ride.map(|speed| [speed.ln()]), &[[0.2], [0.5]])?,
/// )?;
/// assert_eq!(hmm.viterbi(&[[1.3], [1.6], [1.2], [4.0], [6.0]])?.states(), [0, 0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogNormal {
    mean: f64,
    deviation: f64,
    /// ln(σ √2π)
    constant: f64,
}

impl LogNormal {
    /// Creates the distribution of y with this mean and standard deviation of ln y.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the mean is from -745 to 710, the range of logarithms of
    /// doubles, and the deviation finite and above 0.
    pub fn new(mean: f64, deviation: f64) -> Result<Self, EmissionError> {
        let in_range = (-745.0..=710.0).contains(&mean);
        let mean = check("mean of logarithms", mean, in_range, "a value from -745 to 710")?;
        let valid = deviation > 0.0 && deviation.is_finite();
        let what = "standard deviation of logarithms";
        let deviation = check(what, deviation, valid, "a finite value above 0")?;
        Ok(Self { mean, deviation, constant: deviation.ln() + 0.5 * TAU.ln() })
    }

    /// Creates a family from one row for each state, with the mean μ of the logarithm of each
    /// component, and one with the standard deviations σ.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, a mean outside
    /// -745 to 710, or a deviation that is not finite and above 0.
    pub fn family(
        means: &[impl AsRef<[f64]>],
        deviations: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        Independent::of_two(["list of means", "list of deviations"], means, deviations, Self::new)
    }

    /// Mean of ln y, μ.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Standard deviation of ln y, σ.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        self.deviation
    }
}

impl Univariate for LogNormal {
    const VALUES: &'static str = "a finite value above 0";
    /// The number and its logarithm.
    type Point = [f64; 2];
    /// 1, x and x², where x = ln y − μ.
    type Statistics = [f64; 3];

    fn point(value: f64) -> Option<[f64; 2]> {
        positive(value)
    }

    fn log_density(&self, &[_, ln]: &[f64; 2]) -> f64 {
        // The density of ln y times the derivative 1 / y.
        let z = (ln - self.mean) / self.deviation;
        (-0.5 * z * z - self.constant - ln).max(LOG_DENSITY_FLOOR)
    }

    #[inline]
    fn statistics(&self, &[_, ln]: &[f64; 2]) -> [f64; 3] {
        let x = ln - self.mean;
        [1.0, x, x * x]
    }

    fn expectations(&self, of: &Self) -> [f64; 3] {
        let x = of.mean - self.mean;
        [1.0, x, x.powi(2) + of.deviation.powi(2)]
    }

    fn expected_log_density(&self, &[_, _, square]: &[f64; 3]) -> f64 {
        -self.constant - 0.5 * square / self.deviation.powi(2)
    }

    fn maximize(&self, &[weight, sum, square]: &[f64; 3]) -> Result<Self, EmissionError> {
        let (x, square) = (sum / weight, square / weight);
        let what = "standard deviation of logarithms";
        // x is relative to the present mean, so little cancels once the present mean is near the
        // new one.
        let variance = check_spread(what, weight, square - x * x, square)?;
        Self::new(self.mean + x, variance.sqrt())
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let z: f64 = StandardNormal.sample(rng);
        // A draw beyond the range of doubles becomes the nearest valid one.
        (self.mean + self.deviation * z).exp().clamp(f64::from_bits(1), f64::MAX)
    }
}

impl Cumulative for LogNormal {
    fn tails(&self, y: f64) -> Tails {
        Tails::of_normal((y.max(0.0).ln() - self.mean) / self.deviation)
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] LogNormal for Independent<self::LogNormal>: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(self::LogNormal::mean),
        deviations: Vec<Vec<f64>> = family.parameters(self::LogNormal::deviation),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::LogNormal>, f64)> = family.prior(),
    } => self::LogNormal::family(&means, &deviations).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
