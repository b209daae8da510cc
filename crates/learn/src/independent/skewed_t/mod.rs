//! Skewed Student's t distribution: returns whose losses have a different spread from their gains.
//!
//! It is two halves of a t distribution, with the scales σ / γ below the location and σ γ above it,
//! that meet at the location with the same density.

mod expectations;
mod maximize;

use std::f64::consts::TAU;

use rand::{Rng, RngExt};
use rand_distr::{ChiSquared, Distribution, StandardNormal};

use super::family::Independent;
use super::univariate::{Cumulative, Univariate};
use crate::check::{LOWEST, check, check_shape, shape};
use crate::special::{Odds, ln_minus_digamma, ln_rising, log_excess};
use crate::{EmissionError, Tails};

/// Student's t distribution of a real number, stretched to one side, such as a financial return
/// (Fernández and Steel, 1998).
///
/// With a location μ, a scale σ, a skewness γ, degrees of freedom ν and Student's density t_ν, a
/// component of a [family](Self::family) has
///
/// ```text
/// p(y) = 2 / (σ (γ + 1/γ)) t_ν(z / γ) for z ≥ 0, and t_ν(z γ) for z < 0, where z = (y − μ) / σ.
/// ```
///
/// The location is the mode. A share of γ² / (1 + γ²) is above it: for γ = 1 this is Student's
/// distribution, and 1 / γ gives the mirror image of γ. For several correlated numbers without
/// skewness use [`StudentT`](crate::StudentT).
///
/// As there, each observation is treated as Gaussian with its precision multiplied by an unknown u.
/// Learning takes the expectation of u, then maximises scale and skewness in closed form, the
/// location by a quadratic lower bound, and ν by Newton's method. So no step lowers the likelihood,
/// but where tails are light, ν grows without end, ever more slowly. Observations that are all
/// alike, or all on one side, or fewer than the parameters, may determine none, an
/// [error](EmissionError::TooFew), unless there is a prior of c
/// [observations](Independent::with_prior), whose expectations are found by numerical integration.
///
/// ```
/// use wayfix_learn::SkewedT;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.95, 0.05], [0.05, 0.95]])?,
///     // Per cent a day, in a quiet market and in a crisis, whose losses are larger than its gains:
///     // locations, scales, skewnesses and degrees of freedom.
///     SkewedT::family(&[[0.1], [0.0]], &[[0.6], [2.0]], &[[1.0], [0.8]], &[[8.0], [4.0]])?,
/// )?;
/// let returns = [[0.2], [-0.4], [0.7], [-4.1], [2.5], [-7.0], [3.0]];
/// assert_eq!(hmm.viterbi(&returns)?.states(), [0, 0, 0, 1, 1, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkewedT {
    location: f64,
    scale: f64,
    skewness: f64,
    degrees: f64,
    /// Log density at the location.
    peak: f64,
    /// ln E u − E ln u given an observation: ln a − ψ(a) with a = (ν + 1) / 2.
    gap: f64,
}

/// Smallest number of degrees of freedom: with fewer, draws leave the range of doubles.
const LEAST: f64 = 0.1;

impl SkewedT {
    /// Creates the distribution with this location, scale, skewness and degrees of freedom.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the location is finite, the scale finite and above 0
    /// (from 2.2e-308, on either side), the skewness from 1e-100 to 1e100, and the degrees finite
    /// and at least 0.1.
    pub fn new(
        location: f64,
        scale: f64,
        skewness: f64,
        degrees: f64,
    ) -> Result<Self, EmissionError> {
        let location = check("location", location, location.is_finite(), "a finite value")?;
        let valid = scale >= f64::MIN_POSITIVE && scale.is_finite();
        let scale = check("scale", scale, valid, "a finite value above 0 (from 2.2e-308)")?;
        let valid = (1e-100..=1e100).contains(&skewness);
        let skewness = check("skewness", skewness, valid, "a value from 1e-100 to 1e100")?;
        let side = scale * skewness.min(skewness.recip());
        let (what, expected) = ("scale of a side", "a finite value above 0 (from 2.2e-308)");
        check(what, side, side >= f64::MIN_POSITIVE, expected)?;
        let (valid, expected) = (degrees >= LEAST, "a finite value of at least 0.1");
        let nu = check("degrees of freedom", degrees, valid && degrees.is_finite(), expected)?;
        // At the mode 2 / (σ (γ + 1/γ)) t_ν(0).
        let sides = (0.5 * (skewness + skewness.recip())).ln();
        let peak = ln_rising(0.5 * nu, 1) - 0.5 * TAU.ln() - scale.ln() - sides;
        let gap = ln_minus_digamma(0.5 * (nu + 1.0)).0;
        Ok(Self { location, scale, skewness, degrees: nu, peak, gap })
    }

    /// Creates a family from four lists with one row for each state: the locations of the
    /// components, their scales, skewnesses and degrees of freedom.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] if there are no states or components, for rows of different lengths, or a
    /// parameter that is not in its range.
    pub fn family(
        locations: &[impl AsRef<[f64]>],
        scales: &[impl AsRef<[f64]>],
        skewnesses: &[impl AsRef<[f64]>],
        degrees: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        let shape = shape("list of locations", locations)?;
        check_shape("list of scales", scales, shape)?;
        check_shape("list of skewnesses", skewnesses, shape)?;
        check_shape("list of degrees of freedom", degrees, shape)?;
        Independent::build(shape, |i, c| {
            let [location, scale] = [locations[i].as_ref()[c], scales[i].as_ref()[c]];
            Self::new(location, scale, skewnesses[i].as_ref()[c], degrees[i].as_ref()[c])
        })
    }

