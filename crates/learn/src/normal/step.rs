//! E step of normal densities: distances of an observation, and expectations of missing components.
//!
//! The memory of a step is in blocks of eight: first a distance for each block of densities, then a
//! log-norm for each, then the differences of one block; for elimination its packed covariance and
//! one more vector follow.

use wayfix_kernels::{Eight, LANES, Simd, WithSimd, run};

use super::covariance::{Shape, packed};
use super::moments::Moments;
use super::{LN_2_PI, Normals};
use crate::EmissionError;
use crate::error::{check_components, check_values};

impl Normals {
    /// Number of blocks of eight densities.
    pub(crate) fn blocks(&self) -> usize {
        self.log_norms.len()
    }

    /// Size of the memory of a step, in blocks of eight.
    pub(crate) fn scratch_blocks(&self) -> usize {
        let elimination = self.settings.missing && self.kind.shape() == Shape::Triangular;
        2 * self.blocks() + self.d + if elimination { self.elimination_memory() } else { 0 }
    }

    /// Size of the memory that elimination takes in addition: a packed covariance, and the pivots.
    fn elimination_memory(&self) -> usize {
        self.d + Shape::Triangular.entries(self.d)
    }

    /// Writes to `memory` the squared distance of an observation from each mean, and after these
    /// the logarithm of each density at its mean. Both are for the components that are not missing;
    /// returns their number.
    #[inline]
    pub(crate) fn distances(
        &self,
        y: &[f64],
        memory: &mut [Eight],
    ) -> Result<usize, EmissionError> {
        let observed = self.check(y)?;
        self.distances_from(&FromMeans { y, centres: &self.centres }, y, observed, memory)?;
        Ok(observed)
    }

    /// Like [`distances`](Self::distances), but with the given differences of an observation that
    /// has been checked and has `observed` components.
    #[inline]
    pub(crate) fn distances_from(
        &self,
        differences: &impl Differences,
        y: &[f64],
        observed: usize,
        memory: &mut [Eight],
    ) -> Result<(), EmissionError> {
        let (d, triangular) = (self.d, self.kind.shape() == Shape::Triangular);
        // The marginal of some components is the normal density with their rows and columns of Σ,
        // whose factor is not a part of W: it takes an elimination, block by block.
        if observed < d && triangular {
            return (0..self.blocks())
                .try_for_each(|block| self.eliminate(y, differences, block, memory));
        }
        let (out, rest) = memory.split_at_mut(self.blocks());
        let (norms, rest) = rest.split_at_mut(self.blocks());
        let (factors, deltas) = (&*self.factors, &mut rest[..d]);
        run(Distances { shape: self.kind.shape(), factors, deltas, differences, out });
        // Uncorrelated components: a missing one has a difference of 0, and adds no norm.
        norms.copy_from_slice(&self.log_norms);
        if observed < d {
            for (norms, parts) in norms.iter_mut().zip(self.missing_cache.chunks_exact(d)) {
                *norms = Eight::default();
                for (part, _) in parts.iter().zip(y).filter(|part| !part.1.is_nan()) {
                    norms.iter_mut().zip(part).for_each(|(norm, part)| *norm += part);
                }
            }
        }
        Ok(())
    }

    /// Checks an observation, and returns the number of its components that are not missing.
    #[inline]
    pub(crate) fn check(&self, y: &[f64]) -> Result<usize, EmissionError> {
        check_components(y, self.d)?;
        // y · 0 is 0 for a finite y and NaN otherwise: one test without branches for the usual
        // case.
        if y.iter().map(|y| y * 0.0).sum::<f64>() == 0.0 {
            return Ok(self.d);
        }
        let is_missing = |y: f64| self.settings.missing && y.is_nan();
        let expected = if self.settings.missing {
            "a finite value, or NaN if it is missing"
        } else {
            "a finite value (NaN for a missing one only with `with_missing`)"
        };
        check_values(y, |y| y.is_finite() || is_missing(y), expected)?;
        Ok(y.iter().filter(|y| !y.is_nan()).count())
    }

    /// Writes the distances and log-norms of one block for an observation with missing components.
    /// After both, `memory` then holds differences and covariances as [`Eliminate`] leaves them.
    fn eliminate(
        &self,
        y: &[f64],
        differences: &impl Differences,
        block: usize,
        memory: &mut [Eight],
    ) -> Result<(), EmissionError> {
        let (d, entries) = (self.d, Shape::Triangular.entries(self.d));
        let (distances, rest) = memory.split_at_mut(self.blocks());
        let (norms, rest) = rest.split_at_mut(self.blocks());
        let (deltas, rest) = rest.split_at_mut(d);
        let (covariance, rest) = rest.split_at_mut(entries);
        covariance.copy_from_slice(&self.missing_cache[block * entries..][..entries]);
        run(Write { differences, block, out: deltas });
        let (distance, pivots) = (&mut distances[block], &mut rest[..d]);
        run(Eliminate { y, deltas, covariance, distance, pivots });
        norms[block] = Eight::default();
        for (component, pivot) in pivots.iter().enumerate().filter(|c| !y[c.0].is_nan()) {
            for (l, (norm, pivot)) in norms[block].iter_mut().zip(pivot).enumerate() {
                // The whole matrix has been factored, so pivots are positive up to rounding. The
                // log-norm is −½ Σ (ln 2π + ln pivot) over the observed components.
                if pivot.is_nan() || *pivot <= 0.0 {
                    let state = Some(block * LANES + l);
                    return Err(EmissionError::NotPositiveDefinite { state, component });
                }
                *norm -= 0.5 * (LN_2_PI + pivot.ln());
            }
        }
        Ok(())
    }

