//! Loops over vectors that more than one routine needs.
//!
//! Sums run in eight lanes: the compiler can then use vector registers, and
//! the order of the additions, so the result to the bit, is the same whatever
//! instructions a machine has. (Logarithms and exponentials are those of the platform.)
//!
//! All unsafe code is here: instructions in `lanes`, indices that have been checked
//! before in `sliced::walk`, and a system call in `pages`.

mod abreast;
mod aligned;
mod blocks;
mod combine;
mod dense;
mod dense_max;
mod lanes;
mod largest;
pub(crate) mod lockstep;
pub(crate) mod lockstep_max;
mod max;
mod pages;
mod product;
mod retreat;
pub(crate) mod segments;
pub(crate) mod segments_filter;
pub(crate) mod segments_smooth;
mod sliced;
pub(crate) mod survey;
mod update;
mod value;

#[cfg(test)]
mod every_instruction_set;

pub(crate) use aligned::Aligned;
pub(crate) use combine::{add_combined, combine};
pub(crate) use dense::Dense;
pub(crate) use dense_max::DenseLogs;
pub(crate) use lanes::{Eight, Kernel, LANES, Lanes, run};
pub(crate) use largest::{LARGEST_LOG, Valid, largest};
pub(crate) use max::{Maximize, Shifted, add_scores, log2_of_logs, maximize};
pub(crate) use pages::in_large_pages;
pub(crate) use product::{Made, Sparse};
pub(crate) use retreat::{BACK_LIFT, Retreat, retreat, weigh};
pub(crate) use sliced::{Sliced, Values};
pub(crate) use update::{TINY, Update, Updated, Watch, any_tiny, settle, settle_and_lift, update};
pub(crate) use value::Width;

pub(crate) use crate::range::LIFT;

/// Adds up the lanes.
#[inline]
fn total(lanes: [f64; LANES]) -> f64 {
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// Σ xᵢ.
pub(crate) fn sum(x: &[f64]) -> f64 {
    let (chunks, rest) = x.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for chunk in chunks {
        for l in 0..LANES {
            lanes[l] += chunk[l];
        }
    }
    total(lanes) + rest.iter().sum::<f64>()
}

/// Σ xᵢ yᵢ.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let ((xs, x_rest), (ys, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for (x, y) in xs.iter().zip(ys) {
        for l in 0..LANES {
            lanes[l] += x[l] * y[l];
        }
    }
    total(lanes) + x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum::<f64>()
}

/// `out = x` times [`LIFT`].
pub(crate) fn lift(x: &[f64], out: &mut [f64]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out = x * LIFT);
}

/// `x /= sum`, where `sum` is that of x: makes it a distribution.
///
/// What would be below the smallest normal double becomes 0: the far tails of
/// a Gaussian sensor alone would double the time of a step.
pub(crate) fn normalize(x: &mut [f64], sum: f64) {
    let (factor, least) = (1.0 / sum, f64::MIN_POSITIVE * sum);
    x.iter_mut().for_each(|x| *x = if *x >= least { *x } else { 0.0 } * factor);
}

/// Rounds to a multiple of 2^-45, which doubles of 128 and more are anyway.
///
/// Sums of such numbers up to 256 are exact, so that their order does not
/// matter: paths with the same factors tie to the bit. The error, 1e-14, is
/// that of a double of this size.
#[inline]
pub(crate) fn on_grid(x: f64) -> f64 {
    if x.abs() < GRID_RANGE {
        // What is added and taken away again leaves no room for a fraction.
        let shift = INTEGERS.copysign(x);
        (x * GRID_STEPS + shift - shift) / GRID_STEPS
    } else {
        x
    }
}

/// How many steps of the grid there are to 1.
const GRID_STEPS: f64 = (1_u64 << 45) as f64;
/// From here on doubles are on the grid.
const GRID_RANGE: f64 = 128.0;
/// 2^52: from here on doubles are whole numbers.
const INTEGERS: f64 = (1_u64 << 52) as f64;

/// log2 on the grid of [`on_grid`]; doubling adds exactly 1. NaN for what is
/// no probability.
pub(crate) fn log2(x: f64) -> f64 {
    const TINY: f64 = f64::MIN_POSITIVE;
    const LIFT: f64 = (1_u64 << 54) as f64;
    if x == 0.0 {
        return f64::NEG_INFINITY;
    }
    if !(x > 0.0 && x.is_finite()) {
        return f64::NAN;
    }
    let (x, lift) = if x < TINY { (x * LIFT, 54.0) } else { (x, 0.0) };
    let exponent = (x.to_bits() >> 52) as f64 - 1023.0;
    let mantissa = f64::from_bits(x.to_bits() & (u64::MAX >> 12) | 1.0_f64.to_bits());
    on_grid(mantissa.log2()) + exponent - lift
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log2_is_right_and_adds_one_for_a_doubling() {
        assert_eq!(log2(0.0), f64::NEG_INFINITY);
        assert!([-1.0, f64::NAN, f64::INFINITY].iter().all(|&x| log2(x).is_nan()));
        let steps = (1_u64 << 45) as f64;
        let on_grid = |x: f64| (x * steps).fract() == 0.0;
        assert!((1..20_000).all(|i| on_grid(super::on_grid(f64::from(i) * -0.013_7))));
        for x in [1.0, 0.75, 0.1, 1.0 / 3.0, 1.999_999, 1e-300, 5e-324, f64::MAX] {
            assert!((log2(x) - x.log2()).abs() <= 2e-14 + x.log2().abs() * 1e-15, "{x}");
            for halvings in 1..60 {
                let halved = x * 0.5_f64.powi(halvings);
                if halved.is_normal() {
                    assert_eq!(log2(halved), log2(x) - f64::from(halvings), "{halved}");
                }
            }
        }
    }

    #[test]
    fn every_length_is_handled_to_its_last_element() {
        for n in 0..40_usize {
            let x: Vec<f64> = (1..=n).map(|i| i as f64).collect();
            let y = vec![2.0; n];
            let expected = (n * (n + 1) / 2) as f64;
            assert_eq!(sum(&x), expected);
            assert_eq!(dot(&x, &y), 2.0 * expected);
            assert_eq!(largest(&x, Valid::Likelihoods), Ok(n as f64));
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e-300] {
                for at in 0..n {
                    let mut x = x.clone();
                    x[at] = bad;
                    assert_eq!(largest(&x, Valid::Likelihoods), Err(at), "{bad} at {at} of {n}");
                    let logs = if bad == f64::NEG_INFINITY || bad == -1e-300 {
                        Ok(x.iter().copied().fold(f64::NEG_INFINITY, f64::max))
                    } else {
                        Err(at)
                    };
                    assert_eq!(largest(&x, Valid::Logs), logs, "{bad} at {at} of {n}");
                }
            }
        }
    }
}
