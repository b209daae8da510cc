//! Eight segments of one sequence, one in each lane, under a model of few states: a step depends on
//! the previous one in its segment, but not on those of other segments.
//!
//! First the products B A … B A of each segment are computed, column after column. They give the
//! vectors at the start and the end of each segment; then formulas 2, 3 and 7 of the guide run in
//! all segments side by side. Products are associative: exactly for maxima of sums on the grid, up
//! to rounding for sums of products.
//!
//! The range is checked after every four steps, which `limits` ("Few states") shows to be enough;
//! [`Semiring::rescale`] keeps it.

use super::chain::keep_better;
use super::segment_vectors::{Scaled, SegmentStep, SegmentVectors, SmallModel, keep_range};
use crate::limits::STEPS_BETWEEN_CHECKS;
use crate::semiring::{MaxPlus, Semiring, SumProduct};
use crate::simd::{Eight, LANES, Simd, kernels};
use crate::vector::Packed;

kernels! {
    /// Returns the products B(y_k) A … B(y_1) A of each segment, column after column; `None` if
    /// their range is too wide.
    pub fn multiply_segments = multiply<'a, type R: Semiring, const N>(
        ring: R, model: &'a SmallModel<N>, likelihoods: &'a [SegmentStep<N>],
    ) -> Option<[Scaled<N>; N]>;

    /// Filters all steps of the segments, from x before the first: distributions, and
    /// p(y_k | y_1 … y_{k-1}) up to scales of the likelihoods. `None` if their range is too wide.
    pub fn filter_segments = filter<'a, const N>(
        model: &'a SmallModel<N>, starts: &'a [Eight; N], likelihoods: &'a [SegmentStep<N>],
        out: &'a mut [SegmentStep<N>], normalizers: &'a mut [Packed],
    ) -> Option<()>;

    /// Smooths all steps of the segments, from x before the first and r after the last. `None` if
    /// their range is too wide.
    pub fn smooth_segments = smooth<'a, const N>(
        model: &'a SmallModel<N>, starts: &'a [Eight; N], ends: &'a [Eight; N],
        likelihoods: &'a [SegmentStep<N>], out: &'a mut [SegmentStep<N>],
    ) -> Option<()>;

    /// Writes the backpointers of the segments, from scores before the first step. `None` if their
    /// range is too wide.
    pub fn decode_segments = decode<'a, const N>(
        model: &'a SmallModel<N>, starts: &'a [Eight; N], likelihoods: &'a [SegmentStep<N>],
        from: &'a mut [Backpointers<N>],
    ) -> Option<()>;
}

#[inline(always)]
fn multiply<S: Simd, R: Semiring, const N: usize>(
    s: S,
    ring: R,
    model: &SmallModel<N>,
    likelihoods: &[SegmentStep<N>],
) -> Option<[Scaled<N>; N]> {
    let mut out = [Scaled { values: [[0.0; LANES]; N], exponents: [0.0; LANES] }; N];
    // As many columns at a time as registers hold, with room for a product: three of three, or two
    // of four. Four of four would be stored and loaded at every step.
    let least = if const { N <= 3 } {
        columns::<S, R, N, N>(s, ring, model, likelihoods, &mut out)?
    } else {
        columns::<S, R, N, 2>(s, ring, model, likelihoods, &mut out)?
    };
    if s.any(s.lt(least, s.splat(model.least))) {
        // Zeros also compare below, and are usually the only hits.
        let above = likelihoods.as_flattened().iter().flat_map(|b| b.0);
        if above.into_iter().any(|b| b > R::ZERO && b < model.least) {
            return None;
        }
    }
    Some(out)
}

