//! Products in logarithms, for numbers beyond the range of a double (guide, section 2, "The product
//! in logarithms").
//!
//! Numbers within 600 nats of each other are exact in one linear product of doubles, so that x is
//! cut into bands of that width, from the top down, and the logarithms of their products are added.

use super::buffers;
use wayfix_kernels::limits::LIFT;
use wayfix_kernels::{exp_in_place, log2};

/// Largest entry of a step with evidence that is taken in linear space.
pub const LARGEST_LINEAR_ENTRY: f64 = 1e300;

/// Width of a band, in nats: the smallest number of a band, lifted, times the smallest entry is
/// still a normal double (2^-866 · 2^1000 · 2^-1022 = 2^-888).
const BAND: f64 = 600.0;

/// Largest logarithm of a double, and so of an entry.
const LN_MAX: f64 = 709.8;

/// A number this many nats below a sum is less than half of the sum's last digit.
const DIGITS: f64 = 40.0;

/// Computes a product in logarithms by a linear one for each band of numbers of similar size.
pub fn by_bands(x: &[f64], out: &mut [f64], product: impl FnMut(&[f64], &mut [f64])) {
    bands(x, out, (usize::MAX, LN_MAX), product);
}

/// Computes a product in logarithms for a dense matrix, whose entries are at most about 1: by a few
/// bands, then line by line where these are not enough. (Where lines are short, a band costs more
/// than all of their sums.)
pub fn by_lines<I: Iterator<Item = (usize, f64)> + Clone>(
    x: &[f64],
    out: &mut [f64],
    product: impl FnMut(&[f64], &mut [f64]),
    line: impl Fn(usize) -> I,
) {
    let rest = bands(x, out, (3, 1.0), product);
    for (i, out) in out.iter_mut().enumerate().filter(|(_, out)| **out < rest) {
        *out = sum(line(i), x);
    }
}

/// Adds up the products of at most `most` bands, for entries whose logarithms are at most
/// `highest`. Returns a logarithm: sums that reach it are exact, the others lack what is left of x;
/// −∞ if nothing is left that matters.
fn bands(
    x: &[f64],
    out: &mut [f64],
    (most, highest): (usize, f64),
    mut product: impl FnMut(&[f64], &mut [f64]),
) -> f64 {
    out.fill(f64::NEG_INFINITY);
    // The remaining numbers are at most e^next, and add at most n e^(highest + next) to a sum. That
    // is beyond the digits of a sum of at least e^(next + settled_margin).
    let settled_margin = highest + (x.len() as f64).ln() + DIGITS;
    buffers::with_two(x.len(), |band, sums| {
        let mut top = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for _ in 0..most {
            if !top.is_finite() {
                break;
            }
            let mut next = f64::NEG_INFINITY;
            for (out, &log) in band.iter_mut().zip(x) {
                // Beyond 1e19, neighbouring doubles are farther apart than a band: without the
                // first test, top would be below itself. A NaN is in every band.
                let below = log < top && log <= top - BAND;
                *out = if below || log > top { f64::NEG_INFINITY } else { log - top };
                if below {
                    next = next.max(log);
                }
            }
            exp_in_place(band);
            band.iter_mut().for_each(|x| *x *= LIFT);
            product(band, sums);
            let too_large = sums.contains(&f64::INFINITY);
            for (out, sum) in out.iter_mut().zip(&*sums).filter(|out| *out.1 != f64::INFINITY) {
                // The logarithm of a sum near 1 has more digits than that of the lifted one.
                let low = *sum / LIFT;
                let log = if low >= f64::MIN_POSITIVE { low.ln() } else { sum.ln() - LIFT.ln() };
                *out = add(*out, log + top);
            }
            if too_large {
                // Evidence on moves may have entries far above 1: sums that overflow are computed
                // again, without the lift and lowered by 2^32, more than the number of terms.
                let large: Vec<bool> = sums.iter().map(|sum| *sum == f64::INFINITY).collect();
                band.iter_mut().for_each(|x| *x = *x / LIFT / 4_294_967_296.0);
                product(band, sums);
                let above = top + 4_294_967_296_f64.ln();
                let outs = out.iter_mut().zip(&*sums).zip(large).filter(|out| out.1);
                outs.for_each(|((out, sum), _)| *out = add(*out, sum.ln() + above));
            }
            // Settled: what is left changes no sum. False for a NaN, so all bands are taken.
            if out.iter().all(|out| *out >= next + settled_margin) {
                return f64::NEG_INFINITY;
            }
            top = next;
        }
        top + settled_margin
    })
}

/// Natural logarithm of Σ `value` exp(`x[index]`) over entries (index, value): an element of a
/// product in logarithms. −∞ without entries.
pub fn sum(entries: impl Iterator<Item = (usize, f64)> + Clone, x: &[f64]) -> f64 {
    let largest = entries.clone().map(|(j, _)| x[j]).fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    // log-sum-exp around the largest x. A term that underflows is below 1e-307, which is nothing
    // next to a sum of 1e-130. A smaller sum means that all large x have tiny entries: then terms
    // are added one by one, each with its own logarithm.
    let near = entries.clone().map(|(j, value)| value * (x[j] - largest).exp()).sum::<f64>();
    if near >= 1e-130 {
        return largest + near.ln();
    }
    entries.fold(f64::NEG_INFINITY, |sum, (j, value)| add(sum, value.ln() + x[j]))
}

/// Natural logarithm of e^a + e^b; NaN if one of them is.
#[must_use]
pub fn add(a: f64, b: f64) -> f64 {
    // A NaN in a fails the comparison and becomes `low`; in b it becomes `high`. Both propagate.
    let (high, low) = if a > b { (a, b) } else { (b, a) };
    // −∞ − (−∞) would be NaN.
    if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

/// Base-2 logarithm of 2^a + 2^b, rounded to a multiple of 2^-45 as scores of decoders are.
#[must_use]
pub fn add_log2(a: f64, b: f64) -> f64 {
    let (high, low) = if a > b { (a, b) } else { (b, a) };
    if low == f64::NEG_INFINITY { high } else { high + log2(1.0 + (low - high).exp2()) }
}
