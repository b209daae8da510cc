//! Loops of the [`Standardizer`](super::Standardizer).

use super::rows::scaled;
use crate::kernels::{LANES, Simd, WithSimd};

/// Prior count, in queries, of a reference's prior moments: a mean of 0, and the deviation pooled
/// over all references.
pub(super) const PRIOR_COUNT: f64 = 10.0;

/// Adds a query's scores, in its own deviations, to the sums.
pub(super) struct CountIn<'a> {
    pub(super) distances: &'a [f32],
    pub(super) mean: f64,
    pub(super) unit: f64,
    pub(super) sums: &'a mut [f64],
    pub(super) squares: &'a mut [f64],
    pub(super) out: &'a mut [f64],
}

impl WithSimd for CountIn<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { distances, mean, unit, sums, squares, out } = self;
        let sums = sums.iter_mut().zip(squares);
        for (((sum, square), out), &d) in sums.zip(out).zip(distances) {
            let score = scaled(f64::from(d) - mean, unit);
            *out = score;
            // References at an infinite distance were not compared; they count as average.
            let score = if d.is_finite() { score } else { 0.0 };
            *sum += score;
            *square += score * score;
        }
    }
}

/// Scales scores by the mean and deviation of each reference over other queries.
pub(super) struct Standardize<'a> {
    pub(super) count: f64,
    pub(super) sums: &'a [f64],
    pub(super) squares: &'a [f64],
    pub(super) scores: &'a mut [f64],
}

impl WithSimd for Standardize<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { count: n, sums, squares, scores } = self;
        let known = n + PRIOR_COUNT;
        let part = 1.0 / known;
        // About the mean, without the prior.
        let about = |sum: f64, square: f64| {
            let mean = sum * part;
            (square - 2.0 * mean * sum + n * mean * mean).max(0.0)
        };
        let mut totals = [0.0; LANES];
        let (whole, rest) = (sums.as_chunks::<LANES>(), squares.as_chunks::<LANES>());
        for (sums, squares) in whole.0.iter().zip(rest.0) {
            for l in 0..LANES {
                totals[l] += about(sums[l], squares[l]);
            }
        }
        let mut total: f64 = totals.iter().sum();
        for (sum, square) in whole.1.iter().zip(rest.1) {
            total += about(*sum, *square);
        }
        // A deviation of 1 before any query.
        let pooled = (total / scores.len() as f64 + 1.0) / (n + 1.0);
        for (score, (&sum, &square)) in scores.iter_mut().zip(sums.iter().zip(squares)) {
            let variance = (about(sum, square) + PRIOR_COUNT * pooled) * part;
            // Seven digits are enough, and take a quarter of the time.
            let inverse = 1.0 / (variance as f32).sqrt();
            *score = (*score - sum * part) * f64::from(inverse);
        }
    }
}
