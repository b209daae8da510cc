//! Loops over eight densities side by side: differences, distances and elimination.
//!
//! A block holds eight densities, an [`Eight`] one value of each. No lane depends on another, so
//! that a result does not depend on how many densities there are; lanes beyond the last density are
//! computed and ignored.

use super::form::{Shape, packed};
use wayfix_kernels::{Eight, Simd, WithSimd};

/// ‖W δ‖² for a lower triangular W, the squared Mahalanobis distance.
#[inline(always)]
pub(super) fn triangular<S: Simd>(s: S, factor: &[Eight], deltas: &[Eight]) -> S::V {
    // Row r of the packed triangle has r + 1 entries, from `at` onwards.
    let (mut squares, mut at) = (s.splat(0.0), 0);
    for row in 0..deltas.len() {
        let mut z = s.splat(0.0);
        for (w, delta) in factor[at..=at + row].iter().zip(deltas) {
            z = s.add(z, s.mul(s.load(w), s.load(delta)));
        }
        squares = s.add(squares, s.mul(z, z));
        at += row + 1;
    }
    squares
}

/// Σ (w δ)² over the components that are not missing, whose δ is 0.
#[inline(always)]
fn diagonal<S: Simd>(s: S, factor: &[Eight], deltas: &[Eight]) -> S::V {
    let mut squares = s.splat(0.0);
    for (w, delta) in factor.iter().zip(deltas) {
        let z = s.mul(s.load(w), s.load(delta));
        squares = s.add(squares, s.mul(z, z));
    }
    squares
}

/// Writes the squared distances (y − μ)' Σ⁻¹ (y − μ). With a triangular factor no component may be
/// missing.
pub(super) struct Distances<'a, D> {
    pub(super) shape: Shape,
    pub(super) factors: &'a [Eight],
    /// Memory for the differences of a block.
    pub(super) deltas: &'a mut [Eight],
    /// Source of the differences.
    pub(super) differences: &'a D,
    pub(super) out: &'a mut [Eight],
}

/// Differences of an observation from the centres of a block of densities, 0 for missing
/// components.
pub(crate) trait Differences {
    fn write<S: Simd>(&self, s: S, block: usize, out: &mut [Eight]);
}

/// Differences from means; 0 for missing components.
pub(super) struct FromMeans<'a> {
    pub(super) y: &'a [f64],
    pub(super) centres: &'a [Eight],
}

impl Differences for FromMeans<'_> {
    #[inline(always)]
    fn write<S: Simd>(&self, s: S, block: usize, out: &mut [Eight]) {
        let d = self.y.len();
        let centres = &self.centres[block * d..][..d];
        for ((out, centre), &y) in out.iter_mut().zip(centres).zip(self.y) {
            if y.is_nan() {
                *out = Eight::default();
            } else {
                s.store(s.sub(s.splat(y), s.load(centre)), out);
            }
        }
    }
}

impl<D: Differences> WithSimd for Distances<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { shape, factors, deltas, differences, out } = self;
        let stride = shape.entries(deltas.len());
        for (block, out) in out.iter_mut().enumerate() {
            differences.write(s, block, deltas);
            let factor = &factors[block * stride..][..stride];
            let squares = match shape {
                Shape::Triangular => triangular(s, factor, deltas),
                Shape::Diagonal => diagonal(s, factor, deltas),
            };
            s.store(squares, out);
        }
    }
}

/// Eliminates the observed components of a block from its differences and covariances.
///
/// With o for observed and m for missing components (NaN in `y`), Gaussian elimination leaves the
/// missing ones with −Σ_mo Σ_oo⁻¹ δ_o, which is their mean less their conditional expectation, and
/// with their conditional covariance Σ_mm − Σ_mo Σ_oo⁻¹ Σ_om.
pub(super) struct Eliminate<'a> {
    pub(super) y: &'a [f64],
    /// Differences, 0 for missing components, and covariances, packed.
    pub(super) deltas: &'a mut [Eight],
    pub(super) covariance: &'a mut [Eight],
    /// Squared distance of the observed components.
    pub(super) distance: &'a mut Eight,
    /// Pivots: the diagonal entry of each observed component when it is eliminated.
    pub(super) pivots: &'a mut [Eight],
}

impl WithSimd for Eliminate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { y, deltas, covariance, distance, pivots } = self;
        let d = y.len();
        // Before component k is eliminated, `deltas` and `covariance` of those left are conditional
        // on the observed components before k. So δ_k² / pivot is the squared distance of y_k in
        // its conditional distribution; their sum is δ_o' Σ_oo⁻¹ δ_o, and the product of the
        // pivots is det Σ_oo.
        let mut squares = s.splat(0.0);
        for k in (0..d).filter(|k| !y[*k].is_nan()) {
            // Observed components before k are done; missing ones stay to the end.
            let left = |i: &usize| *i > k || y[*i].is_nan();
            let pivot = s.load(&covariance[packed(k, k)]);
            s.store(pivot, &mut pivots[k]);
            let delta = s.load(&deltas[k]);
            let scaled = s.div(delta, pivot);
            squares = s.add(squares, s.mul(delta, scaled));
            for i in (0..d).filter(left) {
                let entry = s.load(&covariance[packed(i, k)]);
                s.store(s.sub(s.load(&deltas[i]), s.mul(entry, scaled)), &mut deltas[i]);
                let factor = s.div(entry, pivot);
                // Column k itself is not overwritten, so that all rows read it unchanged.
                for j in (0..=i).filter(left) {
                    let product = s.mul(factor, s.load(&covariance[packed(j, k)]));
                    let out = &mut covariance[packed(i, j)];
                    s.store(s.sub(s.load(out), product), out);
                }
            }
        }
        s.store(squares, distance);
    }
}