    /// Location μ, the mode.
    #[must_use]
    pub fn location(&self) -> f64 {
        self.location
    }

    /// Scale σ: that of the lower side is σ / γ, that of the upper one σ γ.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Skewness γ: if it is above 1, values above the location spread further than those below.
    #[must_use]
    pub fn skewness(&self) -> f64 {
        self.skewness
    }

    /// Degrees of freedom ν.
    #[must_use]
    pub fn degrees(&self) -> f64 {
        self.degrees
    }

    /// Factor of a value's side, γ or 1 / γ, and the distance from the location in units of σ times
    /// that factor.
    fn distance(&self, y: f64) -> [f64; 2] {
        let side = if y < self.location { self.skewness.recip() } else { self.skewness };
        // The difference of halves does not overflow.
        [side, 2.0 * ((0.5 * y - 0.5 * self.location) / (self.scale * side))]
    }

    /// ln(1 + e² / ν), also where the square overflows.
    fn tail(&self, e: f64) -> f64 {
        let x = e.abs() / self.degrees.sqrt();
        if x < 1e100 { (x * x).ln_1p() } else { 2.0 * x.ln() }
    }
}

impl Univariate for SkewedT {
    const VALUES: &'static str = "a finite value";
    const EXACT: bool = false;
    type Point = f64;
    /// 1; u, u z and u z² for the lower and then the upper side, where z = (y − μ) / σ;
    /// E[u − 1 − ln u]; and the log density.
    type Statistics = [f64; 9];

    fn point(value: f64) -> Option<f64> {
        value.is_finite().then_some(value)
    }

    fn log_density(&self, &y: &f64) -> f64 {
        let [_, e] = self.distance(y);
        (self.peak - 0.5 * (self.degrees + 1.0) * self.tail(e)).max(LOWEST)
    }

    fn statistics(&self, &y: &f64) -> [f64; 9] {
        let nu = self.degrees;
        let [side, e] = self.distance(y);
        // E[u] = (ν + 1) / (ν + e²), then u e and u e². For large e by 1 / e, whose square is in
        // range.
        let [u, first, second] = if e.abs() <= 1.0 {
            let u = (nu + 1.0) / (nu + e * e);
            [u, u * e, u * e * e]
        } else {
            let inverse = e.recip();
            let second = (nu + 1.0) / (nu * inverse * inverse + 1.0);
            [second * inverse * inverse, second * inverse, second]
        };
        // E[u − 1 − ln u] = (u − 1 − ln u) + gap at u = E[u], where u − 1 = (1 − e²) / (ν + e²) and
        // ln u = ln(1 + 1/ν) − ln(1 + e² / ν).
        let above = (u - second) / (nu + 1.0); // u − 1
        let tail = self.tail(e);
        let excess =
            if above < -0.5 { above - (nu.recip().ln_1p() - tail) } else { log_excess(above) };
        let of = [u, first * side, second * side * side];
        let (a, b) = if y < self.location { (of, [0.0; 3]) } else { ([0.0; 3], of) };
        let log = self.peak - 0.5 * (nu + 1.0) * tail;
        [1.0, a[0], a[1], a[2], b[0], b[1], b[2], excess + self.gap, log]
    }

    fn expectations(&self, of: &Self) -> [f64; 9] {
        expectations::expectations(self, of)
    }

    fn expected_log_density(&self, expectations: &[f64; 9]) -> f64 {
        expectations[8]
    }

    fn maximize(&self, sums: &[f64; 9]) -> Result<Self, EmissionError> {
        maximize::maximize(self, sums)
    }

    fn free_parameters(&self) -> usize {
        4
    }

    /// Draws an observation, again if it is beyond the range of doubles.
    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        // A share of γ / (γ + 1/γ) = γ² / (1 + γ²) is above the location.
        let [low, high] = [self.skewness.recip(), self.skewness];
        let side = if rng.random::<f64>() * (low + high) < high { high } else { -low };
        let Ok(chi_squared) = ChiSquared::new(self.degrees) else { return self.location };
        loop {
            let z: f64 = StandardNormal.sample(rng);
            let stretch = (self.degrees / chi_squared.sample(rng)).sqrt();
            let y = self.location + self.scale * (side * (z.abs() * stretch));
            if y.is_finite() {
                return y;
            }
        }
    }
}

impl Cumulative for SkewedT {
    /// O(1): an incomplete beta function, in some hundred evaluations.
    fn tails(&self, y: f64) -> Tails {
        let [side, e] = self.distance(y);
        let [beyond, within] = Odds::student(self.degrees, e);
        // Probabilities of this side and of the other: γ² / (1 + γ²) above, 1 / (1 + γ²) below.
        let other = side.recip();
        let (own, rest) = (side / (side + other), other / (side + other));
        let (outer, inner) = (own * beyond, rest + own * within);
        Tails::between(if y < self.location { [outer, inner] } else { [inner, outer] })
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] SkewedT for Independent<self::SkewedT>: [], |family| {
        locations: Vec<Vec<f64>> = family.parameters(self::SkewedT::location),
        scales: Vec<Vec<f64>> = family.parameters(self::SkewedT::scale),
        skewnesses: Vec<Vec<f64>> = family.parameters(self::SkewedT::skewness),
        degrees: Vec<Vec<f64>> = family.parameters(self::SkewedT::degrees),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::SkewedT>, f64)> = family.prior(),
    } => self::SkewedT::family(&locations, &scales, &skewnesses, &degrees)
        .and_then(|new| crate::independent::with_settings(new, missing, prior));
}
