//! Products over the entries of slices. Indices are not checked again: checks were a fifth of the
//! time of a product with a small matrix.
#![allow(unsafe_code, reason = "indices that were checked when the slices were made")]

use std::ops::Range;

use super::sliced::{Overflow, Slice, Sliced, WINDOW};
use super::values::{EntryValues, Value, Width};
use crate::kernels::ops::{MaxPlus, Semiring, Sink, SumProduct};
use crate::kernels::parallel::PART;
use crate::kernels::simd::{Eight, LANES, Simd};

/// Slices of a window. Parts end with windows.
const SLICES: usize = WINDOW / LANES;
const _: () = assert!(PART / WINDOW * WINDOW == PART);

impl Sliced {
    /// Passes the product of each slice with x to a sink, numbered from the first of them.
    #[inline(always)]
    pub(in crate::kernels) fn product<S: Simd>(
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
    pub(in crate::kernels) fn product_with<S: Simd, V: Value, R: Lanes<S>>(
        &self,
        s: S,
        ring: R,
        slices: Range<usize>,
        values: &EntryValues<V>,
        x: &[f64],
        sink: &mut impl Sink<S, R::Sum>,
    ) {
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
        // Sums of a window, in the order of its lines.
        let mut values = CacheLines([[0.0; LANES]; SLICES]);
        let mut indices = CacheLines([[0; LANES]; SLICES]);
        let windows = slices.clone().step_by(SLICES).zip((0..).step_by(SLICES));
        for (window, number) in windows {
            let window = window..slices.end.min(window + SLICES);
            for (to, lines) in self.slices[window.clone()].iter().zip(&self.order[window.clone()]) {
                let sum = ring.zero(s);
                let sum = factors.gathered::<_, _, false>(s, ring, sum, from.gathered..to.gathered);
                let sum = factors.overflow(s, ring, sum, from.overflow..to.overflow);
                let (value, index) = ring.to_lanes(s, sum);
                for (lane, line) in lines.iter().enumerate() {
                    values.0.as_flattened_mut()[*line as usize] = value[lane];
                    indices.0.as_flattened_mut()[*line as usize] = index[lane];
                }
                from = *to;
            }
            for slice in 0..window.len() {
                let sum = ring.of_lanes(s, &values.0[slice], &indices.0[slice]);
                sink.take(s, number + slice, sum);
            }
        }
    }
}

/// Vectors of eight on cache lines.
#[repr(align(64))]
struct CacheLines<T>([[T; LANES]; SLICES]);

/// A semiring whose sums can be permuted.
pub(in crate::kernels) trait Lanes<S: Simd>: Semiring<S> {
    /// Adds an entry to each row, in any order of the indices.
    fn add_unordered(self, s: S, sum: &mut Self::Sum, entry: S::V, x: S::V, index: S::I);

    /// Value and index of each lane.
    fn to_lanes(self, s: S, sum: Self::Sum) -> (Eight, [u32; LANES]);
    fn of_lanes(self, s: S, values: &Eight, indices: &[u32; LANES]) -> Self::Sum;
}

impl<S: Simd> Lanes<S> for SumProduct {
    #[inline(always)]
    fn add_unordered(self, s: S, sum: &mut S::V, entry: S::V, x: S::V, index: S::I) {
        self.add(s, sum, entry, x, index);
    }

    #[inline(always)]
    fn to_lanes(self, s: S, sum: S::V) -> (Eight, [u32; LANES]) {
        (s.to_array(sum), [0; LANES])
    }

    #[inline(always)]
    fn of_lanes(self, s: S, values: &Eight, _: &[u32; LANES]) -> S::V {
        s.load(values)
    }
}

impl<S: Simd> Lanes<S> for MaxPlus {
    #[inline(always)]
    fn add_unordered(self, s: S, sum: &mut Self::Sum, entry: S::V, x: S::V, index: S::I) {
        let value = s.add(entry, x);
        let tie = s.and(s.eq(value, sum.value), s.lt_index(index, sum.index));
        let better = s.or(s.lt(sum.value, value), tie);
        sum.value = s.max(value, sum.value);
        sum.index = s.select_index(better, index, sum.index);
    }

