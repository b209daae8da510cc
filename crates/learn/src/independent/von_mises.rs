//! Von Mises distribution: headings and other angles, ln p(y) = peak − κ (1 − cos(y − μ)).
//!
//! 1 − cos Δ = 2 sin²(Δ/2) is computed from half angles, and 1 less the mean length from it, since
//! both are small for large κ.

use std::f64::consts::{PI, TAU};

use rand::{Rng, RngExt};

use super::Independent;
use super::univariate::{Cumulative, Univariate};
use crate::concentration;
use crate::error::{LOG_DENSITY_FLOOR, check, check_spread};
use crate::special::{Bessel, Circle, mass};
use crate::{EmissionError, Tails};

/// Von Mises distribution of an angle in radians, such as a heading.
///
/// With mean directions μ_c and concentrations κ_c ≥ 0, a [family](Self::family) of d angles has
/// p(y) = Π_c exp(κ_c cos(y_c − μ_c)) / (2π I₀(κ_c)), of finite y_c. Concentrations may have any
/// size, from 0, where all directions are equally likely, to large κ with a variance of 1 / κ.
///
/// Learning sets μ to the direction of the mean vector, and κ to the solution of
/// I₁(κ) / I₀(κ) = its length, by Newton's method to the last digits (Mardia and Jupp, *Directional
/// Statistics*, 2000); learned directions are from −π to π. Observations that are all alike
/// determine no concentration, an [error](EmissionError::TooFew), unless there is a prior: that of
/// c [observations](Independent::with_prior) with parameters m and k has the density of μ and κ
/// proportional to exp(c κ cos(μ − m) I₁(k) / I₀(k)) I₀(κ)^−c, which is conjugate (Guttorp and
/// Lockhart, 1988).
///
/// ```
/// use wayfix_learn::VonMises;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?,
///     VonMises::family(&[[3.1], [0.0]], &[[10.0], [10.0]])?, // south and north
/// )?;
/// // Angles just below π and just above −π are neighbours.
/// assert_eq!(hmm.viterbi(&[[3.0], [-3.0], [3.1], [0.2], [-0.1]])?.states(), [0, 0, 0, 1, 1]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VonMises {
    mean: f64,
    concentration: f64,
    /// Sine and cosine of half the mean.
    half: [f64; 2],
    /// Log density at the mean.
    peak: f64,
}

impl VonMises {
    /// Creates the distribution with this mean direction and concentration.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Parameter`] unless the mean is finite and the concentration from 0 (all
    /// directions equally likely) to 1e300.
    pub fn new(mean: f64, concentration: f64) -> Result<Self, EmissionError> {
        let mean = check("mean direction", mean, mean.is_finite(), "a finite value")?;
        let valid = (0.0..=1e300).contains(&concentration);
        let k = check("concentration", concentration, valid, "a value from 0 to 1e300")?;
        // The density at the mean is e^κ / (2π I₀(κ)), where `Bessel::log` is ln(e^−κ I₀(κ)).
        let peak = -TAU.ln() - Bessel::new(0.0, k).log;
        Ok(Self { mean, concentration: k, half: half(mean), peak })
    }

    /// Creates a family from one row for each state, with the mean direction of each component in
    /// radians, and one with the concentrations.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for zero states or components, rows of different lengths, a mean that is
    /// not finite, or a concentration outside 0 to 1e300.
    pub fn family(
        means: &[impl AsRef<[f64]>],
        concentrations: &[impl AsRef<[f64]>],
    ) -> Result<Independent<Self>, EmissionError> {
        let lists = ["list of means", "list of concentrations"];
        Independent::of_two(lists, means, concentrations, Self::new)
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

    /// sin Δ and 1 − cos Δ of the angle Δ to μ.
    fn turn(&self, [sin_half, cos_half]: [f64; 2]) -> (f64, f64) {
        // Half the difference by the addition theorems, without another call of sine and cosine.
        let sin = sin_half * self.half[1] - cos_half * self.half[0];
        let cos = cos_half * self.half[1] + sin_half * self.half[0];
        (2.0 * sin * cos, 2.0 * sin * sin)
    }
}

/// Sine and cosine of half an angle.
pub(super) fn half(angle: f64) -> [f64; 2] {
    let (sin, cos) = (0.5 * angle).sin_cos();
    [sin, cos]
}

/// Returns the same direction as an angle from −π to π.
pub(super) fn wrapped(angle: f64) -> f64 {
    // Sine and cosine reduce by the exact 2π, a remainder only by the nearest double.
    if angle.abs() <= PI { angle } else { angle.sin().atan2(angle.cos()) }
}

impl Univariate for VonMises {
    const VALUES: &'static str = "a finite angle in radians";
    /// Sine and cosine of half the angle.
    type Point = [f64; 2];
    /// 1, sin Δ and 1 − cos Δ, where Δ = y − μ.
    type Statistics = [f64; 3];

