//! Sums and scales of vectors, in plain loops: they are called rarely, not in each step.
//!
//! As in kernels, sums have eight lanes, joined by [`total`], followed by the rest in order: so the
//! compiler can vectorise them without a licence to reorder.

use super::simd::{LANES, total};
use crate::limits::{LIFT, TINY};

/// Σ xᵢ.
pub fn sum(x: &[f64]) -> f64 {
    let (blocks, rest) = x.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for block in blocks {
        for l in 0..LANES {
            lanes[l] += block[l];
        }
    }
    total(lanes) + rest.iter().sum::<f64>()
}

/// Σ xᵢ yᵢ.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    let ((xs, x_rest), (ys, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for (x, y) in xs.iter().zip(ys) {
        for l in 0..LANES {
            lanes[l] += x[l] * y[l];
        }
    }
    total(lanes) + x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum::<f64>()
}

/// ln Σ eˣ without overflow or underflow; ±∞ if the largest x is.
pub fn log_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if largest.is_infinite() {
        return largest;
    }
    let mut sum = 0.0;
    for term in terms {
        let below = term - largest;
        // The sum is at least 1, and e^-45 is 3e-20: thousands of such terms do not change its last
        // digit.
        if below > -45.0 {
            sum += if below == 0.0 { 1.0 } else { below.exp() };
        }
    }
    largest + sum.ln()
}

/// Writes x, lifted.
pub fn lift(x: &[f64], out: &mut [f64]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out = x * LIFT);
}

/// True if a probability is above 0 and below 2^-900.
pub fn any_tiny(x: &[f64]) -> bool {
    x.iter().any(|&x| 0.0 < x && x < TINY)
}

/// Divides a vector by its sum, `sum`. Values that would be below the smallest normal double become
/// 0: the far tails of a Gaussian sensor alone would double the time of a step.
pub fn normalize(x: &mut [f64], sum: f64) {
    let (factor, least) = (1.0 / sum, f64::MIN_POSITIVE * sum);
    // Selected before the product: no quotient below the normal doubles is ever computed.
    x.iter_mut().for_each(|x| *x = if *x >= least { *x } else { 0.0 } * factor);
}
