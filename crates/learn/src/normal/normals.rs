//! Sets of normal densities with cached factors: for each, the mean, W = L⁻¹ of its covariance L
//! L', and ln N(μ; μ, Σ) = −½ (d ln 2π + ln det Σ), in blocks of eight densities.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::factor::inverse_factor;
use super::form::{CovarianceType, Shape};
use super::moments::{GaussianStatistics, Moments};
use super::prior::GaussianPrior;
use super::settings::Settings;
use crate::EmissionError;
use wayfix_kernels::{Eight, LANES};

/// ln 2π.
pub(super) const LN_2_PI: f64 = 1.837_877_066_409_345_6;

/// Normal densities of vectors of d components, with a copy in blocks of eight densities for the
/// steps.
#[derive(Debug, Clone)]
pub(crate) struct Normals {
    pub(super) kind: CovarianceType,
    pub(super) d: usize,
    pub(super) means: Vec<f64>,
    /// One covariance after the other. If they are tied, each is shared by the same number of
    /// consecutive densities.
    pub(super) covariances: Vec<f64>,
    pub(super) settings: Settings,
    /// Means, in blocks.
    pub(super) centres: Vec<Eight>,
    /// Inverse Cholesky factors, or inverse deviations.
    pub(super) factors: Vec<Eight>,
    /// Logarithms of the densities at the means.
    pub(super) log_norms: Vec<Eight>,
    /// Only if components may be missing: packed covariances for the elimination, or, for
    /// variances, the contribution of each component to the logarithm of the density at the mean.
    pub(super) parts: Vec<Eight>,
}

