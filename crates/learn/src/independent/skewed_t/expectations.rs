//! Expectations under a skewed Student's t distribution.

use super::SkewedT;
use crate::independent::univariate::{Sums, Univariate};

/// Width of a step, in logarithms of distances, in which the trapezoidal rule has all digits: the
/// functions are analytic for angles of up to a right one.
const STEP: f64 = 0.125;

/// Logarithm of distances, in units of the scale, that do not matter near the location; and of one
/// over the probability of those that do not far from it.
const RANGE: f64 = 40.0;

/// Returns the expected statistics that a distribution has of observations of another one.
///
/// The trapezoidal rule in the logarithm of the distance from the locations, where sides change: of
/// values below both, above both, and between them, there in the log odds of the two distances.
/// Some thousand evaluations.
pub(super) fn expectations(by: &SkewedT, of: &SkewedT) -> [f64; 9] {
    let mut sums = [0.0; 9];
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
    for x in logs(-RANGE, RANGE / of.degrees.min(1.0)) {
        let distances = sides.map(|side| side * x.exp());
        add(low - distances[0], distances[0]);
        add(high + distances[1], distances[1]);
    }
    let length = high - low;
    if length > 0.0 {
        let most = RANGE + (length / sides[0].min(sides[1])).ln().max(0.0);
        for x in logs(-most, most) {
            let (share, rest) = ((-x.abs()).exp(), 1.0 / (1.0 + (-x.abs()).exp()));
            let distance = length * (share * rest);
            let y = if x < 0.0 { low + distance } else { high - distance };
            add(y, distance * rest);
        }
    }
    sums
}