    #[inline(always)]
    fn to_lanes(self, s: S, sum: Self::Sum) -> (Eight, [u32; LANES]) {
        let mut indices = [0; LANES];
        s.store_indices(sum.index, &mut indices);
        (s.to_array(sum.value), indices)
    }

    #[inline(always)]
    fn of_lanes(self, s: S, values: &Eight, indices: &[u32; LANES]) -> Self::Sum {
        let mut sum = self.zero(s);
        (sum.value, sum.index) = (s.load(values), s.load_indices(indices));
        sum
    }
}

/// A matrix with values, and a vector, of which `product_with` has asserted that they fit.
#[derive(Clone, Copy)]
struct Factors<'a, V: Value> {
    matrix: &'a Sliced,
    values: &'a EntryValues<V>,
    x: &'a [f64],
}

impl<V: Value> Factors<'_, V> {
    /// Sums over shifted slots.
    #[inline(always)]
    fn shifted<S: Simd, R: Semiring<S>>(self, s: S, ring: R, slots: Range<u32>) -> R::Sum {
        let Self { matrix, values, x } = self;
        let (mut sum, mut slot) = (ring.zero(s), slots.start as usize);
        while slot < slots.end as usize {
            // SAFETY: `Sliced::push_shifted` ends slices within the slots, each of which has a base
            // and values (the assertion in `product_with`), and takes no base unless eight values
            // of x begin there.
            let (base, value, x) = unsafe {
                let base = *matrix.bases.get_unchecked(slot);
                debug_assert!(base as usize + size_of::<Eight>() / 8 <= x.len());
                let x = &*x.as_ptr().add(base as usize).cast::<Eight>();
                (base, values.shifted.get_unchecked(slot), s.load(x))
            };
            ring.add(s, &mut sum, V::load(s, value), x, s.iota(base));
            slot += 1;
            s.no_unroll();
        }
        sum
    }

    /// Adds gathered slots, whose indices ascend in each lane if they are ordered.
    #[inline(always)]
    fn gathered<S: Simd, R: Lanes<S>, const ORDERED: bool>(
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
            // has values (the assertion in `product_with`); `Sliced::arranged` asserts that all
            // indices are below the number of lines, that of the values of x, and that this is
            // below 2^31.
            let (indices, value, x) = unsafe {
                let indices = matrix.indices.get_unchecked(slot);
                (indices, values.gathered.get_unchecked(slot), s.gather(x, indices))
            };
            let (value, indices) = (V::load(s, value), s.load_indices(indices));
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
    fn overflow<S: Simd, R: Semiring<S>>(
        self,
        s: S,
        ring: R,
        sum: R::Sum,
        lines: Range<u32>,
    ) -> R::Sum {
        let Self { matrix, values, x } = self;
        if lines.is_empty() {
            return sum;
        }
        let mut rows = ring.to_rows(s, sum);
        let before = (lines.start as usize).checked_sub(1);
        let mut start = before.map_or(0, |before| matrix.overflow[before].end as usize);
        for Overflow { lane, end } in &matrix.overflow[lines.start as usize..lines.end as usize] {
            // In a register: the lane is known to nobody.
            let mut row = rows[*lane as usize % LANES];
            while start < *end as usize {
                // SAFETY: `Sliced::push_others` ends lines within the entries, of which there are
                // as many indices as values (the assertion in `product_with`), and all indices are
                // below the number of values of x.
                let (value, x, j) = unsafe {
                    let j = *matrix.overflow_indices.get_unchecked(start);
                    let value = *values.overflow.get_unchecked(start);
                    (value.into(), *x.get_unchecked(j as usize), j)
                };
                row = ring.add_to_row(row, value, x, j);
                start += 1;
            }
            rows[*lane as usize % LANES] = row;
        }
        ring.join_rows(s, rows)
    }
}
