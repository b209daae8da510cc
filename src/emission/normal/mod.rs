//! Sets of normal densities with cached factors, on which the Gaussian families stand.

mod factor;
mod lanes;
mod maximize;
mod moments;
mod prior;

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::EmissionError;
use crate::kernels::{Eight, LANES, run};
use lanes::{Distances, Eliminate, FromMeans, packed};

pub(super) use factor::inverse_factor;
pub(super) use lanes::Differences;
pub(super) use moments::Moments;
pub use prior::GaussianPrior;

/// ln 2π.
pub(super) const LN_2_PI: f64 = 1.837_877_066_409_345_6;

/// Difference of two entries that are taken for one, relative to the diagonal.
const SYMMETRY: f64 = 1e-9;

/// Form of the covariances of a Gaussian family.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum CovarianceType {
    /// One variance for all components, for each state.
    Spherical,
    /// One variance for each component and state.
    Diagonal,
    /// A symmetric matrix for each state.
    Full,
    /// One symmetric matrix for all states.
    Tied,
}

impl CovarianceType {
    /// Number of values of a covariance in d dimensions.
    pub(super) fn values(self, d: usize) -> usize {
        match self {
            Self::Spherical => 1,
            Self::Diagonal => d,
            Self::Full | Self::Tied => d * d,
        }
    }

    /// Number of values of a covariance that may be chosen freely.
    pub(super) fn free(self, d: usize) -> usize {
        match self {
            Self::Full | Self::Tied => d * (d + 1) / 2,
            other => other.values(d),
        }
    }

    fn shape(self) -> Shape {
        match self {
            Self::Spherical | Self::Diagonal => Shape::Diagonal,
            Self::Full | Self::Tied => Shape::Triangular,
        }
    }

    /// Name of a value of a covariance in errors.
    fn name(self) -> &'static str {
        if self.shape() == Shape::Diagonal { "variance" } else { "covariance" }
    }
}

/// Entries that are kept of a matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    Diagonal,
    Triangular,
}

impl Shape {
    /// Number of entries in d dimensions.
    #[inline(always)]
    pub(super) fn entries(self, d: usize) -> usize {
        match self {
            Self::Diagonal => d,
            Self::Triangular => d * (d + 1) / 2,
        }
    }

    /// Number of an entry; of a diagonal one, if only these are kept.
    pub(super) fn entry(self, i: usize, j: usize) -> usize {
        match self {
            Self::Diagonal => i,
            Self::Triangular => packed(i, j),
        }
    }
}

/// Normal densities of vectors of d components, with what a step needs of them in blocks of eight
/// densities.
#[derive(Debug, Clone)]
pub(super) struct Normals {
    kind: CovarianceType,
    d: usize,
    means: Vec<f64>,
    /// One covariance after the other; a single one if they are tied.
    covariances: Vec<f64>,
    missing: bool,
    centres: Vec<Eight>,
    /// Inverse Cholesky factors, or inverse deviations.
    factors: Vec<Eight>,
    /// Logarithms of the densities at the means.
    log_norms: Vec<Eight>,
    /// If components may be missing: packed covariances, or the part of each component in the
    /// logarithm of the density at the mean.
    parts: Vec<Eight>,
}

