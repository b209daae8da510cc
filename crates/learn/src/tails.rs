//! Probabilities on both sides of a number, and the residuals computed from them. Both tails are
//! kept, and quantiles are taken from the smaller one.

use rand::{Rng, RngExt};

use crate::standard_normal::{normal_quantile, normal_sides};

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
