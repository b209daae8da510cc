//! The standard normal distribution function, and its inverse.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

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
        // ln p − ln Φ(z), near the root from the quotient, which has more digits. The slope of ln Φ
        // is φ(z) / Φ(z).
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