impl Normals {
    /// Factors the covariances, after all values were checked.
    pub(super) fn new(
        kind: CovarianceType,
        d: usize,
        means: Vec<f64>,
        covariances: Vec<f64>,
        missing: bool,
    ) -> Result<Self, EmissionError> {
        let (count, shape) = (means.len() / d, kind.shape());
        let (blocks, entries) = (count.div_ceil(LANES), shape.entries(d));
        let zeros = |each: usize| vec![Eight::default(); blocks * each];
        let mut new = Self {
            kind,
            d,
            means,
            covariances,
            missing,
            centres: zeros(d),
            factors: zeros(entries),
            log_norms: zeros(1),
            parts: Vec::new(),
        };
        let tied = if kind == CovarianceType::Tied { Some(new.factor(0)?) } else { None };
        for at in 0..count {
            let own = if tied.is_none() { Some(new.factor(at)?) } else { None };
            let (block, l) = (at / LANES, at % LANES);
            for (entry, value) in own.iter().chain(&tied).flatten().enumerate() {
                new.factors[block * entries + entry][l] = *value;
            }
            new.log_norms[block][l] = -0.5 * (d as f64 * LN_2_PI + new.log_determinant(at));
            for c in 0..d {
                new.centres[block * d + c][l] = new.means[at * d + c];
            }
        }
        if missing {
            new.parts = zeros(entries);
            // Identities where there is no density, which can be factored, too.
            for at in 0..blocks * LANES {
                for i in 0..d {
                    for j in if shape == Shape::Diagonal { i..i + 1 } else { 0..i + 1 } {
                        let part = match shape {
                            _ if at >= count => f64::from(u8::from(i == j)),
                            Shape::Triangular => new.covariance(at, i, j),
                            Shape::Diagonal => -0.5 * (LN_2_PI + new.covariance(at, i, i).ln()),
                        };
                        new.parts[at / LANES * entries + shape.entry(i, j)][at % LANES] = part;
                    }
                }
            }
        }
        Ok(new)
    }

    /// Inverse Cholesky factor of a covariance, or inverse deviations.
    fn factor(&self, at: usize) -> Result<Vec<f64>, EmissionError> {
        let d = self.d;
        if self.kind.shape() == Shape::Diagonal {
            return Ok((0..d).map(|c| 1.0 / self.covariance(at, c, c).sqrt()).collect());
        }
        let matrix = &self.covariances[at * d * d..][..d * d];
        let state = (self.kind == CovarianceType::Full).then_some(at);
        inverse_factor(d, matrix)
            .map_err(|component| EmissionError::NotPositiveDefinite { state, component })
    }

    /// Number of densities.
    pub(super) fn count(&self) -> usize {
        self.means.len() / self.d
    }

    pub(super) fn kind(&self) -> CovarianceType {
        self.kind
    }

    /// Number of components, d.
    pub(super) fn components(&self) -> usize {
        self.d
    }

    pub(super) fn has_missing(&self) -> bool {
        self.missing
    }

    pub(super) fn with_missing(self) -> Self {
        let Self { kind, d, means, covariances, .. } = self;
        Self::new(kind, d, means, covariances, true).expect("these have been factored before")
    }

    pub(super) fn mean(&self, at: usize) -> Option<&[f64]> {
        self.means.chunks_exact(self.d).nth(at)
    }

    pub(super) fn means(&self) -> Vec<Vec<f64>> {
        self.means.chunks_exact(self.d).map(<[f64]>::to_vec).collect()
    }

    /// Covariances as they are stored.
    pub(super) fn covariances(&self) -> Vec<Vec<f64>> {
        let each = self.kind.values(self.d);
        self.covariances.chunks_exact(each).map(<[f64]>::to_vec).collect()
    }

    /// Covariance of a density, row after row, in full.
    pub(super) fn full_covariance(&self, at: usize) -> Option<Vec<f64>> {
        let (d, entry) = (self.d, |i, j| self.covariance(at, i, j));
        (at < self.count())
            .then(|| (0..d * d).map(|position| entry(position / d, position % d)).collect())
    }

    fn covariance(&self, at: usize, i: usize, j: usize) -> f64 {
        let d = self.d;
        match self.kind {
            CovarianceType::Full => self.covariances[(at * d + i) * d + j],
            CovarianceType::Tied => self.covariances[i * d + j],
            _ if i != j => 0.0,
            CovarianceType::Spherical => self.covariances[at],
            CovarianceType::Diagonal => self.covariances[at * d + i],
        }
    }

    /// Entry of the inverse Cholesky factor of a density.
    fn inverse(&self, at: usize, i: usize, j: usize) -> f64 {
        let shape = self.kind.shape();
        if shape == Shape::Diagonal && i != j {
            return 0.0;
        }
        self.factors[at / LANES * shape.entries(self.d) + shape.entry(i, j)][at % LANES]
    }

