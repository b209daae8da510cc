//! The two semirings of inference: sums of products for filters and smoothers, maxima of sums
//! (with the state that attains them) for decoders. Products with sparse matrices, of batches and of
//! segments are written once, for either.

use crate::kernels::simd::{BlocksMut, Eight, LANES, Simd, store};
use crate::limits::{LEAST_IN_CHAIN, LEAST_SCORE, SCALES, power};

/// Power of two that is taken out of a scale at a time.
const SHIFT: i64 = 64;

/// Lanes above 0 and below a limit.
#[inline(always)]
pub(super) fn is_small<S: Simd>(s: S, v: S::V, limit: f64) -> S::M {
    s.and(s.lt(v, s.splat(limit)), s.lt(s.splat(0.0), v))
}

/// Rounds numbers below 2^51 to whole ones.
#[inline(always)]
fn round<S: Simd>(s: S, x: S::V) -> S::V {
    let whole = s.splat(1.5 * (1_u64 << 52) as f64);
    s.sub(s.add(x, whole), whole)
}

/// A semiring, in lanes.
pub(crate) trait Ring: Copy {
    /// Neutral elements of sums and of products.
    const ZERO: f64;
    const ONE: f64;

    fn times<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V;
    fn plus<S: Simd>(self, s: S, a: S::V, b: S::V) -> S::V;

    /// Returns true if all values between these are in the middle range, as most often.
    fn is_near<S: Simd>(self, s: S, least: S::V, largest: S::V) -> bool;

    /// Brings vectors back to a middle range, and adds what is taken out to their exponents.
    /// Returns false if values of a vector are too far apart.
    fn rescale<S: Simd>(self, s: S, x: &mut [S::V], exponents: &mut S::V) -> bool;
}

/// A semiring, as running sums over the entries of eight rows at a time.
///
/// The entries of a row come in ascending order of their indices, but in two runs.
pub(crate) trait Semiring<S: Simd>: Copy {
    /// Sums of eight rows.
    type Sum: Copy;
    /// Sum of one row.
    type Row: Copy;

    fn zero(self, s: S) -> Self::Sum;

    /// Adds an entry to each row: its value, that of x, and its index.
    fn add(self, s: S, sum: &mut Self::Sum, entry: S::V, x: S::V, index: S::I);

    /// Sums at the start of the second run.
    fn second(self, s: S, first: Self::Sum) -> Self::Sum;

    /// Sums over both runs.
    fn join(self, s: S, first: Self::Sum, second: Self::Sum) -> Self::Sum;

    fn to_rows(self, s: S, sum: Self::Sum) -> [Self::Row; LANES];
    fn join_rows(self, s: S, rows: [Self::Row; LANES]) -> Self::Sum;

    /// Adds an entry to one row, whatever the order.
    fn add_to_row(self, row: Self::Row, entry: f64, x: f64, index: u32) -> Self::Row;
}

/// Sums of products.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SumProduct;

impl Ring for SumProduct {
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
        let (low, high) = (s.splat(SCALES[0]), s.splat(SCALES[1]));
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
        let (low, high) = (s.splat(SCALES[0]), s.splat(SCALES[1]));
        loop {
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
            largest = s.mul(largest, factor);
            for x in &mut *x {
                *x = s.mul(*x, factor);
            }
        }
        let mut lost = s.lt(zero, zero);
        for &x in &*x {
            lost = s.or(lost, is_small(s, x, LEAST_IN_CHAIN));
        }
        !s.any(lost)
    }
}

impl<S: Simd> Semiring<S> for SumProduct {
    type Sum = S::V;
    type Row = f64;

    #[inline(always)]
    fn zero(self, s: S) -> S::V {
        s.splat(0.0)
    }

    #[inline(always)]
    fn add(self, s: S, sum: &mut S::V, entry: S::V, x: S::V, _: S::I) {
        *sum = s.add(*sum, s.mul(entry, x));
    }

    #[inline(always)]
    fn second(self, _: S, first: S::V) -> S::V {
        first
    }

    #[inline(always)]
    fn join(self, _: S, _: S::V, second: S::V) -> S::V {
        second
    }

