//! Durations and speeds, by their logarithm.

use std::f64::consts::TAU;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use super::gamma::Positive;
use super::{LOWEST, Univariate, add_scaled, check, spread};
use crate::emission::error::EmissionError;

/// Log-normal distribution of a positive number.
///
/// The component of the family [`LogNormal`](crate::emission::LogNormal).
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

    /// Mean square of the distance from μ, over observations distributed as `of`.
    fn expected_square(&self, of: &Self) -> f64 {
        (of.mean - self.mean).powi(2) + of.deviation.powi(2)
    }
}

impl Univariate for LogNormal {
    const VALUES: &'static str = "a finite value above 0";
    type Point = Positive;
    /// With weights, of 1, x and x², where x = ln y − μ.
    type Sums = [f64; 3];

    fn point(value: f64) -> Option<Positive> {
        Positive::new(value)
    }

    fn log_density(&self, y: &Positive) -> f64 {
        let z = (y.ln - self.mean) / self.deviation;
        (-0.5 * z * z - self.constant - y.ln).max(LOWEST)
    }

    fn add(&self, sums: &mut [f64; 3], y: &Positive, weight: f64) {
        let x = y.ln - self.mean;
        add_scaled(sums, weight, [1.0, x, x * x]);
    }

    fn add_expected(&self, sums: &mut [f64; 3], of: &Self, count: f64) {
        add_scaled(sums, count, [1.0, of.mean - self.mean, self.expected_square(of)]);
    }

    fn expected_log_density(&self, of: &Self) -> f64 {
        -self.constant - 0.5 * self.expected_square(of) / self.deviation.powi(2)
    }

    fn maximize(&self, &[weight, sum, square]: &[f64; 3]) -> Result<Self, EmissionError> {
        let (x, square) = (sum / weight, square / weight);
        let what = "standard deviation of logarithms";
        let variance = spread(what, weight, square - x * x, square)?;
        Self::new(self.mean + x, variance.sqrt())
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let z: f64 = StandardNormal.sample(rng);
        // A draw that a double does not hold is the nearest that it does.
        (self.mean + self.deviation * z).exp().clamp(f64::from_bits(1), f64::MAX)
    }
}