impl Normals {
    /// Creates the densities by factoring the covariances. The caller has checked all values.
    pub(crate) fn new(
        kind: CovarianceType,
        d: usize,
        means: Vec<f64>,
        covariances: Vec<f64>,
        settings: Settings,
    ) -> Result<Self, EmissionError> {
        let (count, shape, missing) = (means.len() / d, kind.shape(), settings.missing);
        let (blocks, entries) = (count.div_ceil(LANES), shape.entries(d));
        let zeros = |each: usize| vec![Eight::default(); blocks * each];
        let mut new = Self {
            kind,
            d,
            means,
            covariances,
            settings,
            centres: zeros(d),
            factors: zeros(entries),
            log_norms: zeros(1),
            parts: Vec::new(),
        };
        let (each, mut factor) = (new.sharing(), Vec::new());
        for at in 0..count {
            // Densities that share a covariance are consecutive: factor it at the first.
            if at % each == 0 {
                factor = new.factor(at)?;
            }
            let (block, l) = (at / LANES, at % LANES);
            for (entry, value) in factor.iter().enumerate() {
                new.factors[block * entries + entry][l] = *value;
            }
            new.log_norms[block][l] = -0.5 * (d as f64 * LN_2_PI + new.log_determinant(at));
            for c in 0..d {
                new.centres[block * d + c][l] = new.means[at * d + c];
            }
        }
        if missing {
            new.parts = zeros(entries);
            // Lanes without a density get an identity, whose pivots are positive: the elimination
            // checks all lanes.
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

    /// Number of covariances.
    pub(super) fn matrices(&self) -> usize {
        self.covariances.len() / self.kind.values(self.d)
    }

    /// Number of densities that share a covariance.
    pub(super) fn sharing(&self) -> usize {
        self.count() / self.matrices()
    }

    /// Inverse Cholesky factor of the covariance of a density, or inverse deviations.
    fn factor(&self, at: usize) -> Result<Vec<f64>, EmissionError> {
        let d = self.d;
        if self.kind.shape() == Shape::Diagonal {
            return Ok((0..d).map(|c| 1.0 / self.covariance(at, c, c).sqrt()).collect());
        }
        let number = at / self.sharing();
        let matrix = &self.covariances[number * d * d..][..d * d];
        let single = self.kind == CovarianceType::Tied && self.matrices() == 1;
        let state = (!single).then_some(number);
        inverse_factor(d, matrix)
            .map_err(|component| EmissionError::NotPositiveDefinite { state, component })
    }

    /// Number of densities.
    pub(crate) fn count(&self) -> usize {
        self.means.len() / self.d
    }

    pub(crate) fn kind(&self) -> CovarianceType {
        self.kind
    }

    /// Number of components, d.
    pub(crate) fn components(&self) -> usize {
        self.d
    }

    pub(crate) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Returns the densities with changed settings.
    pub(crate) fn with(self, change: impl FnOnce(&mut Settings)) -> Self {
        let mut settings = self.settings.clone();
        change(&mut settings);
        // Only missing components change what is cached (`parts`).
        if settings.missing == self.settings.missing {
            return Self { settings, ..self };
        }
        let Self { kind, d, means, covariances, .. } = self;
        Self::new(kind, d, means, covariances, settings).expect("these have been factored before")
    }

    /// Returns the densities with a prior for learning.
    pub(crate) fn with_prior(self, prior: GaussianPrior) -> Result<Self, EmissionError> {
        prior.check_components(self.d)?;
        Ok(self.with(|settings| settings.prior = Some(prior)))
    }

    /// Returns empty statistics with `sums` further sums for the family.
    pub(crate) fn statistics(&self, sums: usize) -> GaussianStatistics {
        let shape = self.kind.shape();
        let moments = Moments::new(self.count(), self.d, shape, self.counts_by_component());
        GaussianStatistics::new(moments, sums, self.memory())
    }

    pub(crate) fn mean(&self, at: usize) -> Option<&[f64]> {
        self.means.chunks_exact(self.d).nth(at)
    }

    pub(crate) fn means(&self) -> Vec<Vec<f64>> {
        self.means.chunks_exact(self.d).map(<[f64]>::to_vec).collect()
    }

    /// Covariances in their stored form.
    pub(crate) fn covariances(&self) -> Vec<Vec<f64>> {
        let each = self.kind.values(self.d);
        self.covariances.chunks_exact(each).map(<[f64]>::to_vec).collect()
    }

    /// Full covariance matrix of a density, row after row.
    pub(crate) fn full_covariance(&self, at: usize) -> Option<Vec<f64>> {
        let (d, entry) = (self.d, |i, j| self.covariance(at, i, j));
        (at < self.count())
            .then(|| (0..d * d).map(|position| entry(position / d, position % d)).collect())
    }

    pub(super) fn covariance(&self, at: usize, i: usize, j: usize) -> f64 {
        let d = self.d;
        match self.kind {
            CovarianceType::Full => self.covariances[(at * d + i) * d + j],
            CovarianceType::Tied => self.covariances[(at / self.sharing() * d + i) * d + j],
            _ if i != j => 0.0,
            CovarianceType::Spherical => self.covariances[at],
            CovarianceType::Diagonal => self.covariances[at * d + i],
        }
    }

    /// Entry of the inverse Cholesky factor of a density.
    pub(super) fn inverse(&self, at: usize, i: usize, j: usize) -> f64 {
        let shape = self.kind.shape();
        if shape == Shape::Diagonal && i != j {
            return 0.0;
        }
        self.factors[at / LANES * shape.entries(self.d) + shape.entry(i, j)][at % LANES]
    }

    pub(super) fn log_determinant(&self, at: usize) -> f64 {
        -2.0 * (0..self.d).map(|i| self.inverse(at, i, i).ln()).sum::<f64>()
    }

    /// W x, where W is the inverse Cholesky factor of a density.
    pub(crate) fn whitened(
        &self,
        at: usize,
        x: impl Fn(usize) -> f64,
    ) -> impl Iterator<Item = f64> {
        (0..self.d).map(move |i| (0..=i).map(|j| self.inverse(at, i, j) * x(j)).sum())
    }

    /// Variances of a component in a block; 0 where there is no density.
    pub(crate) fn variances(&self, block: usize, c: usize) -> Eight {
        let variance = |at: usize| if at < self.count() { self.covariance(at, c, c) } else { 0.0 };
        std::array::from_fn(|l| variance(block * LANES + l))
    }

    /// Draws an observation of a density.
    pub(crate) fn sample<R: Rng + ?Sized>(&self, at: usize, rng: &mut R) -> Vec<f64> {
        let mut x: Vec<f64> = Vec::with_capacity(self.d);
        for i in 0..self.d {
            let z: f64 = rng.sample(StandardNormal);
            // W (x − μ) = z by forward substitution, so that x has the covariance (W' W)⁻¹ = Σ.
            let before: f64 = (0..i).map(|j| self.inverse(at, i, j) * x[j]).sum();
            x.push((z - before) / self.inverse(at, i, i));
        }
        x.iter_mut().zip(&self.means[at * self.d..]).for_each(|(x, mean)| *x += mean);
        x
    }

    /// Returns some of the densities, in this order. Densities that share a covariance are selected
    /// together, unless all share one.
    pub(crate) fn select(&self, order: &[usize]) -> Self {
        let each = self.kind.values(self.d);
        let means = order.iter().flat_map(|at| &self.means[at * self.d..][..self.d]);
        let covariances = if self.matrices() == 1 {
            self.covariances.clone()
        } else {
            let first = order.iter().step_by(self.sharing()).map(|at| at / self.sharing());
            first.flat_map(|number| &self.covariances[number * each..][..each]).copied().collect()
        };
        let means = means.copied().collect();
        Self::new(self.kind, self.d, means, covariances, self.settings.clone())
            .expect("these have been factored before")
    }
}
