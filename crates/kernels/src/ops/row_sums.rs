//! Sums over the entries of eight rows at a time, in either [semiring](super::semiring), and their
//! consumers.

use super::semiring::{MaxPlus, SumProduct};
use crate::simd::{BlocksMut, LANES, Simd, store};

/// Semiring, as running sums over the entries of eight rows at a time.
///
/// The entries of a row come in ascending order of their indices, but in two runs.
pub trait RowSums<S: Simd>: Copy {
    /// Sums of eight rows.
    type Sum: Copy;
    /// Sum of one row.
    type Row: Copy;
    /// Sums of G slices in memory, where each row can be accessed by itself.
    type Rows<const G: usize>;

    fn zero(self, s: S) -> Self::Sum;

    /// Adds an entry to each row: its value, the value of x, and its index, which is above those of
    /// earlier entries of the run.
    fn add(self, s: S, sum: &mut Self::Sum, entry: S::V, x: S::V, index: S::I);

    /// Adds an entry to each row, whatever the order of indices.
    #[inline(always)]
    fn add_unordered(self, s: S, sum: &mut Self::Sum, entry: S::V, x: S::V, index: S::I) {
        self.add(s, sum, entry, x, index);
    }

    /// Sums at the start of the second run.
    fn second(self, s: S, first: Self::Sum) -> Self::Sum;

    /// Sums over both runs.
    fn join(self, s: S, first: Self::Sum, second: Self::Sum) -> Self::Sum;

    /// Rows with any sums.
    fn rows<const G: usize>() -> Self::Rows<G>;
    fn to_rows(self, s: S, sum: Self::Sum) -> Self::Rows<1>;
    /// Sums of one of the slices.
    fn join_rows<const G: usize>(self, s: S, rows: &Self::Rows<G>, slice: usize) -> Self::Sum;
    fn row(rows: &Self::Rows<1>, lane: usize) -> Self::Row;
    fn set_row<const G: usize>(rows: &mut Self::Rows<G>, row: usize, sum: Self::Row);

    /// Adds an entry to one row, whatever the order.
    fn add_to_row(self, row: Self::Row, entry: f64, x: f64, index: u32) -> Self::Row;
}

/// Vectors of eight on cache lines.
#[repr(align(64))]
pub struct CacheLines<T, const G: usize>([[T; LANES]; G]);

/// Maxima of eight rows, and their indices.
#[derive(Clone, Copy)]
pub struct Maxima<S: Simd> {
    pub value: S::V,
    pub index: S::I,
}

/// Maxima and indices in memory, for G slices. (With values and indices in pairs, a Viterbi step by
/// groups took 4 to 7% longer.)
pub struct MaximaRows<const G: usize> {
    values: CacheLines<f64, G>,
    indices: CacheLines<u32, G>,
}

impl<S: Simd> RowSums<S> for SumProduct {
    type Sum = S::V;
    type Row = f64;
    type Rows<const G: usize> = CacheLines<f64, G>;

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
        // One sum over both runs, in the order of slots.
        first
    }

    #[inline(always)]
    fn join(self, _: S, _: S::V, second: S::V) -> S::V {
        second
    }

    #[inline(always)]
    fn rows<const G: usize>() -> CacheLines<f64, G> {
        CacheLines([[0.0; LANES]; G])
    }

    #[inline(always)]
    fn to_rows(self, s: S, sum: S::V) -> CacheLines<f64, 1> {
        CacheLines([s.to_array(sum)])
    }

    #[inline(always)]
    fn join_rows<const G: usize>(self, s: S, rows: &CacheLines<f64, G>, slice: usize) -> S::V {
        s.load(&rows.0[slice])
    }

    #[inline(always)]
    fn row(rows: &CacheLines<f64, 1>, lane: usize) -> f64 {
        rows.0[0][lane]
    }

    #[inline(always)]
    fn set_row<const G: usize>(rows: &mut CacheLines<f64, G>, row: usize, sum: f64) {
        rows.0.as_flattened_mut()[row] = sum;
    }

    #[inline(always)]
    fn add_to_row(self, row: f64, entry: f64, x: f64, _: u32) -> f64 {
        row + entry * x
    }
}