    fn log_determinant(&self, at: usize) -> f64 {
        -2.0 * (0..self.d).map(|i| self.inverse(at, i, i).ln()).sum::<f64>()
    }

    /// W x, where W is the inverse Cholesky factor of a density.
    pub(super) fn whitened(
        &self,
        at: usize,
        x: impl Fn(usize) -> f64,
    ) -> impl Iterator<Item = f64> {
        (0..self.d).map(move |i| (0..=i).map(|j| self.inverse(at, i, j) * x(j)).sum())
    }

    /// Number of blocks of eight densities.
    pub(super) fn blocks(&self) -> usize {
        self.log_norms.len()
    }

    /// Number of blocks of memory that distances take.
    pub(super) fn memory(&self) -> usize {
        let elimination = self.missing && self.kind.shape() == Shape::Triangular;
        2 * self.blocks() + self.d + if elimination { self.elimination() } else { 0 }
    }

    fn elimination(&self) -> usize {
        self.d + Shape::Triangular.entries(self.d)
    }

    /// Writes to `memory` the squared distance of an observation from each mean, in blocks, and
    /// after these, in as many, the logarithm of each density at the mean; both for the
    /// components that are not missing, whose number is returned.
    #[inline]
    pub(super) fn distances(
        &self,
        y: &[f64],
        memory: &mut [Eight],
    ) -> Result<usize, EmissionError> {
        let observed = self.check(y)?;
        self.distances_from(&FromMeans { y, centres: &self.centres }, y, observed, memory)?;
        Ok(observed)
    }

    /// As [`distances`](Self::distances), with these differences from the observation, which is
    /// valid and has so many components that are not missing.
    #[inline]
    pub(super) fn distances_from(
        &self,
        differences: &impl Differences,
        y: &[f64],
        observed: usize,
        memory: &mut [Eight],
    ) -> Result<(), EmissionError> {
        let (d, triangular) = (self.d, self.kind.shape() == Shape::Triangular);
        if observed < d && triangular {
            return (0..self.blocks())
                .try_for_each(|block| self.eliminate(y, differences, block, memory));
        }
        let (out, rest) = memory.split_at_mut(self.blocks());
        let (norms, rest) = rest.split_at_mut(self.blocks());
        let (factors, deltas) = (&*self.factors, &mut rest[..d]);
        run(Distances { shape: self.kind.shape(), factors, deltas, differences, out });
        norms.copy_from_slice(&self.log_norms);
        if observed < d {
            for (norms, parts) in norms.iter_mut().zip(self.parts.chunks_exact(d)) {
                *norms = Eight::default();
                for (part, _) in parts.iter().zip(y).filter(|part| !part.1.is_nan()) {
                    norms.iter_mut().zip(part).for_each(|(norm, part)| *norm += part);
                }
            }
        }
        Ok(())
    }

    /// Checks an observation, and returns its number of components that are not missing.
    #[inline]
    pub(super) fn check(&self, y: &[f64]) -> Result<usize, EmissionError> {
        let (found, expected) = (y.len(), self.d);
        if found != expected {
            return Err(EmissionError::Components { found, expected });
        }
        // Of finite values alone, the sum of these products is 0.
        if y.iter().map(|y| y * 0.0).sum::<f64>() == 0.0 {
            return Ok(found);
        }
        let is_missing = |y: &f64| self.missing && y.is_nan();
        let wrong = y.iter().position(|y| !y.is_finite() && !is_missing(y));
        match wrong {
            None => Ok(y.iter().filter(|y| !y.is_nan()).count()),
            Some(component) => {
                let expected = if self.missing {
                    "a finite value, or NaN if it is missing"
                } else {
                    "a finite value (NaN for a missing one only with `with_missing`)"
                };
                Err(EmissionError::Observation { component, value: y[component], expected })
            }
        }
    }

