//! Weibull distribution: durations and speeds, by how their hazard changes.
//!
//! With v = k ln(y / λ), ln p(y) = ln k + v − e^v − ln y. For a new shape ρ k the best scale has
//! λ'^(ρk) = mean of y^(ρk), so that per observation, up to a constant, the likelihood is
//!
//! ```text
//! L(ρ) = ln ρ + ρ E v − ln E exp(ρ v)
//! ```

use std::f64::consts::{PI, TAU};

use rand::Rng;
use rand_distr::{Distribution, Exp1};

use super::Independent;
use super::univariate::{Cumulative, Univariate, positive};
use crate::error::{LOG_DENSITY_FLOOR, check, check_spread};
use crate::special::{ln_minus_digamma, stirling};
use crate::{EmissionError, Tails};

/// Weibull distribution of a positive number, such as a duration or the speed of wind.
///
/// With shapes k_c and scales λ_c, a [family](Self::family) of d numbers has
/// p(y) = Π_c (k_c / λ_c) (y_c / λ_c)^{k_c − 1} exp(−(y_c / λ_c)^{k_c}), of finite y_c above 0.
/// The hazard rises with y for k > 1, and falls for k < 1; for k = 1 the distribution is
/// [`Exponential`](super::Exponential).
///
/// The shape has no finite-dimensional sufficient statistic. Learning maximises a lower
/// bound of the likelihood with the same value and the same first two derivatives at the present
/// shape, between half and twice that shape. So no step lowers the likelihood, and near the maximum
/// each doubles the number of correct digits. The scale is optimal for each shape, λ^k = mean of
/// y^k.
///
/// Observations that are all alike determine no shape, an [error](EmissionError::TooFew), unless
/// there is a prior of c [observations](Independent::with_prior).
///
/// ```
/// use wayfix_learn::Weibull;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.95, 0.05], [0.05, 0.95]])?,
///     Weibull::family(&[[2.0], [2.0]], &[[3.0], [14.0]])?, // shapes, then scales: a calm and a gale
/// )?;
/// assert_eq!(hmm.viterbi(&[[2.3], [4.6], [1.2], [12.0], [19.0]])?.states(), [0, 0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weibull {
    shape: f64,
    scale: f64,
    ln_shape: f64,
    ln_scale: f64,
}

impl Weibull {
    /// Creates the distribution with this shape and scale.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the shape is from 1e-100 to 1e100, and the scale finite
    /// and above 0 (from 2.2e-308).
    pub fn new(shape: f64, scale: f64) -> Result<Self, EmissionError> {
        let valid = (1e-100..=1e100).contains(&shape);
        let shape = check("shape", shape, valid, "a value from 1e-100 to 1e100")?;
        let valid = scale >= f64::MIN_POSITIVE && scale.is_finite();
        let scale = check("scale", scale, valid, "a finite value above 0 (from 2.2e-308)")?;
        Ok(Self { shape, scale, ln_shape: shape.ln(), ln_scale: scale.ln() })
    }

    /// Creates a family from one row for each state, with the shape of each component, and one with
    /// the scales.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, a shape outside
    /// 1e-100 to 1e100, or a scale that is not finite and above 0.
    pub fn family(
        shapes: &[impl AsRef<[f64]>],
        scales: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        Independent::of_two(["list of shapes", "list of scales"], shapes, scales, Self::new)
    }

    /// Shape k.
    #[must_use]
    pub fn shape(&self) -> f64 {
        self.shape
    }

    /// Scale λ, below which are 1 − 1/e of all observations.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// v = k ln(y / λ), accurate also near the scale.
    fn log_power(&self, [y, ln]: [f64; 2]) -> f64 {
        let u = (y - self.scale) / self.scale;
        self.shape * if u.abs() < 0.5 { u.ln_1p() } else { ln - self.ln_scale }
    }

    /// Returns the shape that maximises the bound, relative to the present one, and the logarithm
    /// of the bound of the mean of (y / λ)^k there.
    ///
    /// The second derivative of E exp(ρ v) with respect to ρ, E v² exp(ρ v), is convex, and so lies
    /// below its chord from ρ = 1 to 2, or to ½. Integrated twice, this is a cubic upper bound of
    /// the mean.
    fn step(mean: f64, [value, slope, curvature, at_twice, at_half]: [f64; 5]) -> (f64, f64) {
        // With ρ = 1 + u: L'(1) = 1 + E v − slope / value decides which side to go to. The cubic is
        // value + slope u + curvature u² / 2 + chord u³ / 6, and `gain` is the bound of L less
        // L(1).
        let rises = 1.0 + mean - slope / value >= 0.0;
        let (chord, end) =
            if rises { (at_twice - curvature, 1.0) } else { (2.0 * (curvature - at_half), -0.5) };
        let bound = |u: f64| value + u * (slope + u * (0.5 * curvature + u * chord / 6.0));
        let gain = |u: f64| u.ln_1p() + u * mean - (bound(u) / value).ln();
        let is_before = |u: f64| {
            let ratio = (slope + u * (curvature + 0.5 * u * chord)) / bound(u);
            ((1.0 + u).recip() + mean - ratio >= 0.0) == rises
        };
        // The point where the derivative of the bound changes its sign, by bisection, or the end of
        // the interval.
        let mut u = if !chord.is_finite() {
            0.0
        } else if is_before(end) {
            end
        } else {
            let (mut low, mut high) = (0.0, end);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if is_before(middle) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            low
        };
        // The bound rises at first, but may have several extrema: if it is lower here than at the
        // start, go back by halves.
        while gain(u) < 0.0 && u.abs() > f64::EPSILON {
            u *= 0.5;
        }
        (1.0 + u, bound(u).ln())
    }
}

