//! Eight segments of one sequence, one in each lane, under a model of few states: a step waits for
//! the last one, but not for those of other segments.
//!
//! The range is looked at after every few steps; [`Ring::rescale`] keeps it.

use super::chain::better;
use super::semiring::{MaxPlus, Ring, SumProduct};
use crate::kernels::layout::Packed;
use crate::kernels::simd::{Eight, LANES, Simd, kernels};
use crate::limits::UNLOOKED;

/// The matrix of a model of N states, its values or their logarithms, column after column and row
/// after row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Few<const N: usize> {
    pub(crate) columns: [[f64; N]; N],
    pub(crate) rows: [[f64; N]; N],
    /// Likelihoods above 0 must not be below this (scores above −∞), to go several steps unlooked
    /// at.
    pub(crate) least: f64,
}

/// A vector in each segment, times 2^exponent (or plus it, for logarithms).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaled<const N: usize> {
    pub(crate) values: [Eight; N],
    pub(crate) exponents: Eight,
}

/// Likelihoods of a step in each segment, or their logarithms.
pub(crate) type SegmentStep<const N: usize> = [Packed; N];

/// A vector on its way through the segments.
#[derive(Clone, Copy)]
struct Running<S: Simd, const N: usize> {
    x: [S::V; N],
    exponents: S::V,
}

impl<S: Simd, const N: usize> Running<S, N> {
    #[inline(always)]
    fn new(s: S, x: &[Eight; N]) -> Self {
        let mut running = Self { x: [s.splat(0.0); N], exponents: s.splat(0.0) };
        for (to, x) in running.x.iter_mut().zip(x) {
            *to = s.load(x);
        }
        running
    }

    /// x becomes the product of the matrix with x.
    #[inline(always)]
    fn multiply(&mut self, s: S, ring: impl Ring, columns: &[[f64; N]; N]) {
        let x = self.x;
        for (i, out) in self.x.iter_mut().enumerate() {
            *out = ring.times(s, s.splat(columns[0][i]), x[0]);
            for j in 1..N {
                *out = ring.plus(s, *out, ring.times(s, s.splat(columns[j][i]), x[j]));
            }
        }
    }

    #[inline(always)]
    fn observe(&mut self, s: S, ring: impl Ring, b: &SegmentStep<N>) {
        for (x, b) in self.x.iter_mut().zip(b) {
            *x = ring.times(s, *x, s.load(b));
        }
    }

    #[inline(always)]
    fn sum(&self, s: S) -> S::V {
        let mut sum = self.x[0];
        for x in &self.x[1..] {
            sum = s.add(sum, *x);
        }
        sum
    }

    #[inline(always)]
    fn store(&self, s: S, factor: S::V, out: &mut SegmentStep<N>) {
        for (x, out) in self.x.iter().zip(out) {
            s.store(s.mul(*x, factor), out);
        }
    }
}

/// Brings vectors back to the middle range, if one is beyond. Returns true if so, and `None` if
/// values of a vector are too far apart.
#[inline(always)]
fn keep_range<S: Simd, const N: usize>(
    s: S,
    ring: impl Ring,
    all: &mut [Running<S, N>],
) -> Option<bool> {
    let (mut least, mut largest) = (all[0].x[0], all[0].x[0]);
    for running in &*all {
        for x in &running.x {
            (least, largest) = (s.min(*x, least), s.max(*x, largest));
        }
    }
    if ring.is_near(s, least, largest) {
        return Some(false);
    }
    for running in all {
        if !ring.rescale(s, &mut running.x, &mut running.exponents) {
            return None;
        }
    }
    Some(true)
}

kernels! {
    /// Returns the products B(y_k) A … B(y_1) A of each segment, column after column; `None` if
    /// their range is too wide.
    pub(crate) fn multiply_segments = multiply<'a, type R: Ring, const N>(
        ring: R, model: &'a Few<N>, likelihoods: &'a [SegmentStep<N>],
    ) -> Option<[Scaled<N>; N]>;

    /// Filters all steps of the segments, from x before the first: distributions, and
    /// p(y_k | y_1 … y_{k-1}) up to scales of the likelihoods. `None` if their range is too wide.
    pub(crate) fn filter_segments = filter<'a, const N>(
        model: &'a Few<N>, starts: &'a [Eight; N], likelihoods: &'a [SegmentStep<N>],
        out: &'a mut [SegmentStep<N>], normalizers: &'a mut [Packed],
    ) -> Option<()>;

    /// Smooths all steps of the segments, from x before the first and r after the last. `None` if
    /// their range is too wide.
    pub(crate) fn smooth_segments = smooth<'a, const N>(
        model: &'a Few<N>, starts: &'a [Eight; N], ends: &'a [Eight; N],
        likelihoods: &'a [SegmentStep<N>], out: &'a mut [SegmentStep<N>],
    ) -> Option<()>;

    /// Writes the backpointers of the segments, from scores before the first step. `None` if their
    /// range is too wide.
    pub(crate) fn decode_segments = decode<'a, const N>(
        model: &'a Few<N>, starts: &'a [Eight; N], likelihoods: &'a [SegmentStep<N>],
        from: &'a mut [Backpointers<N>],
    ) -> Option<()>;
}

