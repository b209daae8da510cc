//! Products of slices, over either [semiring](crate::semiring): A x and A' x of the filter and the
//! smoother (formulas 2 and 3 of the guide), and max over j of log2 A\[i, j\] + x(j) (formula 7).
//!
//! They are passed on eight rows at a time, so that what follows a product in a step needs no pass
//! of its own. Blocks come in the order of rows. Parts begin at multiples of
//! [`PART`], which are multiples of eight and of windows.
//!
//! Indices are not checked here: checks took a fifth of the time of a product with a small matrix.
//! Instead, [`Sliced::arranged`] asserts once that they are below the number of lines, and
//! `product_with` asserts that x has as many values.

use std::ops::Range;

use super::sliced::{EntryValues, Overflow, Slice, Sliced, WINDOW};
use crate::semiring::{MaxPlus, SumProduct};
use crate::simd::{BlocksMut, Eight, LANES, Simd, WithSimd, store};
use crate::simd::{PART, Splits, run_in_parts};

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
        // Strictly below: of equal scores, the one with the lower index came first. NaN is never
        // better. In a row without a way, the index is arbitrary.
        let better = s.lt(sum.value, value);
        sum.value = s.max(value, sum.value);
        sum.index = s.select_index(better, index, sum.index);
    }

    /// The lowest of several indices stays.
    #[inline(always)]
    fn add_unordered(self, s: S, sum: &mut Maxima<S>, entry: S::V, x: S::V, index: S::I) {
        let value = s.add(entry, x);
        // Entries of a group come as in slices, those on diagonals first. So indices do not ascend,
        // and are compared where scores tie, at the cost of four more instructions for each slot.
        let tie = s.and(s.eq(value, sum.value), s.lt_index(index, sum.index));
        let better = s.or(s.lt(sum.value, value), tie);
        sum.value = s.max(value, sum.value);
        sum.index = s.select_index(better, index, sum.index);
    }

    #[inline(always)]
    fn second(self, s: S, _: Maxima<S>) -> Maxima<S> {
        // Indices start again, so each run has its own maximum, at its lowest index.
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
        // Overflow entries come after entries with higher indices, so indices are compared where
        // scores tie.
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

/// Slices of a window. Parts end with windows.
const SLICES: usize = WINDOW / LANES;
const _: () = assert!(PART.is_multiple_of(WINDOW));

impl Sliced {
    /// Passes the product of each slice with x to a sink, numbered from the first of them.
    #[inline(always)]
    pub(crate) fn product<S: Simd>(
        &self,
        s: S,
        slices: Range<usize>,
        x: &[f64],
        sink: &mut impl Sink<S, S::V>,
    ) {
        self.product_with(s, SumProduct, slices, &self.values, x, sink);
    }

    /// The same with other values, over any semiring.
    #[inline(always)]
    pub(crate) fn product_with<S: Simd, R: RowSums<S>>(
        &self,
        s: S,
        ring: R,
        slices: Range<usize>,
        values: &EntryValues,
        x: &[f64],
        sink: &mut impl Sink<S, R::Sum>,
    ) {
        // The loads of `Factors` rely on both assertions.
        assert_eq!(x.len(), self.lines, "x must have one value per state");
        let fits = values.shifted.len() == self.bases.len()
            && values.gathered.len() == self.indices.len()
            && values.overflow.len() == self.overflow_indices.len();
        assert!(fits, "values must be those of a matrix of this structure");
        // A slice begins where the previous one ends.
        let before = slices.start.checked_sub(1);
        let mut from = before.map_or(Slice::default(), |before| self.slices[before]);
        let factors = Factors { matrix: self, values, x };
        if self.order.is_empty() {
            for (number, to) in self.slices[slices].iter().enumerate() {
                let first = factors.shifted(s, ring, from.shifted..to.shifted);
                // Indices ascend among the shifted slots and again among the gathered ones, not
                // over both: one maximum over both would not keep the lowest index of a tie.
                let second = ring.second(s, first);
                let second =
                    factors.gathered::<_, _, true>(s, ring, second, from.gathered..to.gathered);
                let sum = ring.join(s, first, second);
                sink.take(s, number, factors.overflow(s, ring, sum, from.overflow..to.overflow));
                from = *to;
            }
            return;
        }
        let at_end = slices.end == self.slices.len() || slices.end.is_multiple_of(SLICES);
        assert!(slices.start.is_multiple_of(SLICES) && at_end, "windows must not be split");
        // A window is complete before its sums are passed on: sinks take lines in their order, and
        // the first group may have the last line. A few KB on the stack stay in the first cache.
        let mut sums = R::rows::<SLICES>();
        let windows = slices.clone().step_by(SLICES).zip((0..).step_by(SLICES));
        for (window, number) in windows {
            let window = window..slices.end.min(window + SLICES);
            for (to, lines) in self.slices[window.clone()].iter().zip(&self.order[window.clone()]) {
                let sum = ring.zero(s);
                let sum = factors.gathered::<_, _, false>(s, ring, sum, from.gathered..to.gathered);
                let sum = factors.overflow(s, ring, sum, from.overflow..to.overflow);
                let rows = ring.to_rows(s, sum);
                // A line is a u8, and a window has 256 lines: the compiler knows that the index is
                // in range, and drops the check.
                for (lane, line) in lines.iter().map(|line| *line as usize).enumerate() {
                    R::set_row(&mut sums, line, R::row(&rows, lane));
                }
                from = *to;
            }
            for slice in 0..window.len() {
                sink.take(s, number + slice, ring.join_rows(s, &sums, slice));
            }
        }
    }
}

/// Matrix with values, and a vector, whose sizes `product_with` has found to fit.
#[derive(Clone, Copy)]
struct Factors<'a> {
    matrix: &'a Sliced,
    values: &'a EntryValues,
    x: &'a [f64],
}

