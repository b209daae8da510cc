//! Products over the entries of slices. Indices are not checked again: checks were a fifth of the
//! time of a product with a small matrix.
#![allow(unsafe_code, reason = "indices that were checked when the slices were made")]

use std::ops::Range;

use super::sliced::{Overflow, Slice, Sliced};
use super::values::{EntryValues, Value, Width};
use crate::kernels::ops::{Semiring, Sink, SumProduct};
use crate::kernels::simd::{Eight, LANES, Simd};

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
    pub(in crate::kernels) fn product_with<S: Simd, V: Value, R: Semiring<S>>(
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
        let from = before.map_or(Slice::default(), |before| self.slices[before]);
        let (mut shifted, mut gathered) = (from.shifted as usize, from.gathered as usize);
        let mut line = from.overflow as usize;
        let mut start = line.checked_sub(1).map_or(0, |before| self.overflow[before].end as usize);
        for (number, to) in self.slices[slices].iter().enumerate() {
            let mut first = ring.zero(s);
            while shifted < to.shifted as usize {
                // SAFETY: `Sliced::push` ends slices within the slots, each of which has a base
                // and values (the assertion above), and takes no base unless eight values of x
                // begin there.
                let (base, value, x) = unsafe {
                    let base = *self.bases.get_unchecked(shifted);
                    debug_assert!(base as usize + size_of::<Eight>() / 8 <= x.len());
                    let x = &*x.as_ptr().add(base as usize).cast::<Eight>();
                    (base, values.shifted.get_unchecked(shifted), s.load(x))
                };
                ring.add(s, &mut first, V::load(s, value), x, s.iota(base));
                shifted += 1;
                s.no_unroll();
            }
            let mut second = ring.second(s, first);
            while gathered < to.gathered as usize {
                // SAFETY: as above; `Sliced::with_slots` asserts that all indices are below the
                // number of lines, that of the values of x, and that this is below 2^31.
                let (indices, value, x) = unsafe {
                    let indices = self.indices.get_unchecked(gathered);
                    (indices, values.gathered.get_unchecked(gathered), s.gather(x, indices))
                };
                ring.add(s, &mut second, V::load(s, value), x, s.load_indices(indices));
                gathered += 1;
                s.no_unroll();
            }
            let mut sum = ring.join(s, first, second);
            if line < to.overflow as usize {
                let mut rows = ring.to_rows(s, sum);
                while line < to.overflow as usize {
                    let Overflow { lane, end } = self.overflow[line];
                    // In a register: the lane is known to nobody.
                    let mut row = rows[lane as usize % LANES];
                    while start < end as usize {
                        // SAFETY: `Sliced::push` ends lines within the entries, of which there
                        // are as many indices as values (the assertion above), and all indices
                        // are below the number of values of x.
                        let (value, x, j) = unsafe {
                            let j = *self.overflow_indices.get_unchecked(start);
                            let value = *values.overflow.get_unchecked(start);
                            (value.into(), *x.get_unchecked(j as usize), j)
                        };
                        row = ring.add_to_row(row, value, x, j);
                        start += 1;
                    }
                    rows[lane as usize % LANES] = row;
                    line += 1;
                }
                sum = ring.join_rows(s, rows);
            }
            sink.take(s, number, sum);
        }
    }
}
