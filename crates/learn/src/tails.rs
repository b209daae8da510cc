//! Probabilities on both sides of a number, and the residuals computed from them. Both tails are
//! kept, and quantiles are taken from the smaller one.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use rand::{Rng, RngExt};

/// Probabilities that a random number is below a value, equal to it, and above it. They sum to one
/// up to rounding.
///
/// Both tails are stored, since 1 less the other would have no digits: 1e-300 is representable on
/// either side. Below 2.2e-308, probabilities are 0 or have fewer digits.
///
/// # As a residual
///
/// If the value was drawn from the distribution, [`uniform`](Self::uniform) is uniform from 0 to 1
/// and [`normal`](Self::normal) is standard normal, provided that single values have no
/// probability. For counts they have, and only the [segment](Self::segment) from P(< y) to P(≤ y)
/// is known: these two then take its midpoint, and [`randomized`](Self::randomized) a random point
/// in it, which makes residuals exactly uniform and normal again (Dunn and Smyth, *Randomized
/// quantile residuals*, 1996). The default has probabilities of 0, to which those of a mixture can
/// be added.
///
/// ```
/// use wayfix_learn::Tails;
///
/// let residual = Tails { below: 1e-20, at: 0.0, above: 1.0 };
/// assert!((residual.normal() + 9.262_340_089_798_408).abs() < 1e-12);
/// let residual = Tails { below: 1.0, at: 0.0, above: 1e-20 };
/// assert!((residual.normal() - 9.262_340_089_798_408).abs() < 1e-12); // and not infinite
///
/// let heads = Tails { below: 0.5, at: 0.5, above: 0.0 }; // of a coin
/// assert_eq!(heads.segment(), [0.5, 1.0]);
/// assert_eq!(heads.uniform(), 0.75);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tails {
    /// Probability below the value, P(Y < y).
    pub below: f64,
    /// Probability of the value itself, P(Y = y); 0 for continuous distributions.
    pub at: f64,
    /// Probability above the value, P(Y > y).
    pub above: f64,
}

impl Tails {
    /// Tails of a value that has no probability itself.
    pub(super) fn between([below, above]: [f64; 2]) -> Self {
        Self { below, at: 0.0, above }
    }

    /// Adds the tails of another distribution with a weight.
    pub(super) fn add(&mut self, weight: f64, other: Self) {
        // With a weight of 0 the other tails may be NaN, and must be left out.
        if weight > 0.0 {
            self.below += weight * other.below;
            self.at += weight * other.at;
            self.above += weight * other.above;
        }
    }

    /// Tails of z in the standard normal distribution.
    pub(super) fn of_normal(z: f64) -> Self {
        Self::between(normal_sides(z))
    }

    /// Probability P(Y ≤ y).
    #[must_use]
    pub fn up_to(&self) -> f64 {
        self.below + self.at
    }

    /// Range of uniform values, from P(Y < y) to P(Y ≤ y).
    #[must_use]
    pub fn segment(&self) -> [f64; 2] {
        [self.below, self.up_to()]
    }

    /// Normal quantiles of the ends of the [segment](Self::segment): infinite at 0 and 1, and
    /// beyond about ±37.5.
    #[must_use]
    pub fn normal_segment(&self) -> [f64; 2] {
        [quantile(self.below, self.at + self.above), quantile(self.up_to(), self.above)]
    }

    /// Uniform value, the midpoint of the [segment](Self::segment).
    #[must_use]
    pub fn uniform(&self) -> f64 {
        self.below + 0.5 * self.at
    }

    /// Normal quantile of the [uniform value](Self::uniform), the pseudo-residual: infinite beyond
    /// about ±37.5, where a tail is below 2.2e-308.
    #[must_use]
    pub fn normal(&self) -> f64 {
        quantile(self.uniform(), self.above + 0.5 * self.at)
    }

    /// Returns the tails of a random point in the [segment](Self::segment), which has no
    /// probability itself: its [`uniform`](Self::uniform) and [`normal`](Self::normal) values are
    /// the randomised residuals. For continuous distributions the tails are unchanged.
    #[must_use]
    pub fn randomized<R: Rng + ?Sized>(&self, rng: &mut R) -> Self {
        let share = rng.random::<f64>();
        let (below, above) = (self.below + share * self.at, self.above + (1.0 - share) * self.at);
        Self { below, at: 0.0, above }
    }
}

/// Normal quantile of a probability, from the smaller tail, which has the digits.
fn quantile(below: f64, above: f64) -> f64 {
    if below <= above { normal_quantile(below) } else { -normal_quantile(above) }
}

// The standard normal distribution function, and its inverse.

/// Probabilities of a standard normal variable below and above z, each accurate by itself.
pub(crate) fn normal_sides(z: f64) -> [f64; 2] {
    [0.5 * libm::erfc(-z * FRAC_1_SQRT_2), 0.5 * libm::erfc(z * FRAC_1_SQRT_2)]
}

/// Quantile of the standard normal distribution at p from 0 to ½; −∞ if p is below 2.2e-308, and 0
/// above ½.
///
/// Newton's method for ln Φ(z) = ln p. ln Φ is concave, so that from a start below the root (by
/// Φ(z) ≤ ½ exp(−z² / 2) for z ≤ 0) all steps lead up to the root, and none beyond.
pub(crate) fn normal_quantile(p: f64) -> f64 {
    if p < f64::MIN_POSITIVE {
        return f64::NEG_INFINITY;
    }
    if p >= 0.5 {
        return 0.0;
    }
    let ln_p = p.ln();
    let mut z = -(-2.0 * ln_p).sqrt();
    for _ in 0..50 {
        let below = normal_sides(z)[0];
        // ln p − ln Φ(z), computed near the root from the quotient, which keeps more digits there.
        // The slope of ln Φ is φ(z) / Φ(z).
        let ratio = p / below;
        let excess =
            if (ratio - 1.0).abs() < 0.5 { (ratio - 1.0).ln_1p() } else { ln_p - below.ln() };
        let step = excess * below * TAU.sqrt() * (0.5 * z * z).exp();
        // At the root only rounding is left, which may point down.
        if step <= f64::EPSILON * z.abs() {
            break;
        }
        z += step;
    }
    z.min(0.0)
}

#[cfg(test)]
mod tests {
    use super::normal_quantile;

    /// Tabulated quantiles (Abramowitz and Stegun 1964, table 26.5).
    #[test]
    fn quantiles_are_those_of_tables() {
        for (within, expected) in [
            (0.5, 0.674_489_750_196_081_7),
            (0.9, 1.644_853_626_951_472_2),
            (0.95, 1.959_963_984_540_054),
            (0.99, 2.575_829_303_548_900_4),
            (0.999, 3.290_526_731_491_895),
        ] {
            let found = -normal_quantile(0.5 * (1.0 - within));
            assert!((found - expected).abs() < 1e-13, "{within}: {found}");
        }
        // The largest level below 1.
        let farthest = -normal_quantile(0.25 * f64::EPSILON);
        assert!((farthest - 8.21).abs() < 0.1, "{farthest}");
    }
}
