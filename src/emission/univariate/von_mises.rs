//! Headings.

use std::f64::consts::{PI, TAU};

use rand::{Rng, RngExt};

use super::{LOWEST, Univariate, add_scaled, check, spread};
use crate::emission::concentration;
use crate::emission::error::EmissionError;
use crate::emission::special::Bessel;

/// Von Mises distribution of an angle in radians.
///
/// The component of the family [`VonMises`](crate::emission::VonMises).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VonMises {
    mean: f64,
    concentration: f64,
    half: Angle,
    /// Log density at the mean.
    peak: f64,
}

impl VonMises {
    /// Creates the distribution with this mean direction and concentration.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the mean is finite and the concentration from 0 (all
    /// directions are as likely) to 1e300.
    pub fn new(mean: f64, concentration: f64) -> Result<Self, EmissionError> {
        let mean = check("mean direction", mean, mean.is_finite(), "a finite value")?;
        let valid = (0.0..=1e300).contains(&concentration);
        let k = check("concentration", concentration, valid, "a value from 0 to 1e300")?;
        let peak = -TAU.ln() - Bessel::new(0.0, k).log;
        Ok(Self { mean, concentration: k, half: Angle::half(mean), peak })
    }

    /// Mean direction μ, in radians.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Concentration κ; for large κ, 1 / κ is the variance.
    #[must_use]
    pub fn concentration(&self) -> f64 {
        self.concentration
    }

    /// Sine of the angle to μ, and 1 less its cosine.
    fn turn(&self, half: Angle) -> (f64, f64) {
        let sin = half.sin * self.half.cos - half.cos * self.half.sin;
        let cos = half.cos * self.half.cos + half.sin * self.half.sin;
        (2.0 * sin * cos, 2.0 * sin * sin)
    }

    /// As [`turn`](Self::turn), in expectation over observations distributed as `of`.
    fn expected_turn(&self, of: &Self) -> (f64, f64) {
        let (sin, rest) = self.turn(of.half);
        let Bessel { ratio, complement, .. } = Bessel::new(0.0, of.concentration);
        (ratio * sin, complement + ratio * rest)
    }
}

/// Half of an angle, by sine and cosine: those of differences take no further call.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angle {
    sin: f64,
    cos: f64,
}

impl Angle {
    fn half(angle: f64) -> Self {
        let (sin, cos) = (0.5 * angle).sin_cos();
        Self { sin, cos }
    }
}

/// Returns the same direction as an angle from −π to π.
fn wrapped(angle: f64) -> f64 {
    // Sine and cosine know 2π to all its digits, a remainder only to those of a double.
    if angle.abs() <= PI { angle } else { angle.sin().atan2(angle.cos()) }
}

impl Univariate for VonMises {
    const VALUES: &'static str = "a finite angle in radians";
    type Point = Angle;
    /// With weights, of 1, sin Δ and 1 − cos Δ, where Δ = y − μ.
    type Sums = [f64; 3];

    fn point(value: f64) -> Option<Angle> {
        value.is_finite().then(|| Angle::half(value))
    }

    fn log_density(&self, &y: &Angle) -> f64 {
        (self.peak - self.concentration * self.turn(y).1).max(LOWEST)
    }

    fn add(&self, sums: &mut [f64; 3], &y: &Angle, weight: f64) {
        let (sin, rest) = self.turn(y);
        add_scaled(sums, weight, [1.0, sin, rest]);
    }

    fn add_expected(&self, sums: &mut [f64; 3], of: &Self, count: f64) {
        let (sin, rest) = self.expected_turn(of);
        add_scaled(sums, count, [1.0, sin, rest]);
    }

    fn expected_log_density(&self, of: &Self) -> f64 {
        self.peak - self.concentration * self.expected_turn(of).1
    }

    fn maximize(&self, &[weight, sin, rest]: &[f64; 3]) -> Result<Self, EmissionError> {
        let (sin, rest) = (sin / weight, rest / weight);
        let length = sin.hypot(1.0 - rest);
        let variance = 2.0 * rest - rest * rest - sin * sin; // 1 − length²
        let variance = spread("concentration", weight, variance, rest)?;
        let mean = if length == 0.0 {
            self.mean
        } else {
            wrapped(wrapped(self.mean) + sin.atan2(1.0 - rest))
        };
        Self::new(mean, concentration::concentration(2, length, variance / (1.0 + length)))
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let turn =
            2.0 * (0.5 * concentration::draw(2, self.concentration, rng)).sqrt().min(1.0).asin();
        wrapped(wrapped(self.mean) + if rng.random::<bool>() { turn } else { -turn })
    }
}
