//! Products over the entries of slices, over any semiring: A x and A' x of the filter and the
//! smoother (formulas 2 and 3 of the guide), and max over j of log2 A\[i, j\] + x(j) (formula 7).
//!
//! Indices are not checked here: checks took a fifth of the time of a product with a small matrix.
//! Instead, `build` asserts once that they are below the number of lines, and `product_with`
//! asserts that x has as many values.
#![allow(unsafe_code, reason = "indices that were checked when the slices were made")]

use std::ops::Range;

use super::sliced::{Overflow, Slice, Sliced, WINDOW};
use super::values::{EntryValues, Value, Width};
use crate::ops::{RowSums, Sink, SumProduct};
use crate::parallel::PART;
use crate::simd::{Eight, LANES, Simd};

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
        match &self.values {
            Width::Double(values) => self.product_with(s, SumProduct, slices, values, x, sink),
            Width::Single(values) => self.product_with(s, SumProduct, slices, values, x, sink),
        }
    }

    /// The same with other values, over any semiring.
    #[inline(always)]
    pub(crate) fn product_with<S: Simd, V: Value, R: RowSums<S>>(
        &self,
        s: S,
        ring: R,
        slices: Range<usize>,
        values: &EntryValues<V>,
        x: &[f64],
        sink: &mut impl Sink<S, R::Sum>,
    ) {
        // Both assertions are what the loads of `Factors` rely on.
        assert_eq!(x.len(), self.lines, "x must have one value per state");
        let fits = values.shifted.len() == self.bases.len()
            && values.gathered.len() == self.indices.len()
            && values.overflow.len() == self.overflow_indices.len();
        assert!(fits, "values must be those of a matrix of this structure");
        // Slices begin where those before them end.
        let before = slices.start.checked_sub(1);
        let mut from = before.map_or(Slice::default(), |before| self.slices[before]);
        let factors = Factors { matrix: self, values, x };
        if self.order.is_empty() {
            for (number, to) in self.slices[slices].iter().enumerate() {
                let first = factors.shifted(s, ring, from.shifted..to.shifted);
                // Indices ascend among the shifted slots and again among the gathered ones, not
                // over both: a maximum over both would not keep the lowest of several.
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
struct Factors<'a, V: Value> {
    matrix: &'a Sliced,
    values: &'a EntryValues<V>,
    x: &'a [f64],
}

impl<V: Value> Factors<'_, V> {
    /// Sums over shifted slots.
    #[inline(always)]
    fn shifted<S: Simd, R: RowSums<S>>(self, s: S, ring: R, slots: Range<u32>) -> R::Sum {
        let Self { matrix, values, x } = self;
        let (mut sum, mut slot) = (ring.zero(s), slots.start as usize);
        while slot < slots.end as usize {
            // SAFETY: `Sliced::push_shifted` ends slices within the slots, each of which has a base
            // and, by the assertion in `product_with`, values. It takes a base only if eight values
            // of x begin there, for an x of `lines` values, which is the other assertion.
            let (base, value, x) = unsafe {
                let base = *matrix.bases.get_unchecked(slot);
                debug_assert!(base as usize + size_of::<Eight>() / 8 <= x.len());
                let x = &*x.as_ptr().add(base as usize).cast::<Eight>();
                (base, values.shifted.get_unchecked(slot), s.load(x))
            };
            ring.add(s, &mut sum, V::load(s, value), x, s.iota(base));
            slot += 1;
            // Slices have three or four slots as a rule: a loop unrolled by four would begin with
            // a test that fails, and end with a rest that is all there is.
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
        // The choice is made outside of the loop: inside, it took the compiler the registers for
        // indices, and a slot of loads by AVX2 half as long again.
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
            // SAFETY: `Sliced::push_others` ends slices and groups within the slots, each of which
            // has values (the assertion in `product_with`). `Sliced::arranged` asserts that all
            // indices are below the number of lines, that of the values of x, and that this is
            // below 2^31; lanes without an entry have the index of a line, too.
            let (indices, value, x) = unsafe {
                let indices = matrix.indices.get_unchecked(slot);
                (indices, values.gathered.get_unchecked(slot), s.gather::<INSTRUCTION>(x, indices))
            };
            let (value, indices) = (V::load(s, value), s.load_indices(indices));
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
        // Most slices have none, and keep their sums in registers.
        if lines.is_empty() {
            return sum;
        }
        let mut rows = ring.to_rows(s, sum);
        // Entries of a line begin where those of the line before end, in another slice or not.
        let before = (lines.start as usize).checked_sub(1);
        let mut start = before.map_or(0, |before| matrix.overflow[before].end as usize);
        for Overflow { lane, end } in &matrix.overflow[lines.start as usize..lines.end as usize] {
            // A copy, which can stay in a register: the compiler can't tell which row it is. The
            // remainder saves the check of an index that is below eight anyway.
            let mut row = R::row(&rows, *lane as usize % LANES);
            while start < *end as usize {
                // SAFETY: `Sliced::push_others` ends lines within the entries, which have as many
                // indices as values (the assertion in `product_with`), and `arranged` asserts that
                // all indices are below the number of values of x.
                let (value, x, j) = unsafe {
                    let j = *matrix.overflow_indices.get_unchecked(start);
                    let value = *values.overflow.get_unchecked(start);
                    (value.into(), *x.get_unchecked(j as usize), j)
                };
                row = ring.add_to_row(row, value, x, j);
                start += 1;
            }
            R::set_row(&mut rows, *lane as usize % LANES, row);
        }
        ring.join_rows(s, &rows, 0)
    }
}
