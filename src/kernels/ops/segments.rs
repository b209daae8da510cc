//! Eight segments of one sequence, one in each lane, under a model of few states: a step waits for
//! the last one, but not for those of other segments.
//!
//! The range is looked at after every few steps; [`Semiring::rescale`] keeps it.

use super::semiring::{MaxPlus, Semiring, SumProduct};
use crate::kernels::layout::Packed;
use crate::kernels::simd::{Eight, LANES, Simd, WithSimd, run};
use crate::range::UNLOOKED;

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
    fn multiply(&mut self, s: S, ring: impl Semiring<S>, columns: &[[f64; N]; N]) {
        let x = self.x;
        for (i, out) in self.x.iter_mut().enumerate() {
            *out = ring.times(s, s.splat(columns[0][i]), x[0]);
            for j in 1..N {
                *out = ring.plus(s, *out, ring.times(s, s.splat(columns[j][i]), x[j]));
            }
        }
    }

    #[inline(always)]
    fn observe(&mut self, s: S, ring: impl Semiring<S>, b: &SegmentStep<N>) {
        for (x, b) in self.x.iter_mut().zip(b) {
            *x = ring.times(s, *x, s.load(b));
        }
    }

    #[inline(always)]
    fn is_near(&self, s: S) -> bool {
        let (mut least, mut largest) = (self.x[0], self.x[0]);
        for i in 1..N {
            (least, largest) = (s.min(self.x[i], least), s.max(self.x[i], largest));
        }
        SumProduct.is_near(s, least, largest)
    }

    #[inline(always)]
    fn rescale(&mut self, s: S, ring: impl Semiring<S>) -> bool {
        ring.rescale(s, &mut self.x, &mut self.exponents)
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

/// The products B(y_k) A … B(y_1) A of each segment, column after column.
pub(crate) struct MultiplySegments<'a, R, const N: usize> {
    pub(in crate::kernels) ring: R,
    pub(in crate::kernels) model: &'a Few<N>,
    pub(in crate::kernels) likelihoods: &'a [SegmentStep<N>],
}

macro_rules! multiply_segments {
    ($($ring:ty),*) => {$(
        impl<const N: usize> WithSimd for MultiplySegments<'_, $ring, N> {
            type Output = Option<[Scaled<N>; N]>;

            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> Option<[Scaled<N>; N]> {
                // As many columns at a time as registers hold.
                if const { N <= 3 } { self.columns::<S, N>(s) } else { self.columns::<S, 2>(s) }
            }
        }

        impl<const N: usize> MultiplySegments<'_, $ring, N> {
            #[inline(always)]
            fn columns<S: Simd, const C: usize>(&self, s: S) -> Option<[Scaled<N>; N]> {
                debug_assert!(N.is_multiple_of(C), "columns are taken C at a time");
                let Self { ring, model, likelihoods } = *self;
                let zero = <$ring as Semiring<S>>::ZERO;
                let mut least = s.splat(f64::INFINITY);
                let mut out = [Scaled { values: [[0.0; LANES]; N], exponents: [0.0; LANES] }; N];
                for (number, out) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                    let mut running = [Running::new(s, &[[zero; LANES]; N]); C];
                    for (c, running) in running.iter_mut().enumerate() {
                        running.x[number * C + c] = s.splat(<$ring as Semiring<S>>::ONE);
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
                        let (mut lowest, mut highest) = (running[0].x[0], running[0].x[0]);
                        for running in &running {
                            for i in 0..N {
                                lowest = s.min(running.x[i], lowest);
                                highest = s.max(running.x[i], highest);
                            }
                        }
                        if !ring.is_near(s, lowest, highest) {
                            for running in &mut running {
                                if !running.rescale(s, ring) {
                                    return None;
                                }
                            }
                        }
                    }
                    for (out, running) in out.iter_mut().zip(running) {
                        for i in 0..N {
                            s.store(running.x[i], &mut out.values[i]);
                        }
                        s.store(running.exponents, &mut out.exponents);
                    }
                }
                if s.any(s.lt(least, s.splat(model.least))) {
                    // Zeros are below, too: rarely there is more to find.
                    let above = likelihoods.as_flattened().iter().flat_map(|b| b.0);
                    if above.into_iter().any(|b| b > zero && b < model.least) {
                        return None;
                    }
                }
                Some(out)
            }
        }
    )*};
}
multiply_segments!(SumProduct, MaxPlus);

/// Returns the products of the matrices of each segment; `None` if their range is too wide.
pub(crate) fn multiply_segments<R, const N: usize>(
    ring: R,
    model: &Few<N>,
    likelihoods: &[SegmentStep<N>],
) -> Option<[Scaled<N>; N]>
where
    for<'a> MultiplySegments<'a, R, N>: WithSimd<Output = Option<[Scaled<N>; N]>>,
{
    run(MultiplySegments { ring, model, likelihoods })
}

/// Filtered distributions of each segment, and p(y_k | y_1 … y_{k-1}) up to scales of the
/// likelihoods, from x before its first step.
pub(in crate::kernels) struct FilterSegments<'a, const N: usize> {
    pub(in crate::kernels) model: &'a Few<N>,
    pub(in crate::kernels) starts: &'a [Eight; N],
    pub(in crate::kernels) likelihoods: &'a [SegmentStep<N>],
    pub(in crate::kernels) out: &'a mut [SegmentStep<N>],
    pub(in crate::kernels) normalizers: &'a mut [Packed],
}

