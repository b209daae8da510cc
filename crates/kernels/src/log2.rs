//! Logarithms to base 2, on a grid of 2^-45: sums of them up to 256 are exact, so that their order
//! does not matter, and paths with the same factors tie to the bit.

use std::f64::consts::LOG2_E;

use crate::limits::exponent;
use crate::simd::{LANES, Simd, kernels, row_block, store};

/// Number of steps of the grid to 1.
const GRID_STEPS: f64 = (1_u64 << 45) as f64;
/// Doubles of at least this size are on the grid.
const GRID_RANGE: f64 = 128.0;
/// 2^52: doubles of at least this size are whole numbers.
const INTEGERS: f64 = (1_u64 << 52) as f64;
/// Lift of numbers below the smallest normal double, and its logarithm.
const SUBNORMAL_LIFT: (f64, f64) = ((1_u64 << 54) as f64, 54.0);

/// Coefficients of ln((1 + t) / (1 − t)) = 2 (t + t³/3 + t⁵/5 + …), in log2, from the last: for
/// |t| ≤ 0.172 the remainder is below 1e-17.
const SERIES: [f64; 10] = {
    let mut series = [0.0; 10];
    let mut term = 0;
    while term < 10 {
        series[9 - term] = 2.0 * LOG2_E / (2 * term + 1) as f64;
        term += 1;
    }
    series
};

/// Rounds to a multiple of 2^-45, which doubles of 128 and more are anyway. The error, 1e-14, is
/// that of a double of this size.
#[inline]
pub fn on_grid(x: f64) -> f64 {
    if x.abs() < GRID_RANGE {
        // Adding and subtracting 2^52 leaves no room for a fraction.
        let shift = INTEGERS.copysign(x);
        (x * GRID_STEPS + shift - shift) / GRID_STEPS
    } else {
        x
    }
}

/// log2 on the grid of [`on_grid`], within 1.5e-14; doubling adds exactly 1. NaN for numbers that
/// are not finite or are negative.
pub fn log2(x: f64) -> f64 {
    if x == 0.0 {
        return f64::NEG_INFINITY;
    }
    // The negation also lets NaN fail.
    if !(x > 0.0 && x <= f64::MAX) {
        return f64::NAN;
    }
    let (x, lifted) =
        if x < f64::MIN_POSITIVE { (x * SUBNORMAL_LIFT.0, SUBNORMAL_LIFT.1) } else { (x, 0.0) };
    let mantissa = f64::from_bits(x.to_bits() & (u64::MAX >> 12) | 1.0_f64.to_bits());
    // Brings the mantissa to 0.707 … 1.414, where few terms of the series suffice.
    let high = mantissa > std::f64::consts::SQRT_2;
    let mantissa = if high { mantissa * 0.5 } else { mantissa };
    let exponent = exponent(x) as f64 + f64::from(u8::from(high)) - lifted;
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    let series = SERIES[1..].iter().fold(SERIES[0], |series, c| series * square + c);
    // Rounded before the exponent is added, so the logarithms of a number and its half differ by
    // exactly 1.
    on_grid(series * t) + exponent
}

kernels! {
    /// Replaces finite values of at least 0 by their [`log2`](fn@log2).
    pub fn log2_in_place = log2_all<'a>(x: &'a mut [f64]) -> ();

    /// Replaces natural logarithms of at most 0 by those to base 2, on the grid.
    pub fn ln_to_log2 = to_base_2<'a>(x: &'a mut [f64]) -> ();
}

#[inline(always)]
fn to_base_2<S: Simd>(s: S, x: &mut [f64]) {
    let blocks = x.len().div_ceil(LANES);
    let mut x = x.as_chunks_mut::<LANES>();
    for block in 0..blocks {
        let log2 = log2_over(s, row_block(s, (x.0, x.1), block), 0.0);
        store(s, &mut x, block, log2);
    }
}

#[inline(always)]
fn log2_all<S: Simd>(s: S, x: &mut [f64]) {
    let blocks = x.len().div_ceil(LANES);
    let mut x = x.as_chunks_mut::<LANES>();
    for block in 0..blocks {
        let log = log2_lanes(s, row_block(s, (x.0, x.1), block));
        store(s, &mut x, block, log);
    }
}

/// [`log2`] of finite values of at least 0, by the same operations.
#[inline(always)]
pub(crate) fn log2_lanes<S: Simd>(s: S, x: S::V) -> S::V {
    let (zero, one) = (s.splat(0.0), s.splat(1.0));
    let subnormal = s.lt(x, s.splat(f64::MIN_POSITIVE));
    // Zeros also compare below. One branch for all lanes: likelihoods without a zero or subnormal
    // skip three selects.
    let any_subnormal = s.any(subnormal);
    let (mut normal, mut lifted) = (x, zero);
    if any_subnormal {
        normal = s.select(subnormal, s.mul(x, s.splat(SUBNORMAL_LIFT.0)), x);
        lifted = s.select(subnormal, s.splat(SUBNORMAL_LIFT.1), zero);
    }
    // Now normal and positive, as `split_exponent` needs, or 0, whose result is replaced.
    let (exponent, mantissa) = s.split_exponent(normal);
    let high = s.lt(s.splat(std::f64::consts::SQRT_2), mantissa);
    let mantissa = s.select(high, s.mul(mantissa, s.splat(0.5)), mantissa);
    let exponent = s.sub(s.add(exponent, s.select(high, one, zero)), lifted);
    let t = s.div(s.sub(mantissa, one), s.add(mantissa, one));
    let square = s.mul(t, t);
    // Horner's rule, with a separate product and sum as in `log2`: a fused operation would round
    // differently.
    let mut series = s.splat(SERIES[0]);
    for coefficient in &SERIES[1..] {
        series = s.add(s.mul(series, square), s.splat(*coefficient));
    }
    // Adding 1.5 · 2^52 leaves no room for a fraction, whatever the sign.
    let whole = s.splat(1.5 * INTEGERS);
    let steps = s.mul(s.mul(series, t), s.splat(GRID_STEPS));
    let fraction = s.mul(s.sub(s.add(steps, whole), whole), s.splat(1.0 / GRID_STEPS));
    // Exact up to 256, as all sums on the grid.
    let log = s.add(fraction, exponent);
    if any_subnormal { s.select(s.eq(x, zero), s.splat(f64::NEG_INFINITY), log) } else { log }
}

/// Logarithms to base 2, on the grid, of likelihoods divided by the largest, from natural
/// logarithms of at most `largest`.
#[inline(always)]
pub(crate) fn log2_over<S: Simd>(s: S, logs: S::V, largest: f64) -> S::V {
    let x = s.mul(s.sub(logs, s.splat(largest)), s.splat(LOG2_E));
    // Rounds as `on_grid` does. x is never positive, so subtract 2^52: numbers of that size have no
    // fraction. Below the range x is on the grid already, or −∞, and stays.
    let (whole, steps) = (s.splat(INTEGERS), s.mul(x, s.splat(GRID_STEPS)));
    let rounded = s.mul(s.add(s.sub(steps, whole), whole), s.splat(1.0 / GRID_STEPS));
    s.select(s.lt(s.splat(-GRID_RANGE), x), rounded, x)
}
