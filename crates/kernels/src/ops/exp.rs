//! Exponentials of many numbers.
//!
//! e^x = 2^n e^r with n = round(x / ln 2), so that |r| ≤ ln 2 / 2, and e^r by its series up to
//! r^13, with a remainder below 5e-18. All instruction sets give the same bits.

use super::batch::{PackedRange, flags};
use super::forward::{Valid, within};
use crate::limits::TINY;
use crate::simd::{Eight, LANES, Simd, kernels, row_block, store};
use crate::vector::Packed;

/// 1.5 · 2^52: at this size the last bit of a double is worth 1, so adding it rounds to an integer.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts. Products of the first with integers up to 2^11 are exact.
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
/// Below this, e^x is less than the least normal double.
const LEAST: f64 = -708.0;

kernels! {
    /// Replaces numbers of at most 0 by their exponentials, to two units in the last place; 0 below
    /// e^−708, and NaN for NaN.
    pub fn exp_in_place = exp_all<'a>(x: &'a mut [f64]) -> ();

    /// Replaces logarithms, in the lanes that have them, by their exponentials relative to the
    /// largest of the lane, and updates the range. Returns the largest logarithm, and 0 for the
    /// other lanes. The range of a lane is NaN if a logarithm is invalid, or all are −∞.
    pub fn batch_exp = exp_of_lanes<'a>(
        x: &'a mut [Packed], in_logs: [bool; LANES], range: &'a mut PackedRange,
    ) -> Eight;
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
fn exp_of_lanes<S: Simd>(
    s: S,
    x: &mut [Packed],
    in_logs: [bool; LANES],
    range: &mut PackedRange,
) -> Eight {
    let (zero, none) = (s.splat(0.0), s.splat(f64::NEG_INFINITY));
    let bounds = Valid::Logs.bounds(s);
    let mask = s.lt(zero, s.load(&in_logs.map(|flag| f64::from(u8::from(flag)))));
    // The running value comes second: `max` returns it if the other value is NaN.
    let largest = x.iter().fold(none, |largest, x| s.max(s.load(x), largest));
    let (mut tiny, mut valid) = (s.lt(zero, zero), s.lt(none, largest));
    for x in x {
        let value = s.load(x);
        valid = s.and(valid, within(s, value, bounds));
        let below = s.sub(value, largest);
        let power = exp_lanes(s, below);
        // This includes what the exponential has rounded to 0.
        tiny = s.or(tiny, s.and(s.lt(power, s.splat(TINY)), s.lt(none, below)));
        s.store(s.select(mask, power, value), x);
    }
    let one = s.select(valid, s.splat(1.0), s.splat(f64::NAN));
    s.store(s.select(mask, zero, s.load(&range.least)), &mut range.least);
    s.store(s.select(mask, one, s.load(&range.largest)), &mut range.largest);
    let tiny = flags(s.bits(tiny));
    for l in 0..LANES {
        range.tiny[l] = if in_logs[l] { tiny[l] } else { range.tiny[l] };
    }
    s.to_array(s.select(mask, largest, zero))
}

#[inline(always)]
fn exp_lanes<S: Simd>(s: S, x: S::V) -> S::V {
    let (one, round) = (s.splat(1.0), s.splat(ROUND));
    // Below `LEAST`, n would leave the exponents of normal doubles. NaN is not below, and stays.
    let least = s.splat(LEAST);
    let is_least = s.lt(x, least);
    let x = s.select(is_least, least, x);
    let sum = s.add(s.mul(x, s.splat(std::f64::consts::LOG2_E)), round);
    let n = s.sub(sum, round);
    let r = s.sub(s.sub(x, s.mul(n, s.splat(LN_2[0]))), s.mul(n, s.splat(LN_2[1])));
    // By pairs of terms, as in Estrin's scheme: few numbers are computed at a time, so latency
    // counts.
    let square = s.mul(r, r);
    let fourth = s.mul(square, square);
    let [low, middle, high] =
        [cubic(s, 0, r, square), cubic(s, 4, r, square), cubic(s, 8, r, square)];
    let series = s.add(low, s.mul(fourth, s.add(middle, s.mul(fourth, high))));
    // 1 + r + r² (…): the small parts first.
    let power = s.add(one, s.add(r, s.mul(square, series)));
    s.select(is_least, s.splat(0.0), s.mul(power, s.power_of_two(sum)))
}

/// Four consecutive terms of the series.
#[inline(always)]
fn cubic<S: Simd>(s: S, k: usize, r: S::V, square: S::V) -> S::V {
    let term = [SERIES[k], SERIES[k + 1], SERIES[k + 2], SERIES[k + 3]];
    let low = s.add(s.splat(term[0]), s.mul(r, s.splat(term[1])));
    s.add(low, s.mul(square, s.add(s.splat(term[2]), s.mul(r, s.splat(term[3])))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::pack;

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

    /// Lanes with logarithms and without, one with a NaN, one that rules all out, and one of a range
    /// that is beyond doubles.
    #[test]
    fn lanes_have_the_exponentials_beside_their_largest() {
        let ruled_out = f64::NEG_INFINITY;
        let rows = [
            [-3.0, 0.5, ruled_out],
            [0.25, 1e-300, 7.0],
            [700.0, 699.0, 690.5],
            [f64::NAN, 1.0, 2.0],
            [ruled_out; 3],
            [f64::INFINITY, 1.0, 2.0],
            [0.0, -630.0, -1.0],
            [0.0, -800.0, -1.0],
        ];
        let in_logs = [true, false, true, true, true, true, true, true];
        let mut x = [Packed::default(); 3];
        let mut range = pack(rows.each_ref().map(|row| &row[..]), &mut x);
        let largest = batch_exp(&mut x, in_logs, &mut range);
        assert_eq!(largest[..3], [0.5, 0.0, 700.0]);
        assert_eq!(range.least[..3], [0.0, 1e-300, 0.0]);
        assert_eq!(range.largest[..3], [1.0, 7.0, 1.0]);
        assert_eq!(range.tiny, [false, true, false, false, false, false, true, true]);
        for (l, row) in rows.iter().enumerate().filter(|(l, _)| ![3, 4, 5].contains(l)) {
            for (x, log) in x.iter().zip(row) {
                let expected = if in_logs[l] { (log - largest[l]).exp() } else { *log };
                assert!((x[l] - expected).abs() <= 4.5e-16 * expected, "{l}: {} {expected}", x[l]);
            }
        }
        assert!(range.largest[3..6].iter().all(|largest| largest.is_nan()));
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
