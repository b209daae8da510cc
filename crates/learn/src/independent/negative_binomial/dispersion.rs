//! Dispersion of negative binomial counts: its sums and its M step.
//!
//! At the mean m of the counts, the log-likelihood of a dispersion α per observation is, up to a
//! constant,
//!
//! ```text
//! L(α) = Σ_j S_j ln(1 + α j) − (m + 1/α) ln(1 + α m),
//! ```
//!
//! where S_j is the share of counts above j. From the present dispersion a to α = a + u, with
//! x_j = j / (1 + a j) from 0 to 1 / a, the first sum grows by Σ_j S_j x_j H(x_j), where
//! H(x) = ln(1 + u x) / x has a second derivative of the sign of u. So a quadrature for the measure
//! S_j x_j that is exact for linear functions bounds it from below: for u > 0 the Gauss rule with
//! one node, for u < 0 the Lobatto rule with nodes at the ends 0 and 1 / a. Both need only the
//! sums of S_j x_j and S_j x_j², the first two derivatives at a (up to sign).

use crate::special::{excess_ratio, log_excess, root};

/// Integral of (j / (1 + α j))² from 0 to y, divided by y³, as a function of z = α y < 1.
///
/// It is (z − 2 ln(1 + z) + z / (1 + z)) / z³, by the series of ln(1 + z) = 2 artanh(z / (2 + z)).
fn square_ratio(z: f64) -> f64 {
    let v = z / (2.0 + z);
    let square = v * v;
    // With v = z / (2 + z), z + z / (1 + z) = 4 Σ v^(2k+1), and 2 ln(1 + z) is the same sum with
    // terms divided by 2k + 1. Those of k = 0 cancel, and what remains is
    // 4 v³ Σ v^2k (2k + 2) / (2k + 3). v³ / z³ is (2 + z)⁻³.
    let (mut sum, mut power, mut even) = (0.0, 1.0, 2.0);
    while power > 1e-18 {
        sum += power * even / (even + 1.0);
        power *= square;
        even += 2.0;
    }
    4.0 * sum / (2.0 + z).powi(3)
}

/// Antiderivatives at y of x = j / (1 + α j) and of x², with the Euler–Maclaurin corrections
/// −f/2 + f'/12 − f'''/720 + f⁽⁵⁾/30240.
fn summed(y: f64, alpha: f64) -> [f64; 2] {
    let z = alpha * y;
    let r = alpha.recip();
    // For small z the logarithm cancels against z: by series.
    let integrals = if z < 1.0 {
        [y * y * excess_ratio(z), y.powi(3) * square_ratio(z)]
    } else {
        [log_excess(z) * r * r, (z - 2.0 * z.ln_1p() + z / (1.0 + z)) * r.powi(3)]
    };
    // Derivatives of x = j t with t = 1 / (1 + α j), in terms of t, x and b = α t.
    let t = (1.0 + z).recip();
    let (x, b) = (y * t, alpha * t);
    let slopes = [t * t, 2.0 * x * t * t];
    let thirds = [6.0 * (b * t).powi(2), 12.0 * b * (1.0 - 2.0 * t) * t.powi(3)];
    let fifths = [120.0 * (b * b * t).powi(2), 240.0 * b.powi(3) * (1.0 - 3.0 * t) * t.powi(3)];
    let values = [x, x * x];
    std::array::from_fn(|k| {
        integrals[k] - 0.5 * values[k] + slopes[k] / 12.0 - thirds[k] / 720.0 + fifths[k] / 30240.0
    })
}

/// Sums of j / (1 + α j) and of its square over the whole numbers j below y. O(1).
pub(super) fn sums(y: f64, alpha: f64) -> [f64; 2] {
    // The Euler–Maclaurin terms fall with powers of j + 1 / α: sum one by one until that is 16.
    let first = if y <= 32.0 { y } else { (16.0 - alpha.recip()).clamp(0.0, 16.0).ceil() };
    let (mut sums, mut j) = ([0.0; 2], 1.0);
    while j < first {
        let x = j / (1.0 + alpha * j);
        sums[0] += x;
        sums[1] += x * x;
        j += 1.0;
    }
    if y > first {
        let (low, high) = (summed(first, alpha), summed(y, alpha));
        sums = std::array::from_fn(|k| sums[k] + (high[k] - low[k]));
    }
    sums
}

/// Returns the dispersion that maximises the bound, from the present dispersion, the mean and
/// variance of the counts, and the means of their [`sums`] at the present dispersion.
pub(super) fn maximize(present: f64, mean: f64, variance: f64, [first, second]: [f64; 2]) -> f64 {
    // The likelihood is then maximal at a dispersion of 0 (Levin and Reeds 1977).
    if variance <= mean {
        return 0.0;
    }
    // Derivative of (m + 1/α) ln(1 + α m) with respect to α, m² (z − ln(1 + z)) / z² with z = α m,
    // and the derivative of that with respect to ln α.
    let falls = |alpha: f64| {
        let slope = mean * mean * excess_ratio(alpha * mean);
        (slope, mean * mean / (1.0 + alpha * mean) - 2.0 * slope)
    };
    if first > falls(present).0 {
        // The likelihood rises with α. Gauss rule: the whole measure at its mean x, so that the sum
        // has the derivative first / (1 + u x).
        let x = second / first;
        let start = if present > 0.0 { present } else { (variance - mean) / mean / mean };
        root(start, |alpha| {
            let (slope, curvature) = falls(alpha);
            let ratio = first / (1.0 + (alpha - present) * x);
            (slope - ratio, curvature + ratio * ratio * x * alpha / first)
        })
    } else if present > 0.0 {
        // It falls. Lobatto rule: the weight a · second at 1 / a gives the right first moment, and
        // the rest is at 0. Their derivatives are weight · a / α and the rest itself.
        let far = present * second;
        root(present, |alpha| {
            let (slope, curvature) = falls(alpha);
            let ratio = far * (present / alpha);
            (slope - (first - far) - ratio, curvature + ratio)
        })
    } else {
        present
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums computed with 50 digits.
    #[test]
    #[expect(clippy::excessive_precision, reason = "digits as they were computed")]
    fn sums_are_those_of_their_terms() {
        for (y, alpha, first, second) in [
            (0.0, 1.0, 0.0, 0.0),
            (5.0, 0.3, 5.416_359_955_833_640, 7.953_075_892_542_071),
            (32.0, 2.0, 14.642_678_347_006_246, 6.949_150_518_431_722),
            (33.0, 2.0, 15.134_986_039_313_938, 7.191_517_382_337_048),
            (33.0, 1e-9, 527.999_988_560_000_3, 11_439.999_442_432_022),
            (1000.0, 1e-12, 499_499.999_667_166_5, 332_833_499.500_999_5),
            (1000.0, 0.001, 306_602.756_940_062_5, 113_580_659.713_426_05),
            (1000.0, 0.04, 22_666.739_065_922_108, 523_897.335_108_278_6),
            (1000.0, 3.0, 332.217_819_731_097_07, 110.492_060_030_099_48),
            (1000.0, 1e50, 9.99e-48, 9.99e-98),
            (20_000.0, 1e-4, 90_135_437.725_781_62, 469_419_867_231.681_8),
        ] {
            let found = sums(y, alpha);
            for (found, expected) in found.into_iter().zip([first, second]) {
                let off = (found - expected).abs();
                assert!(off <= 1e-12 * expected, "{y}, {alpha}: {found}, not {expected}");
            }
        }
    }
}
