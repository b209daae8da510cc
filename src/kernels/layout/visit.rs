//! The way through the entries of slices. What it reads is not checked a second time:
//! checks were a fifth of the time of a product with a small matrix.

#![allow(unsafe_code, reason = "indices that have been checked when the slices were made")]

use std::ops::Range;

use super::{Slice, Sliced, Values};
use crate::kernels::lanes::{Eight, Lanes};
use crate::kernels::value::{Value, Width};

/// What is made of the entries of each slice. Implementations are
/// `#[inline(always)]`.
pub(in crate::kernels) trait Walk<L: Lanes> {
    /// What has been made of some entries.
    type State;

    /// Of none.
    fn nothing(&self, lanes: L) -> Self::State;

    /// Of eight more, one in each line: their values, those of x, and where in x
    /// they are.
    fn take(&self, lanes: L, state: &mut Self::State, value: L::V, x: L::V, index: L::I);

    /// Of eight more from a gathered slot, which come after those of shifted ones: in
    /// each line in the order of their indices, as those do.
    #[inline(always)]
    fn take_gathered(&self, lanes: L, state: &mut Self::State, value: L::V, x: L::V, index: L::I) {
        self.take(lanes, state, value, x, index);
    }

    /// Of more in one line, in order, which come last.
    fn take_apart(
        &self,
        lanes: L,
        state: &mut Self::State,
        lane: usize,
        entries: impl Iterator<Item = (f64, f64, u32)>,
    );

    /// Of all of a slice.
    fn slice(&mut self, lanes: L, number: usize, state: Self::State);
}

impl Sliced {
    /// Goes through some of the slices with the values of the matrix, numbered from the
    /// first of them.
    #[inline(always)]
    pub(in crate::kernels) fn walk<L: Lanes>(
        &self,
        lanes: L,
        slices: Range<usize>,
        x: &[f64],
        walk: &mut impl Walk<L>,
    ) {
        match &self.values {
            Width::Double(values) => self.walk_with(lanes, slices, values, x, walk),
            Width::Single(values) => self.walk_with(lanes, slices, values, x, walk),
        }
    }

    /// The same with other values.
    #[inline(always)]
    pub(in crate::kernels) fn walk_with<L: Lanes, V: Value>(
        &self,
        lanes: L,
        slices: Range<usize>,
        values: &Values<V>,
        x: &[f64],
        walk: &mut impl Walk<L>,
    ) {
        assert_eq!(x.len(), self.lines, "x must have one value per state");
        let fits =
            values.shifted.len() == self.bases.len() && values.gathered.len() == self.indices.len();
        assert!(fits, "values must be those of a matrix of this structure");
        // Slices begin where those before them end.
        let before = slices.start.checked_sub(1);
        let from = before.map_or(Slice::default(), |before| self.slices[before]);
        let (mut shifted, mut gathered) = (from.shifted as usize, from.gathered as usize);
        let mut line = from.apart as usize;
        for (number, to) in self.slices[slices].iter().enumerate() {
            let mut state = walk.nothing(lanes);
            while shifted < to.shifted as usize {
                // SAFETY: slices end within the slots, each of which has a base and
                // values; `new` takes no base but where eight values of x begin.
                let (base, value, x) = unsafe {
                    let base = *self.bases.get_unchecked(shifted);
                    debug_assert!(base as usize + size_of::<Eight>() / 8 <= x.len());
                    let x = &*x.as_ptr().add(base as usize).cast::<Eight>();
                    (base, values.shifted.get_unchecked(shifted), lanes.load(x))
                };
                walk.take(lanes, &mut state, V::load(lanes, value), x, lanes.ramp(base));
                shifted += 1;
                lanes.turn();
            }
            while gathered < to.gathered as usize {
                // SAFETY: as above; `new` takes no index that is not below the number of
                // lines, which x has values for, and at most 2^31 − 1.
                let (indices, value, x) = unsafe {
                    let indices = self.indices.get_unchecked(gathered);
                    (indices, values.gathered.get_unchecked(gathered), lanes.gather(x, indices))
                };
                let index = lanes.indices(indices);
                walk.take_gathered(lanes, &mut state, V::load(lanes, value), x, index);
                gathered += 1;
                lanes.turn();
            }
            if line < to.apart as usize {
                self.walk_apart(lanes, line..to.apart as usize, values, x, (walk, &mut state));
                line = to.apart as usize;
            }
            walk.slice(lanes, number, state);
        }
    }

    /// Goes through what some lines of a slice have apart.
    #[inline(always)]
    fn walk_apart<L: Lanes, V: Value, W: Walk<L>>(
        &self,
        lanes: L,
        lines: Range<usize>,
        values: &Values<V>,
        x: &[f64],
        (walk, state): (&mut W, &mut W::State),
    ) {
        let before = lines.start.checked_sub(1);
        let mut start = before.map_or(0, |before| self.apart[before].end as usize);
        for line in &self.apart[lines] {
            let range = start..line.end as usize;
            start = range.end;
            let (indices, values) = (&self.apart_indices[range.clone()], &values.apart[range]);
            let entries = indices.iter().zip(values);
            let entries = entries.map(|(&j, &value)| (value.into(), x[j as usize], j));
            walk.take_apart(lanes, state, line.lane as usize, entries);
        }
    }
}
