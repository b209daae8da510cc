//! Random draws from finite distributions.

use rand::{Rng, RngExt};

/// Draws an index with probability proportional to its weight. The weights sum to `total` up to
/// rounding; an index of weight 0 is not drawn (unless all are 0).
pub fn index<R: Rng + ?Sized>(
    weights: impl Iterator<Item = (usize, f64)>,
    total: f64,
    rng: &mut R,
) -> usize {
    // Inversion: the first index at which the running sum exceeds a uniform number. `last` is the
    // answer if rounding leaves the sum below it, and is never an index of weight 0.
    let mut left = rng.random::<f64>() * total;
    let mut last = 0;
    for (index, weight) in weights {
        if weight > 0.0 {
            last = index;
            left -= weight;
            if left < 0.0 {
                break;
            }
        }
    }
    last
}