impl<S: Simd> RowSums<S> for MaxPlus {
    type Sum = Maxima<S>;
    type Row = (f64, u32);
    type Rows<const G: usize> = MaximaRows<G>;

    #[inline(always)]
    fn zero(self, s: S) -> Maxima<S> {
        Maxima { value: s.splat(f64::NEG_INFINITY), index: s.iota(0) }
    }

    /// The first of several entries that attain the maximum stays.
    #[inline(always)]
    fn add(self, s: S, sum: &mut Maxima<S>, entry: S::V, x: S::V, index: S::I) {
        let value = s.add(entry, x);
        // Below, not below or equal: of equal scores that with the lower index came first. NaN is
        // never better. In a row without a way, the index is arbitrary.
        let better = s.lt(sum.value, value);
        sum.value = s.max(value, sum.value);
        sum.index = s.select_index(better, index, sum.index);
    }

    /// The lowest of several indices stays.
    #[inline(always)]
    fn add_unordered(self, s: S, sum: &mut Maxima<S>, entry: S::V, x: S::V, index: S::I) {
        let value = s.add(entry, x);
        // Entries of a group come as in slices, those on diagonals first: indices do not ascend, and
        // where scores tie they are compared. Four instructions more for each slot.
        let tie = s.and(s.eq(value, sum.value), s.lt_index(index, sum.index));
        let better = s.or(s.lt(sum.value, value), tie);
        sum.value = s.max(value, sum.value);
        sum.index = s.select_index(better, index, sum.index);
    }

    #[inline(always)]
    fn second(self, s: S, _: Maxima<S>) -> Maxima<S> {
        // Indices begin anew: the maximum of each run by itself has its lowest index.
        self.zero(s)
    }

    #[inline(always)]
    fn join(self, s: S, first: Maxima<S>, second: Maxima<S>) -> Maxima<S> {
        // Either run may have the lower index: diagonals lie on both sides of gathered entries.
        let lower = s.lt_index(second.index, first.index);
        let tie = s.and(s.eq(second.value, first.value), lower);
        let better = s.or(s.lt(first.value, second.value), tie);
        Maxima {
            value: s.max(second.value, first.value),
            index: s.select_index(better, second.index, first.index),
        }
    }

    #[inline(always)]
    fn rows<const G: usize>() -> MaximaRows<G> {
        MaximaRows { values: CacheLines([[0.0; LANES]; G]), indices: CacheLines([[0; LANES]; G]) }
    }

    #[inline(always)]
    fn to_rows(self, s: S, sum: Maxima<S>) -> MaximaRows<1> {
        let mut indices = [0; LANES];
        s.store_indices(sum.index, &mut indices);
        MaximaRows { values: CacheLines([s.to_array(sum.value)]), indices: CacheLines([indices]) }
    }

    #[inline(always)]
    fn join_rows<const G: usize>(self, s: S, rows: &MaximaRows<G>, slice: usize) -> Maxima<S> {
        let MaximaRows { values, indices } = rows;
        Maxima { value: s.load(&values.0[slice]), index: s.load_indices(&indices.0[slice]) }
    }

    #[inline(always)]
    fn row(rows: &MaximaRows<1>, lane: usize) -> (f64, u32) {
        (rows.values.0[0][lane], rows.indices.0[0][lane])
    }

    #[inline(always)]
    fn set_row<const G: usize>(rows: &mut MaximaRows<G>, row: usize, (value, index): (f64, u32)) {
        rows.values.0.as_flattened_mut()[row] = value;
        rows.indices.0.as_flattened_mut()[row] = index;
    }

    #[inline(always)]
    fn add_to_row(self, row: (f64, u32), entry: f64, x: f64, index: u32) -> (f64, u32) {
        let value = entry + x;
        // Overflow entries come after entries with higher indices: where scores tie, these are
        // compared.
        let better = value > row.0 || (value == row.0 && index < row.1);
        if better { (value, index) } else { row }
    }
}

/// Consumer of a product. (A closure might not become part of the function that may use the
/// instructions.)
pub trait Sink<S: Simd, T> {
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