#[allow(unsafe_code, reason = "indices that were checked when the slices were made")]
impl Factors<'_> {
    /// Sums over shifted slots.
    #[inline(always)]
    fn shifted<S: Simd, R: RowSums<S>>(self, s: S, ring: R, slots: Range<u32>) -> R::Sum {
        let Self { matrix, values, x } = self;
        let (mut sum, mut slot) = (ring.zero(s), slots.start as usize);
        while slot < slots.end as usize {
            // SAFETY: `Sliced::push_shifted` ends slices within the slots, and takes a base only if
            // eight values of x begin there, for an x of `lines` values (an assertion in
            // `product_with`). Each slot has a base and, by the other assertion, values.
            let (base, value, x) = unsafe {
                let base = *matrix.bases.get_unchecked(slot);
                debug_assert!(base as usize + size_of::<Eight>() / 8 <= x.len());
                let x = &*x.as_ptr().add(base as usize).cast::<Eight>();
                (base, values.shifted.get_unchecked(slot), s.load(x))
            };
            ring.add(s, &mut sum, s.load(value), x, s.iota(base));
            slot += 1;
            // Most slices have three or four slots: a loop unrolled by four would begin with a test
            // that fails, and do all the work in its remainder.
            s.no_unroll();
        }
        sum
    }

    /// Adds gathered slots, whose indices ascend in each lane if they are ordered.
    #[inline(always)]
    fn gathered<S: Simd, R: RowSums<S>, const ORDERED: bool>(
        self,
        s: S,
        ring: R,
        sum: R::Sum,
        slots: Range<u32>,
    ) -> R::Sum {
        // The choice is made outside of the loop. Inside, it cost the compiler the registers for
        // indices, and a slot of AVX2 loads took half as long again.
        if s.gathers() {
            self.gathered_by::<S, R, ORDERED, true>(s, ring, sum, slots)
        } else {
            self.gathered_by::<S, R, ORDERED, false>(s, ring, sum, slots)
        }
    }

    #[inline(always)]
    fn gathered_by<S: Simd, R: RowSums<S>, const ORDERED: bool, const INSTRUCTION: bool>(
        self,
        s: S,
        ring: R,
        mut sum: R::Sum,
        slots: Range<u32>,
    ) -> R::Sum {
        let Self { matrix, values, x } = self;
        let mut slot = slots.start as usize;
        while slot < slots.end as usize {
            // SAFETY: `Sliced::push_others` ends slices and groups within the slots, and each slot
            // has values (the assertion in `product_with`). `Sliced::arranged` asserts that all
            // indices are below the number of lines, which is that of the values of x, and that
            // this number is below 2^31. Lanes without an entry also have the index of a line.
            let (indices, value, x) = unsafe {
                let indices = matrix.indices.get_unchecked(slot);
                (indices, values.gathered.get_unchecked(slot), s.gather::<INSTRUCTION>(x, indices))
            };
            let (value, indices) = (s.load(value), s.load_indices(indices));
            // An empty lane adds 0 · x to a sum, and offers −∞ to a maximum: a sum stays as it is,
            // and so does a maximum above −∞ with its index.
            if ORDERED {
                ring.add(s, &mut sum, value, x, indices);
            } else {
                ring.add_unordered(s, &mut sum, value, x, indices);
            }
            slot += 1;
            s.no_unroll();
        }
        sum
    }

    /// Adds overflow entries.
    #[inline(always)]
    fn overflow<S: Simd, R: RowSums<S>>(
        self,
        s: S,
        ring: R,
        sum: R::Sum,
        lines: Range<u32>,
    ) -> R::Sum {
        let Self { matrix, values, x } = self;
        // Most slices have no overflow entries, and keep their sums in registers.
        if lines.is_empty() {
            return sum;
        }
        let mut rows = ring.to_rows(s, sum);
        // The entries of a line begin where those of the previous line end, even in another slice.
        let before = (lines.start as usize).checked_sub(1);
        let mut start = before.map_or(0, |before| matrix.overflow[before].end as usize);
        for Overflow { lane, end } in &matrix.overflow[lines.start as usize..lines.end as usize] {
            // A copy can stay in a register, which an element of `rows` at an unknown index can't.
            // The remainder saves the check of an index that is below eight anyway.
            let mut row = R::row(&rows, *lane as usize % LANES);
            while start < *end as usize {
                // SAFETY: `Sliced::push_others` ends lines within the entries, which have as many
                // indices as values (the assertion in `product_with`), and `arranged` asserts that
                // all indices are below the number of values of x.
                let (value, x, j) = unsafe {
                    let j = *matrix.overflow_indices.get_unchecked(start);
                    let value = *values.overflow.get_unchecked(start);
                    (value, *x.get_unchecked(j as usize), j)
                };
                row = ring.add_to_row(row, value, x, j);
                start += 1;
            }
            R::set_row(&mut rows, *lane as usize % LANES, row);
        }
        ring.join_rows(s, &rows, 0)
    }
}

