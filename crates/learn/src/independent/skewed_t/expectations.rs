//! Expectations under a skewed Student's t distribution.

use super::SkewedT;
use crate::independent::univariate::{Sums, Univariate};

/// Step of the trapezoidal rule in logarithms of distances. The integrands are analytic in a strip
/// of half-width π/2, so the error of the rule is about exp(−π² / step), below the last digit.
const STEP: f64 = 0.125;

/// Range in logarithms: distances below e^−40 scales are negligible near the location, and a tail
/// of probability e^−40 far from it.
const RANGE: f64 = 40.0;

/// Returns the expectations of the statistics of `by` for observations distributed as `of`.
///
/// The integrands have kinks at the two locations. Below both and above both, the trapezoidal rule
/// is in the logarithm of the distance from the nearer location; between them, in the log-odds of
/// the two distances. Takes some thousand evaluations.
pub(super) fn expectations(by: &SkewedT, of: &SkewedT) -> [f64; 9] {
    let mut sums = [0.0; 9];
    // `width` is dy/dx. Its logarithm is added to the log density, since either may be out of range
    // alone.
    let mut add = |y: f64, width: f64| {
        if y.is_finite() && width > 0.0 {
            let weight = (of.log_density(&y) + width.ln()).exp() * STEP;
            if weight > 0.0 {
                sums.add(weight, &by.statistics(&y));
            }
        }
    };
    let (low, high) = (of.location.min(by.location), of.location.max(by.location));
    let sides = [of.scale / of.skewness, of.scale * of.skewness];
    let logs = |least: f64, most: f64| {
        std::iter::successors(Some(least), |x| Some(x + STEP)).take_while(move |x| *x <= most)
    };
    // A tail falls as distance^−ν, so it takes RANGE / ν in the logarithm.
    // y = location ∓ side · e^x has dy/dx = the distance.
    for x in logs(-RANGE, RANGE / of.degrees.min(1.0)) {
        let distances = sides.map(|side| side * x.exp());
        add(low - distances[0], distances[0]);
        add(high + distances[1], distances[1]);
    }
    let length = high - low;
    if length > 0.0 {
        let most = RANGE + (length / sides[0].min(sides[1])).ln().max(0.0);
        for x in logs(-most, most) {
            // With s = 1 / (1 + e^|x|), the distance from the nearer end is length · s and
            // dy/dx = length · s (1 − s).
            let (share, rest) = ((-x.abs()).exp(), 1.0 / (1.0 + (-x.abs()).exp()));
            let distance = length * (share * rest);
            let y = if x < 0.0 { low + distance } else { high - distance };
            add(y, distance * rest);
        }
    }
    sums
}
