//! Concentration κ of von Mises(–Fisher) directions: its estimate from the length of the mean
//! vector, and draws of the angle to the mean direction.

use rand::{Rng, RngExt};
use rand_distr::{Beta, Distribution};

use super::special::{Bessel, root};

/// Maximum-likelihood concentration κ of directions in d dimensions whose mean vector has length
/// 0 ≤ r < 1. `complement` is 1 − r > 0.
///
/// Solves I_{d/2}(κ) / I_{d/2−1}(κ) = r to the last digits, by Newton's method from the starting
/// value of Banerjee et al. (2005), as in Sra (2012).
pub(super) fn concentration(dimensions: usize, length: f64, complement: f64) -> f64 {
    if length == 0.0 {
        return 0.0;
    }
    let d = dimensions as f64;
    // With the length r, κ ≈ r (d − r²) / (1 − r²), where 1 − r² is (1 − r) (1 + r).
    let start = length * (d - length * length) / (complement * (1.0 + length));
    root(start, |k| {
        let Bessel { ratio, complement: rest, .. } = Bessel::new(0.5 * d - 1.0, k);
        // The ratio A of Bessel functions has κ A' = κ (1 − A²) − (d − 1) A. For large κ this is (d
        // − 1) / 2κ, nearly 1 − A, a small difference of terms of size d.
        let slope = if k > 1e5 * d { rest } else { k * rest * (1.0 + ratio) - (d - 1.0) * ratio };
        // Solve for the logarithm of the smaller of r and 1 − r, which keeps its digits.
        if length < 0.5 {
            ((ratio / length).ln(), slope / ratio)
        } else {
            ((complement / rest).ln(), slope / rest)
        }
    })
}

/// Draws t = 1 − cos θ, where θ is the angle between a direction and its mean (Wood, 1994).
pub(super) fn draw<R: Rng + ?Sized>(dimensions: usize, concentration: f64, rng: &mut R) -> f64 {
    let m = dimensions as f64 - 1.0;
    // d ≥ 2, so the shape is at least ½ and valid.
    let Ok(beta) = Beta::new(0.5 * m, 0.5 * m) else { return 0.0 };
    // Wood's rejection algorithm, computed for t = 1 − W, which keeps its digits for large κ. With
    // b = (−2κ + √(4κ² + m²)) / m, in a form without cancellation, and x0 = (1 − b) / (1 + b) it
    // proposes W = (1 − (1 + b) Z) / (1 − (1 − b) Z), and accepts if κ W + m ln(1 − x0 W) − κ x0 −
    // m ln(1 − x0²) ≥ ln U. `mode` is 1 − x0.
    let b = m / (2.0 * concentration + m.hypot(2.0 * concentration));
    let mode = 2.0 * b / (1.0 + b);
    loop {
        let z: f64 = beta.sample(rng);
        let t = 2.0 * b * z / ((1.0 - z) + b * z);
        let ratio = (mode + t - mode * t) / (mode * (2.0 - mode));
        if concentration * (mode - t) + m * ratio.ln() >= rng.random::<f64>().ln() {
            return t;
        }
    }
}