/// Product with a vector, for a step of the filter or the smoother.
#[derive(Debug, Clone, Copy)]
pub enum Product<'a> {
    /// Product of a stored stochastic matrix with a distribution.
    Sparse { matrix: &'a Sliced, x: &'a [f64] },
    /// Product that was computed elsewhere, and need not sum to one.
    Computed(&'a [f64]),
}

/// Rows of a product that a kernel takes. (A kernel is generic over this rather than holding the
/// enum: less to copy for a step of few states.)
pub(crate) trait ProductRows: Copy + Send {
    /// True if the product is known to be that of a distribution.
    const KNOWN: bool;

    fn rows(self) -> usize;

    /// Splits at a multiple of eight.
    fn split(self, at: usize) -> (Self, Self);

    /// Passes each block to a sink, numbered from the first of these rows.
    fn pass_to<S: Simd>(self, s: S, sink: &mut impl Sink<S, S::V>);
}

/// Product of some rows of a sparse matrix with x.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SparseRows<'a> {
    matrix: &'a Sliced,
    x: &'a [f64],
    /// The first row, a multiple of eight, and the end.
    first: usize,
    end: usize,
}

impl<'a> SparseRows<'a> {
    #[inline(always)]
    pub(crate) fn all(matrix: &'a Sliced, x: &'a [f64]) -> Self {
        Self { matrix, x, first: 0, end: matrix.lines() }
    }
}

impl ProductRows for SparseRows<'_> {
    const KNOWN: bool = true;

    #[inline(always)]
    fn rows(self) -> usize {
        self.end - self.first
    }

    fn split(self, at: usize) -> (Self, Self) {
        // Both parts read all of x: only rows are divided.
        let middle = self.first + at;
        (Self { end: middle, ..self }, Self { first: middle, ..self })
    }

    #[inline(always)]
    fn pass_to<S: Simd>(self, s: S, sink: &mut impl Sink<S, S::V>) {
        // The end is rounded up: lanes beyond the last row have no entries, and sinks do not store
        // them.
        self.matrix.product(s, self.first / LANES..self.end.div_ceil(LANES), self.x, sink);
    }
}

impl ProductRows for &[f64] {
    const KNOWN: bool = false;

    #[inline(always)]
    fn rows(self) -> usize {
        self.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        self.split_at(at)
    }

    #[inline(always)]
    fn pass_to<S: Simd>(self, s: S, sink: &mut impl Sink<S, S::V>) {
        // These values are not known to sum to one: the sink sums them and looks for negative
        // values.
        let (blocks, rest) = self.as_chunks::<LANES>();
        for (number, block) in blocks.iter().enumerate() {
            sink.take(s, number, s.load(block));
        }
        // Only the last part can have a rest: the length of any other is a multiple of eight.
        if !rest.is_empty() {
            sink.take(s, blocks.len(), s.load_partial(rest));
        }
    }
}

impl Sliced {
    /// Computes the product with x.
    pub fn multiply(&self, x: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.lines(), "out must have one value per state");
        // `product` checks the length of x, this assertion that of the result.
        run_in_parts(StoreProduct { product: SparseRows::all(self, x), out });
    }
}

/// `out` = a product.
struct StoreProduct<'a, P> {
    product: P,
    out: &'a mut [f64],
}

impl<P: ProductRows> WithSimd for StoreProduct<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.product.pass_to(s, &mut self.out.as_chunks_mut());
    }
}

impl<P: ProductRows> Splits for StoreProduct<'_, P> {
    fn lines(&self) -> usize {
        self.out.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (product, (out, out_rest)) = (self.product.split(at), self.out.split_at_mut(at));
        (Self { product: product.0, out }, Self { product: product.1, out: out_rest })
    }

    fn join((): (), (): ()) {}
}