    fn point(value: f64) -> Option<[f64; 2]> {
        value.is_finite().then(|| half(value))
    }

    fn log_density(&self, &y: &[f64; 2]) -> f64 {
        (self.peak - self.concentration * self.turn(y).1).max(LOG_DENSITY_FLOOR)
    }

    #[inline]
    fn statistics(&self, &y: &[f64; 2]) -> [f64; 3] {
        let (sin, rest) = self.turn(y);
        [1.0, sin, rest]
    }

    fn expectations(&self, of: &Self) -> [f64; 3] {
        // The mean vector of `of` has length r and the angle Δ to μ, and
        // 1 − r cos Δ = (1 − r) + r (1 − cos Δ).
        let (sin, rest) = self.turn(of.half);
        let Bessel { ratio, complement, .. } = Bessel::new(0.0, of.concentration);
        [1.0, ratio * sin, complement + ratio * rest]
    }

    fn expected_log_density(&self, &[_, _, rest]: &[f64; 3]) -> f64 {
        self.peak - self.concentration * rest
    }

    fn maximize(&self, &[weight, sin, rest]: &[f64; 3]) -> Result<Self, EmissionError> {
        let (sin, rest) = (sin / weight, rest / weight);
        // The mean vector relative to the present μ is (1 − rest, sin).
        let length = sin.hypot(1.0 - rest);
        let variance = 2.0 * rest - rest * rest - sin * sin; // 1 − length²
        let variance = check_spread("concentration", weight, variance, rest)?;
        let mean = if length == 0.0 {
            self.mean
        } else {
            wrapped(wrapped(self.mean) + sin.atan2(1.0 - rest))
        };
        // 1 − length = (1 − length²) / (1 + length).
        Self::new(mean, concentration::concentration(2, length, variance / (1.0 + length)))
    }

    fn free_parameters(&self) -> usize {
        2
    }

    fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        // sin²(turn / 2) = (1 − cos) / 2; both signs are equally likely.
        let turn =
            2.0 * (0.5 * concentration::draw(2, self.concentration, rng)).sqrt().min(1.0).asin();
        wrapped(wrapped(self.mean) + if rng.random::<bool>() { turn } else { -turn })
    }
}

impl Cumulative for VonMises {
    /// Probabilities between −π and y and between y and π. O(1): integrals of the density, in some
    /// hundred evaluations.
    fn tails(&self, y: f64) -> Tails {
        if y.abs() >= PI {
            let below = f64::from(u8::from(y > 0.0));
            return Tails::between([below, 1.0 - below]);
        }
        // A mean below 0 takes the tails of its mirror image, so the mean is from 0 to π.
        let mean = wrapped(self.mean);
        let (circle, cut, at) = (Circle(self.concentration), PI - mean.abs(), y - mean);
        let at = if mean < 0.0 { -at } else { at };
        // The circle is cut at ±π, which is the angle π − mean from the mean. In angles from the
        // mean, counting from −π starts at the cut, goes up to π, and continues from −π to the cut.
        let (before, after) = (mass(&circle, -PI, cut), mass(&circle, cut, PI));
        let [below, above] = if at < -PI {
            [mass(&circle, cut, at + TAU), before + mass(&circle, at + TAU, PI)]
        } else {
            [after + mass(&circle, -PI, at), mass(&circle, at, cut)]
        };
        let sides = [below / (before + after), above / (before + after)];
        Tails::between(if mean < 0.0 { [sides[1], sides[0]] } else { sides })
    }

    fn principal(value: f64) -> f64 {
        wrapped(value)
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] VonMises for Independent<self::VonMises>: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(self::VonMises::mean),
        concentrations: Vec<Vec<f64>> = family.parameters(self::VonMises::concentration),
        missing: bool = family.takes_missing(),
        prior: Option<(Independent<self::VonMises>, f64)> = family.prior(),
    } => self::VonMises::family(&means, &concentrations).and_then(|new| crate::independent::with_settings(new, missing, prior));
}
