//! Durations and speeds, by their mean and their spread around it.

use std::f64::consts::TAU;

use rand::Rng;
use rand_distr::Distribution;

use super::{LOWEST, Univariate, add_scaled, check, spread};
use crate::emission::error::EmissionError;
use crate::emission::special::{ln_minus_digamma, log_excess, root, stirling};

/// Gamma distribution of a positive number.
///
/// The component of the family [`Gamma`](crate::emission::Gamma).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gamma {
    shape: f64,
    scale: f64,
    mean: f64,
    ln_mean: f64,
    /// Log density at the mean, without −ln y.
    constant: f64,
}

impl Gamma {
    /// Creates the distribution with this shape and scale.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless shape, scale and their product, the mean, are finite
    /// and above 0 (from 2.2e-308).
    pub fn new(shape: f64, scale: f64) -> Result<Self, EmissionError> {
        let is_valid = |value: f64| value >= f64::MIN_POSITIVE && value.is_finite();
        let expected = "a finite value above 0 (from 2.2e-308)";
        let shape = check("shape", shape, is_valid(shape), expected)?;
        let scale = check("scale", scale, is_valid(scale), expected)?;
        let mean =
            check("product of shape and scale", shape * scale, is_valid(shape * scale), expected)?;
        let constant = 0.5 * (shape.ln() - TAU.ln()) - stirling(shape);
        Ok(Self { shape, scale, mean, ln_mean: mean.ln(), constant })
    }

    /// Shape a.
    #[must_use]
    pub fn shape(&self) -> f64 {
        self.shape
    }

    /// Scale s. The mean is a s, the variance a s².
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Distance of y from the mean m, in parts of m, and y / m − 1 − ln(y / m).
    fn excess(&self, Positive { value, ln }: Positive) -> (f64, f64) {
        let u = (value - self.mean) / self.mean;
        (u, if u < -0.5 { u - (ln - self.ln_mean) } else { log_excess(u) })
    }

    /// As [`excess`](Self::excess), in expectation over observations distributed as `of`.
    fn expected_excess(&self, of: &Self) -> (f64, f64) {
        let (u, excess) = self.excess(Positive { value: of.mean, ln: of.ln_mean });
        (u, excess + ln_minus_digamma(of.shape).0)
    }
}

/// A number above 0, with its logarithm.
#[derive(Debug, Clone, Copy)]
pub struct Positive {
    pub(super) value: f64,
    pub(super) ln: f64,
}

impl Positive {
    /// Returns a finite number above 0 with its logarithm.
    pub(super) fn new(value: f64) -> Option<Self> {
        (value > 0.0 && value.is_finite()).then(|| Self { value, ln: value.ln() })
    }
}

impl Univariate for Gamma {
    const VALUES: &'static str = "a finite value above 0";
    type Point = Positive;
    /// With weights, of 1, u and u − ln(1 + u), where u = y / m − 1 and m is the present mean.
    type Sums = [f64; 3];

    fn point(value: f64) -> Option<Positive> {
        Positive::new(value)
    }

    // By the distance from the mean, since the terms of the usual form cancel where the shape is large.
    fn log_density(&self, &y: &Positive) -> f64 {
        (self.constant - self.shape * self.excess(y).1 - y.ln).max(LOWEST)
    }

    fn add(&self, sums: &mut [f64; 3], &y: &Positive, weight: f64) {
        let (u, excess) = self.excess(y);
        add_scaled(sums, weight, [1.0, u, excess]);
    }

    fn add_expected(&self, sums: &mut [f64; 3], of: &Self, count: f64) {
        let (u, excess) = self.expected_excess(of);
        add_scaled(sums, count, [1.0, u, excess]);
    }

    fn expected_log_density(&self, of: &Self) -> f64 {
        self.constant - self.shape * self.expected_excess(of).1
    }

    fn maximize(&self, &[weight, sum, excess]: &[f64; 3]) -> Result<Self, EmissionError> {
        let (u, excess) = (sum / weight, excess / weight);
        // ln of the mean less the mean of ln, which is ln a − ψ(a) at the maximum.
        let s = spread("shape", weight, excess - log_excess(u), excess)?;
        let ln_s = s.ln();
        let start = (3.0 - s + ((s - 3.0).powi(2) + 24.0 * s).sqrt()) / (12.0 * s);
        let start = if start > 0.0 && start.is_finite() { start } else { s.recip() };
        let shape = root(start, |shape| {
            let (value, slope) = ln_minus_digamma(shape);
            (ln_s - value.ln(), -slope / value)
        });
        Self::new(shape, (self.mean + self.mean * u) / shape)
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        // Both parameters are valid there, too; a draw that a double does not hold is the nearest
        // that it does.
        let draw = rand_distr::Gamma::new(self.shape, self.scale);
        let draw = draw.map_or(self.mean, |draw| draw.sample(rng));
        draw.clamp(f64::from_bits(1), f64::MAX)
    }
}