/// Computes columns of products, C at a time. Returns the least likelihoods.
#[inline(always)]
fn columns<S: Simd, R: Semiring, const N: usize, const C: usize>(
    s: S,
    ring: R,
    model: &SmallModel<N>,
    likelihoods: &[SegmentStep<N>],
    out: &mut [Scaled<N>; N],
) -> Option<S::V> {
    debug_assert!(N.is_multiple_of(C), "columns are taken C at a time");
    let mut least = s.splat(f64::INFINITY);
    for (number, out) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
        let mut running = [SegmentVectors::new(s, &[[R::ZERO; LANES]; N]); C];
        for (c, running) in running.iter_mut().enumerate() {
            // Column c of the product is what the product makes of unit vector c.
            running.x[number * C + c] = s.splat(R::ONE);
        }
        for steps in likelihoods.chunks(STEPS_BETWEEN_CHECKS) {
            for b in steps {
                // The running value comes second: `min` returns it if the other value is NaN.
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

#[inline(always)]
fn filter<S: Simd, const N: usize>(
    s: S,
    model: &SmallModel<N>,
    starts: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    out: &mut [SegmentStep<N>],
    normalizers: &mut [Packed],
) -> Option<()> {
    let one = s.splat(1.0);
    let mut running = [SegmentVectors::new(s, starts)];
    // The inverse of the sum before a step: a normaliser is the quotient of the sums after and
    // before it, in one scale.
    let mut factor = s.div(one, running[0].sum(s));
    let places =
        out.chunks_mut(STEPS_BETWEEN_CHECKS).zip(normalizers.chunks_mut(STEPS_BETWEEN_CHECKS));
    for (steps, (out, normalizers)) in likelihoods.chunks(STEPS_BETWEEN_CHECKS).zip(places) {
        for ((b, out), normalizer) in steps.iter().zip(out).zip(normalizers) {
            let [running] = &mut running;
            // The recursion carries `running` on unnormalised, so it needn't wait for the division;
            // only the stored results need it.
            running.multiply(s, SumProduct, &model.columns);
            running.observe(s, SumProduct, b);
            let sum = running.sum(s);
            s.store(s.mul(sum, factor), normalizer);
            factor = s.div(one, sum);
            running.store(s, factor, out);
        }
        // A rescaling changes the sum that the next normaliser divides by.
        if keep_range(s, SumProduct, &mut running)? {
            factor = s.div(one, running[0].sum(s));
        }
    }
    Some(())
}

#[inline(always)]
fn smooth<S: Simd, const N: usize>(
    s: S,
    model: &SmallModel<N>,
    starts: &[Eight; N],
    ends: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    out: &mut [SegmentStep<N>],
) -> Option<()> {
    let one = s.splat(1.0);
    let mut forward = [SegmentVectors::new(s, starts)];
    for (steps, out) in
        likelihoods.chunks(STEPS_BETWEEN_CHECKS).zip(out.chunks_mut(STEPS_BETWEEN_CHECKS))
    {
        for (b, out) in steps.iter().zip(out) {
            forward[0].multiply(s, SumProduct, &model.columns);
            forward[0].observe(s, SumProduct, b);
            // Not normalised: any factor of a step cancels in its posterior.
            forward[0].store(s, one, out);
        }
        keep_range(s, SumProduct, &mut forward)?;
    }
    // Chunks are counted from the end, where the vectors start; the short one comes last, as in the
    // forward pass.
    let mut backward = [SegmentVectors::new(s, ends)];
    for (steps, out) in
        likelihoods.rchunks(STEPS_BETWEEN_CHECKS).zip(out.rchunks_mut(STEPS_BETWEEN_CHECKS))
    {
        for (b, out) in steps.iter().zip(out).rev() {
            // `out` has α, up to a factor, until γ takes its place.
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
pub type Backpointers<const N: usize> = [[u8; 2]; N];

#[inline(always)]
fn decode<S: Simd, const N: usize>(
    s: S,
    SmallModel { columns, .. }: &SmallModel<N>,
    starts: &[Eight; N],
    likelihoods: &[SegmentStep<N>],
    from: &mut [Backpointers<N>],
) -> Option<()> {
    const { assert!(N <= 4, "two bits for a state") };
    let mut scores = [SegmentVectors::new(s, starts)];
    for (steps, from) in
        likelihoods.chunks(STEPS_BETWEEN_CHECKS).zip(from.chunks_mut(STEPS_BETWEEN_CHECKS))
    {
        for (b, from) in steps.iter().zip(from) {
            // A copy: the scores of all states before the step are needed for each.
            let x = scores[0].x;
            for i in 0..N {
                let mut best = s.add(s.splat(columns[0][i]), x[0]);
                let mut bits = [0; 2];
                for j in 1..N {
                    best = keep_better(s, best, s.add(s.splat(columns[j][i]), x[j]), j, &mut bits);
                }
                scores[0].x[i] = s.add(best, s.load(&b[i]));
                from[i] = bits;
            }
        }
        keep_range(s, MaxPlus, &mut scores)?;
    }
    Some(())
}