/// Γ(1 + t), ψ(1 + t) and ψ'(1 + t).
fn gamma(t: f64) -> [f64; 3] {
    let a = 1.0 + t;
    let log = (t + 0.5) * a.ln() - a + 0.5 * TAU.ln() + stirling(a);
    let (gap, slope) = ln_minus_digamma(a);
    [log.exp(), a.ln() - gap, (1.0 - slope) / a]
}

impl Univariate for Weibull {
    const VALUES: &'static str = "a finite value above 0";
    const EXACT: bool = false;
    /// The number and its logarithm.
    type Point = [f64; 2];
    /// 1, v, v², exp(v), v exp(v), v² exp(v), v² exp(2v) and v² exp(v/2), where exp(v) = (y / λ)^k
    /// with the present parameters.
    type Statistics = [f64; 8];

    fn point(value: f64) -> Option<[f64; 2]> {
        positive(value)
    }

    fn log_density(&self, &y: &[f64; 2]) -> f64 {
        let v = self.log_power(y);
        (self.ln_shape + (v - v.exp()) - y[1]).max(LOG_DENSITY_FLOOR)
    }

    fn statistics(&self, &y: &[f64; 2]) -> [f64; 8] {
        let v = self.log_power(y);
        let (square, half) = (v * v, (0.5 * v).exp());
        let exp = half * half;
        [1.0, v, square, exp, v * exp, square * exp, square * exp * exp, square * half]
    }

    fn expectations(&self, of: &Self) -> [f64; 8] {
        // v = V + q g, where exp(g) is exponentially distributed, V = k ln(λ_of / λ) and
        // q = k / k_of. So E exp(t v) = exp(t V) Γ(1 + t q), whose derivatives with respect to t
        // give the moments with v and v²: under the tilted density v has the mean V + q ψ and the
        // variance q² ψ'.
        let (middle, q) = (self.log_power([of.scale, of.ln_scale]), self.shape / of.shape);
        let moments = |times: f64| {
            let [gamma, first, second] = gamma(times * q);
            let (weight, mean) = ((times * middle).exp() * gamma, middle + q * first);
            [weight, weight * mean, weight * (mean * mean + q * q * second)]
        };
        let [[_, mean, square], [value, slope, curvature]] = [0.0, 1.0].map(moments);
        let [at_twice, at_half] = [2.0, 0.5].map(|times| moments(times)[2]);
        [1.0, mean, square, value, slope, curvature, at_twice, at_half]
    }

    fn expected_log_density(&self, &[_, mean, _, value, ..]: &[f64; 8]) -> f64 {
        self.ln_shape + mean - value
    }

    fn maximize(&self, sums: &[f64; 8]) -> Result<Self, EmissionError> {
        let [_, mean, square, powers @ ..] = sums.map(|sum| sum / sums[0]);
        let variance = check_spread("shape", sums[0], square - mean * mean, square)?;
        let [value, _, curvature, ..] = powers;
        let (ratio, shift) = if value > 0.0 && curvature.is_finite() {
            Self::step(mean, powers)
        } else {
            // Sums are beyond the range of doubles: the moments of logarithms are used (Menon,
            // 1963). ln y has the variance π² / 6k² and the mean ln λ − 0.577… / k.
            let ratio = PI / (6.0 * variance).sqrt();
            (ratio, ratio * mean + 0.577_215_664_901_532_9)
        };
        let shape = self.shape * ratio;
        // λ'^(k') = λ^(k') E exp(ρ v).
        Self::new(shape, self.scale * (shift / shape).exp())
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let draw: f64 = Exp1.sample(rng);
        // A draw beyond the range of doubles becomes the nearest valid one.
        (self.scale * draw.powf(self.shape.recip())).clamp(f64::from_bits(1), f64::MAX)
    }
}

impl Cumulative for Weibull {
    fn tails(&self, y: f64) -> Tails {
        // The cumulative hazard is e^v. The upper tail is exp(−e^v), and the lower 1 less that, by
        // `exp_m1`.
        let hazard = match positive(y) {
            Some(y) => self.log_power(y).exp(),
            None if y > 0.0 => f64::INFINITY,
            None => 0.0,
        };
        Tails::between([-(-hazard).exp_m1(), (-hazard).exp()])
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Weibull for Independent<self::Weibull>: [], |family| {
        shapes: Vec<Vec<f64>> = family.parameters(self::Weibull::shape),
        scales: Vec<Vec<f64>> = family.parameters(self::Weibull::scale),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::Weibull>, f64)> = family.prior(),
    } => self::Weibull::family(&shapes, &scales).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
