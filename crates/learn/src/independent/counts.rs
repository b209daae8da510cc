//! Expectations over counts, also where far too many have a probability to sum over them all.

use super::poisson::MOST;
use super::univariate::Univariate;
use crate::Tails;

/// Log probability below which counts above the mean are negligible.
const LEAST: f64 = -100.0;

/// Expectations of functions of a count under a unimodal or falling distribution with this mean.
/// `scales` are the widths of its middle and of its tail, over which it falls by a factor of e.
///
/// Counts below 256 are summed one by one, larger ones in blocks that are small relative to the
/// count and the scales. Three numbers stand for a block, not necessarily whole ones: Gaussian
/// quadrature for a sum over consecutive integers, exact for polynomials up to degree five. Takes
/// some thousand evaluations.
pub(super) fn expectation<const N: usize>(
    mean: f64,
    scales: [f64; 2],
    log_probability: impl Fn(f64) -> f64,
    values: impl Fn(f64) -> [f64; N],
) -> [f64; N] {
    let mut sums = [0.0; N];
    let mut add = |y: f64, weight: f64| {
        let log = log_probability(y);
        if log > LEAST {
            let weight = weight * log.exp();
            sums.iter_mut().zip(values(y)).for_each(|(sum, value)| *sum += weight * value);
        }
        log
    };
    let widest = scales[0].max(scales[1]) / 16.0;
    // Below 40 deviations under the mean nothing is left; the loop ends where the tail is
    // negligible.
    let mut y = (mean - 40.0 * scales[0]).floor().max(0.0);
    while y <= MOST {
        let length = widest.min(y / 32.0).floor();
        let log = if y < 256.0 || length < 4.0 {
            y += 1.0;
            add(y - 1.0, 1.0)
        } else {
            // The nodes of the Gram polynomial of degree 3 for L consecutive integers are the
            // middle and √((3 L² − 7) / 20) on either side; the weights give the variance
            // (L² − 1) / 12.
            let (middle, square) = (y + 0.5 * (length - 1.0), length * length);
            let node = ((3.0 * square - 7.0) / 20.0).sqrt();
            let share = (square - 1.0) / (24.0 * node * node);
            y += length;
            add(middle - node, share * length);
            add(middle, (1.0 - 2.0 * share) * length);
            add(middle + node, share * length)
        };
        if log <= LEAST && y > mean {
            break;
        }
    }
    sums
}

/// Tails of any number in a distribution of counts, where `sides` returns P(Y ≤ y) and P(Y > y) of
/// a count y.
pub(super) fn tails<F: Univariate>(y: f64, of: &F, sides: impl Fn(f64) -> [f64; 2]) -> Tails {
    if y < 0.0 {
        return Tails::between([0.0, 1.0]);
    }
    if y == f64::INFINITY {
        return Tails::between([1.0, 0.0]);
    }
    // Below a count is P(Y ≤ y − 1); between two counts there is nothing at y itself.
    let count = y.floor();
    match F::point(y).map(|y| of.log_density(&y).exp()) {
        Some(at) => {
            let below = if count == 0.0 { 0.0 } else { sides(count - 1.0)[0] };
            Tails { below, at, above: sides(count)[1] }
        }
        None => Tails::between(sides(count)),
    }
}