    #[inline(always)]
    fn to_rows(self, s: S, sum: S::V) -> Eight {
        s.to_array(sum)
    }

    #[inline(always)]
    fn join_rows(self, s: S, rows: Eight) -> S::V {
        s.load(&rows)
    }

    #[inline(always)]
    fn add_to_row(self, row: f64, entry: f64, x: f64, _: u32) -> f64 {
        row + entry * x
    }
}

/// Maxima of sums, each with the lowest index that attains it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MaxPlus;

/// Maxima of eight rows, and their indices.
#[derive(Clone, Copy)]
pub(crate) struct Maxima<S: Simd> {
    pub(crate) value: S::V,
    pub(crate) index: S::I,
}

impl Ring for MaxPlus {
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
        // A column without a way stays as it is.
        let whole = s.select(s.lt(none, largest), round(s, largest), zero);
        *exponents = s.add(*exponents, whole);
        let mut lost = s.lt(zero, zero);
        for x in x {
            *x = s.sub(*x, whole);
            lost = s.or(lost, s.and(s.lt(*x, s.splat(LEAST_SCORE)), s.lt(none, *x)));
        }
        !s.any(lost)
    }
}

impl<S: Simd> Semiring<S> for MaxPlus {
    type Sum = Maxima<S>;
    type Row = (f64, u32);

    #[inline(always)]
    fn zero(self, s: S) -> Maxima<S> {
        Maxima { value: s.splat(f64::NEG_INFINITY), index: s.iota(0) }
    }

    /// The first of several entries that attain the maximum stays.
    #[inline(always)]
    fn add(self, s: S, sum: &mut Maxima<S>, entry: S::V, x: S::V, index: S::I) {
        let value = s.add(entry, x);
        let better = s.lt(sum.value, value);
        sum.value = s.max(value, sum.value);
        sum.index = s.select_index(better, index, sum.index);
    }

    #[inline(always)]
    fn second(self, s: S, _: Maxima<S>) -> Maxima<S> {
        self.zero(s)
    }

    #[inline(always)]
    fn join(self, s: S, first: Maxima<S>, second: Maxima<S>) -> Maxima<S> {
        let lower = s.lt_index(second.index, first.index);
        let tie = s.and(s.eq(second.value, first.value), lower);
        let better = s.or(s.lt(first.value, second.value), tie);
        Maxima {
            value: s.max(second.value, first.value),
            index: s.select_index(better, second.index, first.index),
        }
    }

    #[inline(always)]
    fn to_rows(self, s: S, sum: Maxima<S>) -> [(f64, u32); LANES] {
        let (values, mut indices) = (s.to_array(sum.value), [0; LANES]);
        s.store_indices(sum.index, &mut indices);
        let mut rows = [(0.0, 0); LANES];
        for l in 0..LANES {
            rows[l] = (values[l], indices[l]);
        }
        rows
    }

    #[inline(always)]
    fn join_rows(self, s: S, rows: [(f64, u32); LANES]) -> Maxima<S> {
        let (mut values, mut indices) = ([0.0; LANES], [0; LANES]);
        for l in 0..LANES {
            (values[l], indices[l]) = rows[l];
        }
        Maxima { value: s.load(&values), index: s.load_indices(&indices) }
    }

    #[inline(always)]
    fn add_to_row(self, row: (f64, u32), entry: f64, x: f64, index: u32) -> (f64, u32) {
        let value = entry + x;
        let better = value > row.0 || (value == row.0 && index < row.1);
        if better { (value, index) } else { row }
    }
}

/// Consumer of a product. (A closure might not become part of the function that may use the
/// instructions.)
pub(crate) trait Sink<S: Simd, T> {
    /// Takes the block of eight rows with this number; rows beyond the last have no entries.
    /// Implementations are `#[inline(always)]`.
    fn take(&mut self, s: S, block: usize, product: T);
}

impl<S: Simd> Sink<S, S::V> for BlocksMut<'_> {
    #[inline(always)]
    fn take(&mut self, s: S, block: usize, product: S::V) {
        store(s, self, block, product);
    }
}