#[inline(always)]
fn multiply<S: Simd, R: Ring, const N: usize>(
    s: S,
    ring: R,
    model: &Few<N>,
    likelihoods: &[SegmentStep<N>],
) -> Option<[Scaled<N>; N]> {
    let mut out = [Scaled { values: [[0.0; LANES]; N], exponents: [0.0; LANES] }; N];
    // As many columns at a time as registers hold.
    let least = if const { N <= 3 } {
        columns::<S, R, N, N>(s, ring, model, likelihoods, &mut out)?
    } else {
        columns::<S, R, N, 2>(s, ring, model, likelihoods, &mut out)?
    };
    if s.any(s.lt(least, s.splat(model.least))) {
        // Zeros are below, too: rarely there is more to find.
        let above = likelihoods.as_flattened().iter().flat_map(|b| b.0);
        if above.into_iter().any(|b| b > R::ZERO && b < model.least) {
            return None;
        }
    }
    Some(out)
}

/// Computes columns of products, C at a time. Returns the least likelihoods.
#[inline(always)]
fn columns<S: Simd, R: Ring, const N: usize, const C: usize>(
    s: S,
    ring: R,
    model: &Few<N>,
    likelihoods: &[SegmentStep<N>],
    out: &mut [Scaled<N>; N],
) -> Option<S::V> {
    debug_assert!(N.is_multiple_of(C), "columns are taken C at a time");
    let mut least = s.splat(f64::INFINITY);
    for (number, out) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
        let mut running = [Running::new(s, &[[R::ZERO; LANES]; N]); C];
        for (c, running) in running.iter_mut().enumerate() {
            running.x[number * C + c] = s.splat(R::ONE);
        }
        for steps in likelihoods.chunks(UNLOOKED) {
            for b in steps {
                for b in b {
                    least = s.min(s.load(b), least);
                }
                for running in &mut running {
                    running.multiply(s, ring, &model.columns);
                    running.observe(s, ring, b);
                }
            }
            keep_range(s, ring, &mut running)?;
        }
        for (out, running) in out.iter_mut().zip(running) {
            for i in 0..N {
                s.store(running.x[i], &mut out.values[i]);
            }
            s.store(running.exponents, &mut out.exponents);
        }
    }
    Some(least)
}

/// The recursion itself does not wait for a division.
#[inline(always)]
fn filter<S: Simd, const N: usize>(
    s: S,
    model: &Few<N>,
    starts: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    out: &mut [SegmentStep<N>],
    normalizers: &mut [Packed],
) -> Option<()> {
    let one = s.splat(1.0);
    let mut running = [Running::new(s, starts)];
    let mut factor = s.div(one, running[0].sum(s));
    let places = out.chunks_mut(UNLOOKED).zip(normalizers.chunks_mut(UNLOOKED));
    for (steps, (out, normalizers)) in likelihoods.chunks(UNLOOKED).zip(places) {
        for ((b, out), normalizer) in steps.iter().zip(out).zip(normalizers) {
            let [running] = &mut running;
            running.multiply(s, SumProduct, &model.columns);
            running.observe(s, SumProduct, b);
            let sum = running.sum(s);
            s.store(s.mul(sum, factor), normalizer);
            factor = s.div(one, sum);
            running.store(s, factor, out);
        }
        if keep_range(s, SumProduct, &mut running)? {
            factor = s.div(one, running[0].sum(s));
        }
    }
    Some(())
}

#[inline(always)]
fn smooth<S: Simd, const N: usize>(
    s: S,
    model: &Few<N>,
    starts: &[Eight; N],
    ends: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    out: &mut [SegmentStep<N>],
) -> Option<()> {
    let one = s.splat(1.0);
    let mut forward = [Running::new(s, starts)];
    for (steps, out) in likelihoods.chunks(UNLOOKED).zip(out.chunks_mut(UNLOOKED)) {
        for (b, out) in steps.iter().zip(out) {
            forward[0].multiply(s, SumProduct, &model.columns);
            forward[0].observe(s, SumProduct, b);
            forward[0].store(s, one, out);
        }
        keep_range(s, SumProduct, &mut forward)?;
    }
    let mut backward = [Running::new(s, ends)];
    for (steps, out) in likelihoods.rchunks(UNLOOKED).zip(out.rchunks_mut(UNLOOKED)) {
        for (b, out) in steps.iter().zip(out).rev() {
            let mut posterior = backward[0];
            posterior.observe(s, SumProduct, out);
            posterior.store(s, s.div(one, posterior.sum(s)), out);
            backward[0].observe(s, SumProduct, b);
            backward[0].multiply(s, SumProduct, &model.rows);
        }
        keep_range(s, SumProduct, &mut backward)?;
    }
    Some(())
}

/// Backpointers of a step: bit l of `[i][b]` is bit b of the best predecessor of state i in lane l.
pub(crate) type Backpointers<const N: usize> = [[u8; 2]; N];

#[inline(always)]
fn decode<S: Simd, const N: usize>(
    s: S,
    Few { columns, .. }: &Few<N>,
    starts: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    from: &mut [Backpointers<N>],
) -> Option<()> {
    const { assert!(N <= 4, "two bits for a state") };
    let mut scores = [Running::new(s, starts)];
    for (steps, from) in likelihoods.chunks(UNLOOKED).zip(from.chunks_mut(UNLOOKED)) {
        for (b, from) in steps.iter().zip(from) {
            let x = scores[0].x;
            for i in 0..N {
                let mut best = s.add(s.splat(columns[0][i]), x[0]);
                let mut bits = [0; 2];
                for j in 1..N {
                    best = better(s, best, s.add(s.splat(columns[j][i]), x[j]), j, &mut bits);
                }
                scores[0].x[i] = s.add(best, s.load(&b[i]));
                from[i] = bits;
            }
        }
        keep_range(s, MaxPlus, &mut scores)?;
    }
    Some(())
}
