//! Products over the entries of slices. Indices are not checked again: checks were a fifth of the
//! time of a product with a small matrix.
#![allow(unsafe_code, reason = "indices that were checked when the slices were made")]

use std::ops::Range;

use super::sliced::{Slice, Sliced};
use super::values::{EntryValues, Value, Width};
use crate::kernels::ops::{Semiring, Sink, SumProduct};
use crate::kernels::simd::{Eight, Simd};

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
        let fits =
            values.shifted.len() == self.bases.len() && values.gathered.len() == self.indices.len();
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
                    let overflow = &self.overflow[line];
                    let entries = start..overflow.end as usize;
                    let row = &mut rows[overflow.lane as usize];
                    let indices = &self.overflow_indices[entries.clone()];
                    for (&j, &value) in indices.iter().zip(&values.overflow[entries]) {
                        // SAFETY: all indices are below the number of values of x, as above.
                        let x = unsafe { *x.get_unchecked(j as usize) };
                        ring.add_to_row(row, value.into(), x, j);
                    }
                    (start, line) = (overflow.end as usize, line + 1);
                }
                sum = ring.join_rows(s, rows);
            }
            sink.take(s, number, sum);
        }
    }
}
