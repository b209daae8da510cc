//! Exponentials of many numbers.
//!
//! e^x = 2^n e^r with n = round(x / ln 2), so that |r| ≤ ln 2 / 2, and e^r by its series up to
//! r^13, whose rest is below 5e-18. The same to the bit with any instructions.

use crate::kernels::simd::{LANES, Simd, kernels, row_block, store};

/// 1.5 · 2^52: beside it the last bit of a double is 1, so that adding it rounds to an integer.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts, of which products of the first with integers up to 2^11 are exact.
const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
/// 1/2!, 1/3!, …, 1/13!.
const SERIES: [f64; 12] = {
    let (mut series, mut factorial, mut k) = ([0.0; 12], 1.0, 0);
    while k < 12 {
        factorial *= (k + 2) as f64;
        series[k] = 1.0 / factorial;
        k += 1;
    }
    series
};
/// Below it e^x is less than the least normal double.
const LEAST: f64 = -708.0;

kernels! {
    /// Replaces numbers of at most 0 by their exponentials, to two units in the last place; 0 below
    /// e^−708, and NaN for NaN.
    pub(crate) fn exp_in_place = exp_all<'a>(x: &'a mut [f64]) -> ();
}

#[inline(always)]
fn exp_all<S: Simd>(s: S, x: &mut [f64]) {
    let blocks = x.len().div_ceil(LANES);
    let mut x = x.as_chunks_mut::<LANES>();
    for block in 0..blocks {
        let power = exp_lanes(s, row_block(s, (x.0, x.1), block));
        store(s, &mut x, block, power);
    }
}

#[inline(always)]
fn exp_lanes<S: Simd>(s: S, x: S::V) -> S::V {
    let (one, round) = (s.splat(1.0), s.splat(ROUND));
    // Far below, n would leave the exponents of normal doubles. NaN is not below, and stays.
    let least = s.splat(LEAST);
    let is_least = s.lt(x, least);
    let x = s.select(is_least, least, x);
    let sum = s.add(s.mul(x, s.splat(std::f64::consts::LOG2_E)), round);
    let n = s.sub(sum, round);
    let r = s.sub(s.sub(x, s.mul(n, s.splat(LN_2[0]))), s.mul(n, s.splat(LN_2[1])));
    // By pairs of terms, as Estrin does: few numbers at a time, so that what counts is how soon one
    // result follows another.
    let square = s.mul(r, r);
    let fourth = s.mul(square, square);
    let [low, middle, high] =
        [cubic(s, 0, r, square), cubic(s, 4, r, square), cubic(s, 8, r, square)];
    let series = s.add(low, s.mul(fourth, s.add(middle, s.mul(fourth, high))));
    // 1 + r + r² (…): the small parts first.
    let power = s.add(one, s.add(r, s.mul(square, series)));
    s.select(is_least, s.splat(0.0), s.mul(power, s.power_of_two(sum)))
}

/// Four terms of the series from one on.
#[inline(always)]
fn cubic<S: Simd>(s: S, k: usize, r: S::V, square: S::V) -> S::V {
    let term = [SERIES[k], SERIES[k + 1], SERIES[k + 2], SERIES[k + 3]];
    let low = s.add(s.splat(term[0]), s.mul(r, s.splat(term[1])));
    s.add(low, s.mul(square, s.add(s.splat(term[2]), s.mul(r, s.splat(term[3])))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_those_of_the_platform() {
        let numbers: Vec<f64> =
            (0..2_000_000).map(|k| -f64::from(k) * 3.53e-4 - 1e-9 * f64::from(k % 7)).collect();
        let mut powers = numbers.clone();
        exp_in_place(&mut powers);
        let off = numbers.iter().zip(powers).map(|(x, power)| (power / x.exp() - 1.0).abs());
        let worst = off.fold(0.0, f64::max);
        assert!(worst < 4.5e-16, "{worst:e}");
    }

    #[test]
    fn the_ends_are_exact() {
        let mut values = [0.0, -0.0, -f64::MIN_POSITIVE, -708.0, -708.1, -1e300, f64::NEG_INFINITY];
        exp_in_place(&mut values);
        assert_eq!(values[..3], [1.0; 3]);
        assert!((values[3] / (-708.0_f64).exp() - 1.0).abs() < 4.5e-16);
        assert_eq!(values[4..], [0.0; 3]);
        let mut values = [f64::NAN, -1.0];
        exp_in_place(&mut values);
        assert!(values[0].is_nan() && (values[1] * std::f64::consts::E - 1.0).abs() < 4.5e-16);
    }
}
