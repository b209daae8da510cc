//! Concentration of directions: its estimate, and draws with it.

use rand::{Rng, RngExt};
use rand_distr::{Beta, Distribution};

use super::special::{Bessel, root};

/// Maximum-likelihood concentration κ of directions in d dimensions whose mean vector has a length
/// r from 0 to below 1, `complement` = 1 − r > 0.
///
/// Solves I_{d/2}(κ) / I_{d/2−1}(κ) = r to the last digits, by Newton's method from the start of
/// Banerjee et al. (2005), as in Sra (2012).
pub(super) fn concentration(dimensions: usize, length: f64, complement: f64) -> f64 {
    if length == 0.0 {
        return 0.0;
    }
    let d = dimensions as f64;
    let start = length * (d - length * length) / (complement * (1.0 + length));
    root(start, |k| {
        let Bessel { ratio, complement: rest, .. } = Bessel::new(0.5 * d - 1.0, k);
        // Derivative of the ratio, times κ; for large κ its leading term, since others cancel.
        let slope = if k > 1e5 * d { rest } else { k * rest * (1.0 + ratio) - (d - 1.0) * ratio };
        if length < 0.5 {
            ((ratio / length).ln(), slope / ratio)
        } else {
            ((complement / rest).ln(), slope / rest)
        }
    })
}

/// Draws 1 − cos θ, where θ is the angle between a direction and its mean (Wood, 1994).
pub(super) fn draw<R: Rng + ?Sized>(dimensions: usize, concentration: f64, rng: &mut R) -> f64 {
    let m = dimensions as f64 - 1.0;
    // Two dimensions or more: the shape is valid.
    let Ok(beta) = Beta::new(0.5 * m, 0.5 * m) else { return 0.0 };
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