impl<const N: usize> WithSimd for FilterSegments<'_, N> {
    type Output = bool;

    /// The recursion itself does not wait for a division.
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Self { model, starts, likelihoods, out, normalizers } = self;
        let one = s.splat(1.0);
        let mut running = Running::new(s, starts);
        let mut factor = s.div(one, running.sum(s));
        let places = out.chunks_mut(UNLOOKED).zip(normalizers.chunks_mut(UNLOOKED));
        for (steps, (out, normalizers)) in likelihoods.chunks(UNLOOKED).zip(places) {
            for ((b, out), normalizer) in steps.iter().zip(out).zip(normalizers) {
                running.multiply(s, SumProduct, &model.columns);
                running.observe(s, SumProduct, b);
                let sum = running.sum(s);
                s.store(s.mul(sum, factor), normalizer);
                factor = s.div(one, sum);
                running.store(s, factor, out);
            }
            if !running.is_near(s) {
                if !running.rescale(s, SumProduct) {
                    return false;
                }
                factor = s.div(one, running.sum(s));
            }
        }
        true
    }
}

/// Filters all steps of the segments. Returns false if their range is too wide.
pub(crate) fn filter_segments<const N: usize>(
    model: &Few<N>,
    starts: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    out: &mut [SegmentStep<N>],
    normalizers: &mut [Packed],
) -> bool {
    run(FilterSegments { model, starts, likelihoods, out, normalizers })
}

/// Smoothed distributions of each segment, from x before its first step and r after its last.
pub(in crate::kernels) struct SmoothSegments<'a, const N: usize> {
    pub(in crate::kernels) model: &'a Few<N>,
    pub(in crate::kernels) starts: &'a [Eight; N],
    pub(in crate::kernels) ends: &'a [Eight; N],
    pub(in crate::kernels) likelihoods: &'a [SegmentStep<N>],
    pub(in crate::kernels) out: &'a mut [SegmentStep<N>],
}

impl<const N: usize> WithSimd for SmoothSegments<'_, N> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Self { model, starts, ends, likelihoods, out } = self;
        let one = s.splat(1.0);
        let mut forward = Running::new(s, starts);
        for (steps, out) in likelihoods.chunks(UNLOOKED).zip(out.chunks_mut(UNLOOKED)) {
            for (b, out) in steps.iter().zip(out) {
                forward.multiply(s, SumProduct, &model.columns);
                forward.observe(s, SumProduct, b);
                forward.store(s, one, out);
            }
            if !forward.is_near(s) && !forward.rescale(s, SumProduct) {
                return false;
            }
        }
        let mut backward = Running::new(s, ends);
        for (steps, out) in likelihoods.rchunks(UNLOOKED).zip(out.rchunks_mut(UNLOOKED)) {
            for (b, out) in steps.iter().zip(out).rev() {
                let mut posterior = backward;
                posterior.observe(s, SumProduct, out);
                posterior.store(s, s.div(one, posterior.sum(s)), out);
                backward.observe(s, SumProduct, b);
                backward.multiply(s, SumProduct, &model.rows);
            }
            if !backward.is_near(s) && !backward.rescale(s, SumProduct) {
                return false;
            }
        }
        true
    }
}

/// Smooths all steps of the segments. Returns false if their range is too wide.
pub(crate) fn smooth_segments<const N: usize>(
    model: &Few<N>,
    starts: &[Eight; N],
    ends: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    out: &mut [SegmentStep<N>],
) -> bool {
    run(SmoothSegments { model, starts, ends, likelihoods, out })
}

/// Backpointers of a step: bit l of `[i][b]` is bit b of the best predecessor of state i in lane l.
pub(crate) type Backpointers<const N: usize> = [[u8; 2]; N];

/// Backpointers of each segment, from scores before its first step.
pub(in crate::kernels) struct DecodeSegments<'a, const N: usize> {
    pub(in crate::kernels) model: &'a Few<N>,
    pub(in crate::kernels) starts: &'a [Eight; N],
    pub(in crate::kernels) likelihoods: &'a [SegmentStep<N>],
    pub(in crate::kernels) from: &'a mut [Backpointers<N>],
}

impl<const N: usize> WithSimd for DecodeSegments<'_, N> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        const { assert!(N <= 4, "two bits for a state") };
        let Self { model: Few { columns, .. }, starts, likelihoods, from } = self;
        let mut scores = Running::new(s, starts);
        for (steps, from) in likelihoods.chunks(UNLOOKED).zip(from.chunks_mut(UNLOOKED)) {
            for (b, from) in steps.iter().zip(from) {
                let x = scores.x;
                for i in 0..N {
                    let mut best = s.add(s.splat(columns[0][i]), x[0]);
                    let mut bits = [0_u8; 2];
                    for j in 1..N {
                        let score = s.add(s.splat(columns[j][i]), x[j]);
                        // The lowest of several that attain the maximum stays.
                        let better = s.bits(s.lt(best, score));
                        best = s.max(score, best);
                        for (bit, bits) in bits.iter_mut().enumerate() {
                            let set = if j >> bit & 1 == 1 { better } else { 0 };
                            *bits = *bits & !better | set;
                        }
                    }
                    scores.x[i] = s.add(best, s.load(&b[i]));
                    from[i] = bits;
                }
            }
            if !scores.rescale(s, MaxPlus) {
                return false;
            }
        }
        true
    }
}

/// Writes the backpointers of the segments. Returns false if their range is too wide.
pub(crate) fn decode_segments<const N: usize>(
    model: &Few<N>,
    starts: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    from: &mut [Backpointers<N>],
) -> bool {
    run(DecodeSegments { model, starts, likelihoods, from })
}
