//! Vectors on their way through eight segments, one segment in each lane.

use crate::semiring::Semiring;
use crate::simd::{Eight, Simd};
use crate::vector::Packed;

/// The matrix of a model of N states, its values or their logarithms, column after column and row
/// after row.
#[derive(Debug, Clone, Copy)]
pub struct SmallModel<const N: usize> {
    pub columns: [[f64; N]; N],
    pub rows: [[f64; N]; N],
    /// Least likelihood above 0 (score above −∞) for which several steps can go unchecked.
    pub least: f64,
}

/// A vector in each segment, times 2^exponent (or plus it, for logarithms).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaled<const N: usize> {
    pub values: [Eight; N],
    pub exponents: Eight,
}

/// Likelihoods of a step in each segment, or their logarithms.
pub(super) type SegmentStep<const N: usize> = [Packed; N];

/// A vector on its way through the segments.
#[derive(Clone, Copy)]
pub(super) struct SegmentVectors<S: Simd, const N: usize> {
    pub(super) x: [S::V; N],
    pub(super) exponents: S::V,
}

impl<S: Simd, const N: usize> SegmentVectors<S, N> {
    #[inline(always)]
    pub(super) fn new(s: S, x: &[Eight; N]) -> Self {
        let mut running = Self { x: [s.splat(0.0); N], exponents: s.splat(0.0) };
        for (to, x) in running.x.iter_mut().zip(x) {
            *to = s.load(x);
        }
        running
    }

    /// Replaces x by the product of the matrix with x.
    #[inline(always)]
    pub(super) fn multiply(&mut self, s: S, ring: impl Semiring, columns: &[[f64; N]; N]) {
        // N is a constant: both loops are unrolled, and all of x stays in registers.
        let x = self.x;
        for (i, out) in self.x.iter_mut().enumerate() {
            *out = ring.times(s, s.splat(columns[0][i]), x[0]);
            for j in 1..N {
                *out = ring.plus(s, *out, ring.times(s, s.splat(columns[j][i]), x[j]));
            }
        }
    }

    #[inline(always)]
    pub(super) fn observe(&mut self, s: S, ring: impl Semiring, b: &SegmentStep<N>) {
        for (x, b) in self.x.iter_mut().zip(b) {
            *x = ring.times(s, *x, s.load(b));
        }
    }

    #[inline(always)]
    pub(super) fn sum(&self, s: S) -> S::V {
        let mut sum = self.x[0];
        for x in &self.x[1..] {
            sum = s.add(sum, *x);
        }
        sum
    }

    #[inline(always)]
    pub(super) fn store(&self, s: S, factor: S::V, out: &mut SegmentStep<N>) {
        for (x, out) in self.x.iter().zip(out) {
            s.store(s.mul(*x, factor), out);
        }
    }
}

/// Brings vectors back to the middle range, if one is beyond. Returns true if so, and `None` if
/// values of a vector are too far apart.
#[inline(always)]
pub(super) fn keep_range<S: Simd, const N: usize>(
    s: S,
    ring: impl Semiring,
    all: &mut [SegmentVectors<S, N>],
) -> Option<bool> {
    let (mut least, mut largest) = (all[0].x[0], all[0].x[0]);
    for running in &*all {
        for x in &running.x {
            (least, largest) = (s.min(*x, least), s.max(*x, largest));
        }
    }
    // One test covers all lanes and vectors, and nearly always finds nothing to scale. It compares
    // single values, not sums, and so may fire for a vector that needs no scale, which `rescale`
    // leaves as it is.
    if ring.is_near(s, least, largest) {
        return Some(false);
    }
    // Each vector is rescaled by itself, as each has its own exponents.
    for running in all {
        if !ring.rescale(s, &mut running.x, &mut running.exponents) {
            return None;
        }
    }
    Some(true)
}