    /// Turns the distances in `memory` into logarithms of densities.
    #[inline]
    pub(crate) fn logs(&self, memory: &mut [Eight]) {
        let (distances, rest) = memory.split_at_mut(self.blocks());
        for (distance, norm) in distances.iter_mut().zip(rest) {
            for (distance, norm) in distance.iter_mut().zip(norm) {
                *distance = log_density_or_zero(*norm - 0.5 * *distance);
            }
        }
    }

    /// Writes the differences of a block.
    #[inline]
    pub(crate) fn write(&self, differences: &impl Differences, block: usize, out: &mut [Eight]) {
        run(Write { differences, block, out: &mut out[..self.d] });
    }

    /// Adds an observation with these weights for each block to moments. Missing components take
    /// part with their conditional distribution, whose covariance has the weights `conditional`.
    #[inline]
    pub(crate) fn add(
        &self,
        moments: &mut Moments,
        y: &[f64],
        weights: &[Eight],
        conditional: &[Eight],
        memory: &mut [Eight],
    ) {
        // Uncorrelated components carry no information on each other: missing ones are left out,
        // and each component has a weight of its own.
        let is_complete = !self.settings.missing || y.iter().all(|y| !y.is_nan());
        if is_complete || self.kind.shape() == Shape::Diagonal {
            return moments.add(weights, y, &self.centres);
        }
        if y.iter().all(|y| y.is_nan()) {
            return;
        }
        let differences = FromMeans { y, centres: &self.centres };
        for (block, weight) in weights.iter().enumerate() {
            if *weight == Eight::default() {
                continue;
            }
            let expected = self.expected(&differences, y, block, memory);
            // An observation without a likelihood has no posterior, and does not arrive here.
            let Ok((deltas, covariance)) = expected else { continue };
            // E[x x'] is the product of the expectations and the conditional covariance (Little and
            // Rubin 2002): the latter is 0 for observed components.
            moments.add_block(block, weight, deltas);
            let at = moments.scatter_mut(block);
            add_missing(at, 0, y, &conditional[block], covariance);
        }
    }

    /// Expected differences of a block, those of missing components given the others, with packed
    /// conditional covariances, which are valid between missing components only.
    pub(crate) fn expected<'a>(
        &self,
        differences: &impl Differences,
        y: &[f64],
        block: usize,
        memory: &'a mut [Eight],
    ) -> Result<(&'a [Eight], &'a [Eight]), EmissionError> {
        let d = self.d;
        self.eliminate(y, differences, block, memory)?;
        let (deltas, rest) = memory[2 * self.blocks()..].split_at_mut(d);
        // For a missing component, elimination started from 0 and left the mean less the
        // conditional expectation.
        for (delta, _) in deltas.iter_mut().zip(y).filter(|pair| pair.1.is_nan()) {
            delta.iter_mut().for_each(|delta| *delta = -*delta);
        }
        // Observed components get back the differences they had before the elimination; the pivots
        // are no longer needed.
        let (covariance, before) = rest.split_at_mut(Shape::Triangular.entries(d));
        run(Write { differences, block, out: &mut before[..d] });
        for ((delta, before), _) in
            deltas.iter_mut().zip(before).zip(y).filter(|pair| !pair.1.is_nan())
        {
            *delta = *before;
        }
        Ok((deltas, covariance))
    }
}

/// Adds the conditional covariances of missing components to a scatter, both packed. In the scatter
/// `before` other components precede those of `y`.
pub(crate) fn add_missing(
    scatter: &mut [Eight],
    before: usize,
    y: &[f64],
    weight: &Eight,
    covariance: &[Eight],
) {
    let is_missing = |i: &usize| y[*i].is_nan();
    for i in (0..y.len()).filter(is_missing) {
        for j in (0..=i).filter(is_missing) {
            let sums = scatter[packed(before + i, before + j)].iter_mut();
            let products = weight.iter().zip(&covariance[packed(i, j)]).map(|(w, c)| w * c);
            sums.zip(products).for_each(|(sum, product)| *sum += product);
        }
    }
}

/// Writes the differences of a block.
struct Write<'a, D> {
    differences: &'a D,
    block: usize,
    out: &'a mut [Eight],
}

impl<D: Differences> WithSimd for Write<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.differences.write(s, self.block, self.out);
    }
}

/// Logarithm of a density as a [`Diagonal`](wayfix::Diagonal) takes it: −∞ (a density of 0) below
/// −1e300, and where the distance overflowed to ∞ or NaN.
#[inline(always)]
pub(crate) fn log_density_or_zero(log: f64) -> f64 {
    // The comparison is false for NaN, such as that of ∞ − ∞ in a distance.
    if log >= -1e300 { log } else { f64::NEG_INFINITY }
}

/// View of a step's memory in blocks of eight.
pub(crate) fn as_blocks(values: &mut [f64]) -> &mut [Eight] {
    values.as_chunks_mut().0
}

/// Copies weights into blocks of eight, with 0 in the remaining lanes.
#[inline]
pub(crate) fn in_blocks(weights: &[f64], out: &mut [Eight]) {
    let (blocks, rest) = weights.as_chunks::<LANES>();
    out[..blocks.len()].copy_from_slice(blocks);
    if let Some(last) = out.get_mut(blocks.len()) {
        *last = Eight::default();
        last[..rest.len()].copy_from_slice(rest);
    }
}

// Loops over eight densities side by side: differences, distances and elimination.
//
// A block holds eight densities, an [`Eight`] one value of each. No lane depends on another, so a
// result does not depend on how many densities there are. Lanes beyond the last density are
// computed and ignored.

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
                // Column k itself is not overwritten, so all rows read it unchanged.
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
