//! Expectations over counts, of which there may be many.

use super::poisson::MOST;
use super::univariate::Univariate;
use crate::Tails;

/// Log probability below which counts above the mean do not matter.
const LEAST: f64 = -100.0;

/// Expectations of functions of a count, for a distribution with one mode or none, its mean and
/// scales of its middle and of its tail (in which it falls by a factor of e).
///
/// Counts from 0 to 256 are summed one by one. Others are in blocks that are small against the
/// count and the scales. Three numbers in each, which need not be whole, stand for all: Gauss's
/// quadrature for so many counts, exact for polynomials up to degree five. Takes some thousand
/// evaluations.
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
    let mut y = (mean - 40.0 * scales[0]).floor().max(0.0);
    while y <= MOST {
        let length = widest.min(y / 32.0).floor();
        let log = if y < 256.0 || length < 4.0 {
            y += 1.0;
            add(y - 1.0, 1.0)
        } else {
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

/// Tails of any number in a distribution of counts, from the probabilities of up to so many counts
/// and of more.
pub(super) fn tails<F: Univariate>(y: f64, of: &F, sides: impl Fn(f64) -> [f64; 2]) -> Tails {
    if y < 0.0 {
        return Tails::between([0.0, 1.0]);
    }
    if y == f64::INFINITY {
        return Tails::between([1.0, 0.0]);
    }
    let count = y.floor();
    match F::point(y).map(|y| of.log_density(&y).exp()) {
        Some(at) => {
            let below = if count == 0.0 { 0.0 } else { sides(count - 1.0)[0] };
            Tails { below, at, above: sides(count)[1] }
        }
        None => Tails::between(sides(count)),
    }
}
