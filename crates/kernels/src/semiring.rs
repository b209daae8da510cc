//! The two semirings of inference: sums of products for filters and smoothers, maxima of sums
//! (with the state that attains them) for decoders (formulas 2 and 3, and 7, of the guide). Products
//! with sparse matrices, of batches and of segments are written once, for either.
//!
//! If several states attain a maximum, the lowest is kept, whatever the order of the entries.

use crate::limits::{LEAST_IN_CHAIN, LEAST_SCORE, MIDDLE_RANGE, power};
use crate::simd::Simd;

/// Exponent of the power of two that a rescaling takes out at a time.
const SHIFT: i64 = 64;

/// Rounds numbers below 2^51 to whole numbers.
#[inline(always)]
fn round<S: Simd>(s: S, x: S::V) -> S::V {
    // Adding 1.5 · 2^52 leaves no room for a fraction, whatever the sign; the subtraction is exact.
    let whole = s.splat(1.5 * (1_u64 << 52) as f64);
    s.sub(s.add(x, whole), whole)
}

/// Semiring, in lanes.
pub trait Semiring: Copy {
    /// Neutral elements of sums and of products.
    const ZERO: f64;
    const ONE: f64;

    fn times<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V;
    fn plus<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V;

    /// True if all values between these bounds are in the middle range, as they usually are.
    fn is_near<S: Simd>(self, s: S, least: S::V, largest: S::V) -> bool;

    /// Brings vectors back to the middle range, and adds the scales taken out to their exponents.
    /// Returns false if values of a vector are too far apart.
    fn rescale<S: Simd>(self, s: S, x: &mut [S::V], exponents: &mut S::V) -> bool;
}

/// Sums of products.
#[derive(Debug, Clone, Copy)]
pub struct SumProduct;

impl Semiring for SumProduct {
    const ZERO: f64 = 0.0;
    const ONE: f64 = 1.0;

    #[inline(always)]
    fn times<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V {
        s.mul(a, b)
    }

    #[inline(always)]
    fn plus<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V {
        s.add(a, b)
    }

    #[inline(always)]
    fn is_near<S: Simd>(self, s: S, least: S::V, largest: S::V) -> bool {
        let (low, high) = (s.splat(MIDDLE_RANGE[0]), s.splat(MIDDLE_RANGE[1]));
        !s.any(s.or(s.lt(least, low), s.lt(high, largest)))
    }

    /// By powers of two, which is exact.
    #[inline(always)]
    fn rescale<S: Simd>(self, s: S, x: &mut [S::V], exponents: &mut S::V) -> bool {
        let mut largest = x[0];
        for x in &x[1..] {
            largest = s.max(*x, largest);
        }
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let (low, high) = (s.splat(MIDDLE_RANGE[0]), s.splat(MIDDLE_RANGE[1]));
        // Each round scales by 2^64. The middle range is 2^80 wide, so a round cannot jump over it.
        // One is usually enough, as ranges are checked every four steps of the recursion.
        loop {
            // A vector of zeros has no scale, and stays.
            let up = s.and(s.lt(largest, low), s.lt(zero, largest));
            let down = s.lt(high, largest);
            if !s.any(s.or(up, down)) {
                break;
            }
            let factor =
                s.select(up, s.splat(power(SHIFT)), s.select(down, s.splat(power(-SHIFT)), one));
            let shift = s.splat(SHIFT as f64);
            *exponents = s.add(*exponents, s.select(down, shift, zero));
            *exponents = s.sub(*exponents, s.select(up, shift, zero));
            // Exact, as the largest value is in the middle range afterwards; small ones are
            // checked.
            largest = s.mul(largest, factor);
            for x in &mut *x {
                *x = s.mul(*x, factor);
            }
        }
        // An empty mask: 0 is below 0 in no lane.
        let mut lost = s.lt(zero, zero);
        for &x in &*x {
            lost = s.or(lost, s.is_small(x, LEAST_IN_CHAIN));
        }
        !s.any(lost)
    }
}

/// Maxima of sums, each with the lowest index that attains it.
#[derive(Debug, Clone, Copy)]
pub struct MaxPlus;

impl Semiring for MaxPlus {
    const ZERO: f64 = f64::NEG_INFINITY;
    const ONE: f64 = 0.0;

    #[inline(always)]
    fn times<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V {
        s.add(a, b)
    }

    #[inline(always)]
    fn plus<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V {
        s.max(a, b)
    }

    #[inline(always)]
    fn is_near<S: Simd>(self, _: S, _: S::V, _: S::V) -> bool {
        false // scores fall at every step
    }

    /// By whole numbers, which is exact.
    #[inline(always)]
    fn rescale<S: Simd>(self, s: S, x: &mut [S::V], exponents: &mut S::V) -> bool {
        let (none, zero) = (s.splat(f64::NEG_INFINITY), s.splat(0.0));
        let mut largest = x[0];
        for x in &x[1..] {
            largest = s.max(*x, largest);
        }
        // A lane where nothing is possible stays as it is: −∞ less −∞ would be NaN.
        let whole = s.select(s.lt(none, largest), round(s, largest), zero);
        *exponents = s.add(*exponents, whole);
        let mut lost = s.lt(zero, zero);
        for x in x {
            // Exact above -256, on the grid; what is below -50 is reported.
            *x = s.sub(*x, whole);
            lost = s.or(lost, s.and(s.lt(*x, s.splat(LEAST_SCORE)), s.lt(none, *x)));
        }
        !s.any(lost)
    }
}
