//! Gamma distribution: durations and speeds, by their mean and their spread around it.
//!
//! With the mean m = a s of shape a and scale s, Stirling's formula and its error Δ turn the
//! density into
//!
//! ```text
//! ln p(y) = ½ ln(a / 2π) − Δ(a) − a (y / m − 1 − ln(y / m)) − ln y
//! ```
//!
//! whose third term is 0 at the mean, where the terms of the usual form cancel for large a.

use std::f64::consts::TAU;

use rand::Rng;
use rand_distr::Distribution;

use super::Independent;
use super::univariate::{Cumulative, Univariate, positive};
use crate::error::{LOG_DENSITY_FLOOR, check, check_spread};
use crate::special::{Odds, ln_minus_digamma, log_excess, root, stirling};
use crate::{EmissionError, Tails};

/// Gamma distribution of a positive number, such as a duration or a speed.
///
/// With shapes a_c and scales s_c, a [family](Self::family) of d numbers has p(y) = Π_c y_c^{a_c −
/// 1} exp(−y_c / s_c) / (Γ(a_c) s_c^{a_c}), of finite y_c above 0: the mean is a s, the variance a
/// s².
///
/// Learning finds the shape that solves ln a − ψ(a) = ln ȳ − mean of ln y, by Newton's method in ln
/// a to the last digits from the starting value of Minka (*Estimating a Gamma distribution*, 2002),
/// and the scale ȳ / a; both are accurate also for a large shape. Observations that are all alike
/// determine no shape, an [error](EmissionError::TooFew), unless there is a prior: that of c
/// [observations](Independent::with_prior) with shape b and scale t has the density of a and s
/// proportional to exp(c ((a − 1) (ψ(b) + ln t) − b t / s − ln Γ(a) − a ln s)), which is conjugate
/// (Miller, 1980).
///
/// ```
/// use wayfix_learn::Gamma;
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     Gamma::family(&[[2.0], [2.0]], &[[1.0], [10.0]])?, // shapes, then scales
/// )?;
/// let waits = [[1.2], [2.7], [1.9], [30.0], [24.0], [41.0], [2.2], [1.4]];
/// let learned = hmm.learn(&[waits], &LearningOptions::default())?;
/// let long = learned.model().likelihood().component(1, 0).unwrap();
/// assert!((long.shape() * long.scale() - 95.0 / 3.0).abs() < 1e-3); // their mean
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gamma {
    shape: f64,
    scale: f64,
    mean: f64,
    ln_mean: f64,
    /// Log density at the mean, without the term −ln y.
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

    /// Creates a family from one row for each state, with the shape of each component, and one with
    /// the scales.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, or a shape,
    /// scale or product of them that is not finite and above 0.
    pub fn family(
        shapes: &[impl AsRef<[f64]>],
        scales: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        Independent::of_two(["list of shapes", "list of scales"], shapes, scales, Self::new)
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

    /// u = y / m − 1, the relative distance from the mean, and u − ln(1 + u).
    fn excess(&self, [y, ln]: [f64; 2]) -> (f64, f64) {
        let u = (y - self.mean) / self.mean;
        // Far from the mean, the difference of the logarithms does not cancel.
        (u, if (-0.4..=0.6).contains(&u) { log_excess(u) } else { u - (ln - self.ln_mean) })
    }
}

impl Univariate for Gamma {
    const VALUES: &'static str = "a finite value above 0";
    /// The number and its logarithm.
    type Point = [f64; 2];
    /// 1, u and u − ln(1 + u), where u = y / m − 1 and m is the present mean.
    type Statistics = [f64; 3];

    fn point(value: f64) -> Option<[f64; 2]> {
        positive(value)
    }

    // The formula at the top.
    fn log_density(&self, &y: &[f64; 2]) -> f64 {
        (self.constant - self.shape * self.excess(y).1 - y[1]).max(LOG_DENSITY_FLOOR)
    }

    #[inline]
    fn statistics(&self, &y: &[f64; 2]) -> [f64; 3] {
        let (u, excess) = self.excess(y);
        [1.0, u, excess]
    }

    fn expectations(&self, of: &Self) -> [f64; 3] {
        // For y ~ Gamma(mean m, shape a) of `of`: E ln y = ln m + ψ(a) − ln a.
        let (u, excess) = self.excess([of.mean, of.ln_mean]);
        [1.0, u, excess + ln_minus_digamma(of.shape).0]
    }

    fn expected_log_density(&self, &[_, _, excess]: &[f64; 3]) -> f64 {
        self.constant - self.shape * excess
    }

    fn maximize(&self, &[weight, sum, excess]: &[f64; 3]) -> Result<Self, EmissionError> {
        let (u, excess) = (sum / weight, excess / weight);
        // ln ȳ − mean of ln y = mean of (u − ln(1 + u)) − (ū − ln(1 + ū)), which is ln a − ψ(a) at
        // the maximum, and 0 if all observations are alike.
        let s = check_spread("shape", weight, excess - log_excess(u), excess)?;
        let ln_s = s.ln();
        let start = (3.0 - s + ((s - 3.0).powi(2) + 24.0 * s).sqrt()) / (12.0 * s);
        let start = if start > 0.0 && start.is_finite() { start } else { s.recip() };
        // Solves for equal logarithms of both sides, since this function is nearly linear.
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
        // rand_distr accepts the same parameters, so the default is never used. A draw beyond the
        // range of doubles becomes the nearest valid one.
        let draw = rand_distr::Gamma::new(self.shape, self.scale);
        let draw = draw.map_or(self.mean, |draw| draw.sample(rng));
        draw.clamp(f64::from_bits(1), f64::MAX)
    }
}

impl Cumulative for Gamma {
    /// O(1): an integral of the density of ln y, in some hundred evaluations. Its relative error is
    /// below 1e-12 for shapes below 1e4; beyond, the rounding of y itself dominates.
    fn tails(&self, y: f64) -> Tails {
        // u = ln(y / m), relative to the mode of the density of ln y.
        let above = (y - self.mean) / self.mean;
        let u = if above.abs() < 0.5 { above.ln_1p() } else { y.max(0.0).ln() - self.ln_mean };
        Tails::between(Odds::gamma(self.shape).tail_probabilities(u))
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Gamma for Independent<self::Gamma>: [], |family| {
        shapes: Vec<Vec<f64>> = family.parameters(self::Gamma::shape),
        scales: Vec<Vec<f64>> = family.parameters(self::Gamma::scale),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Gamma>, f64)> = family.prior(),
    } => self::Gamma::family(&shapes, &scales).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