    /// Writes the distance and the norm of one block for an observation with missing components;
    /// then `memory` holds, after both, differences and covariances as [`Eliminate`] leaves them.
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
        covariance.copy_from_slice(&self.parts[block * entries..][..entries]);
        run(Write { differences, block, out: deltas });
        let (distance, pivots) = (&mut distances[block], &mut rest[..d]);
        run(Eliminate { y, deltas, covariance, distance, pivots });
        norms[block] = Eight::default();
        for (component, pivot) in pivots.iter().enumerate().filter(|c| !y[c.0].is_nan()) {
            for (l, (norm, pivot)) in norms[block].iter_mut().zip(pivot).enumerate() {
                // Of a factored matrix they are positive, but for rounding.
                if !(*pivot > 0.0) {
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
    pub(super) fn logs(&self, memory: &mut [Eight]) {
        let (distances, rest) = memory.split_at_mut(self.blocks());
        for (distance, norm) in distances.iter_mut().zip(rest) {
            for (distance, norm) in distance.iter_mut().zip(norm) {
                *distance = density(*norm - 0.5 * *distance);
            }
        }
    }

    /// Adds an observation with these weights for each block to moments. What is missing has its
    /// conditional distribution, whose covariance counts with the weights `conditional`.
    #[inline]
    pub(super) fn add(
        &self,
        moments: &mut Moments,
        y: &[f64],
        weights: &[Eight],
        conditional: &[Eight],
        memory: &mut [Eight],
    ) {
        let is_complete = !self.missing || y.iter().all(|y| !y.is_nan());
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
            let Ok((deltas, covariance)) = expected else { continue };
            moments.add_block(block, weight, deltas);
            let at = moments.scatter_mut(block);
            add_missing(at, 0, y, &conditional[block], covariance);
        }
    }

    /// Expected differences of a block, with those of missing components given the others, and
    /// packed covariances, which are valid between components that are missing.
    pub(super) fn expected<'a>(
        &self,
        differences: &impl Differences,
        y: &[f64],
        block: usize,
        memory: &'a mut [Eight],
    ) -> Result<(&'a [Eight], &'a [Eight]), EmissionError> {
        let d = self.d;
        self.eliminate(y, differences, block, memory)?;
        let (deltas, rest) = memory[2 * self.blocks()..].split_at_mut(d);
        for (delta, _) in deltas.iter_mut().zip(y).filter(|pair| pair.1.is_nan()) {
            delta.iter_mut().for_each(|delta| *delta = -*delta);
        }
        // The others as before the elimination.
        let (covariance, before) = rest.split_at_mut(Shape::Triangular.entries(d));
        run(Write { differences, block, out: &mut before[..d] });
        for ((delta, before), _) in
            deltas.iter_mut().zip(before).zip(y).filter(|pair| !pair.1.is_nan())
        {
            *delta = *before;
        }
        Ok((deltas, covariance))
    }

    /// Writes the differences of a block.
    #[inline]
    pub(super) fn write(&self, differences: &impl Differences, block: usize, out: &mut [Eight]) {
        run(Write { differences, block, out: &mut out[..self.d] });
    }

    /// Variances of a component in a block; 0 where there is no density.
    pub(super) fn variances(&self, block: usize, c: usize) -> Eight {
        let variance = |at: usize| if at < self.count() { self.covariance(at, c, c) } else { 0.0 };
        std::array::from_fn(|l| variance(block * LANES + l))
    }

    /// Draws an observation of a density.
    pub(super) fn sample<R: Rng + ?Sized>(&self, at: usize, rng: &mut R) -> Vec<f64> {
        let mut x: Vec<f64> = Vec::with_capacity(self.d);
        for i in 0..self.d {
            let z: f64 = rng.sample(StandardNormal);
            // W (x − μ) = z
            let before: f64 = (0..i).map(|j| self.inverse(at, i, j) * x[j]).sum();
            x.push((z - before) / self.inverse(at, i, i));
        }
        x.iter_mut().zip(&self.means[at * self.d..]).for_each(|(x, mean)| *x += mean);
        x
    }

    /// Returns the densities in another order, or some of them.
    pub(super) fn select(&self, order: impl Iterator<Item = usize> + Clone) -> Self {
        let each = self.kind.values(self.d);
        let pick = |values: &[f64], each: usize| -> Vec<f64> {
            order.clone().flat_map(|at| values[at * each..][..each].to_vec()).collect()
        };
        let covariances = if self.kind == CovarianceType::Tied {
            self.covariances.clone()
        } else {
            pick(&self.covariances, each)
        };
        Self::new(self.kind, self.d, pick(&self.means, self.d), covariances, self.missing)
            .expect("these have been factored before")
    }
}

/// Adds conditional covariances of missing components to a scatter in which `before` components
/// precede those, both packed.
pub(super) fn add_missing(
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

impl<D: Differences> crate::kernels::WithSimd for Write<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<S: crate::kernels::Simd>(self, s: S) {
        self.differences.write(s, self.block, self.out);
    }
}

/// Logarithm of a density, as a [`Diagonal`](crate::Diagonal) takes it: −∞ (a density of 0) below
/// −1e300, and where the distance is beyond the range of doubles.
#[inline(always)]
pub(super) fn density(log: f64) -> f64 {
    if log >= -1e300 { log } else { f64::NEG_INFINITY }
}

/// Memory of a step in blocks of eight.
pub(super) fn eights(values: &mut [f64]) -> &mut [Eight] {
    values.as_chunks_mut().0
}

/// Copies weights into blocks of eight, with 0 in the lanes that are left.
#[inline]
pub(super) fn in_blocks(weights: &[f64], out: &mut [Eight]) {
    let (blocks, rest) = weights.as_chunks::<LANES>();
    out[..blocks.len()].copy_from_slice(blocks);
    if let Some(last) = out.get_mut(blocks.len()) {
        *last = Eight::default();
        last[..rest.len()].copy_from_slice(rest);
    }
}

/// Checks parameters, one row for each state, and returns them one after the other.
pub(super) fn flatten<R: AsRef<[f64]>>(
    what: &'static str,
    rows: &[R],
    expected: usize,
) -> Result<Vec<f64>, EmissionError> {
    let mut all = Vec::with_capacity(rows.len() * expected);
    for (state, row) in rows.iter().enumerate() {
        let (row, state) = (row.as_ref(), Some(state));
        let found = row.len();
        if found != expected {
            return Err(EmissionError::Length { what, state, found, expected });
        }
        if let Some(component) = row.iter().position(|value| !value.is_finite()) {
            let (value, expected) = (row[component], "a finite value");
            let component = Some(component);
            return Err(EmissionError::Parameter { what, state, component, value, expected });
        }
        all.extend_from_slice(row);
    }
    Ok(all)
}

/// Checks covariances in their stored form, one for each density, or one if they are tied.
pub(super) fn check_covariances(
    kind: CovarianceType,
    d: usize,
    covariances: &[f64],
) -> Result<(), EmissionError> {
    let what = kind.name();
    for (at, covariance) in covariances.chunks_exact(kind.values(d)).enumerate() {
        let state = (kind != CovarianceType::Tied).then_some(at);
        let wrong = |component: usize, value, expected| {
            let component = (kind != CovarianceType::Spherical).then_some(component);
            Err(EmissionError::Parameter { what, state, component, value, expected })
        };
        for (position, &value) in covariance.iter().enumerate() {
            if kind.shape() == Shape::Diagonal {
                if !(value >= f64::MIN_POSITIVE && value.is_finite()) {
                    return wrong(position, value, "a finite value above 2.2e-308");
                }
                continue;
            }
            let (i, j) = (position / d, position % d);
            let (other, scale) = (covariance[j * d + i], covariance[i * d + i].abs().sqrt());
            if !value.is_finite() {
                return wrong(i, value, "a finite value");
            }
            if (value - other).abs() > SYMMETRY * scale * covariance[j * d + j].abs().sqrt() {
                return wrong(i, value, "a symmetric matrix");
            }
        }
    }
    Ok(())
}
