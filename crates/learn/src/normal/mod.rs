//! Normal densities of vectors with cached Cholesky factors, the base of the Gaussian families.
//!
//! A covariance Σ = L L' is stored with W = L⁻¹, so that (y − μ)' Σ⁻¹ (y − μ) = ‖W (y − μ)‖² and
//! ln det Σ = −2 Σ ln W_rr. Eight densities are laid out side by side, one in each lane.
//!
//! This file has the densities, their settings and the marginals of single components; `covariance`
//! the types of covariances, their checks and factors; `prior` the prior; `step` the E step;
//! `moments` the statistics and the M step.

mod covariance;
mod moments;
mod prior;
mod step;

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use wayfix_kernels::{Eight, LANES};

use crate::error::check_components;
use crate::{EmissionError, Tails};

pub use covariance::CovarianceType;
pub(super) use covariance::{Shape, flatten_covariances, inverse_factor};
pub use moments::GaussianStatistics;
pub(super) use moments::Moments;
pub use prior::GaussianPrior;
pub(super) use step::{Differences, add_missing, as_blocks, in_blocks, log_density_or_zero};

// Sets of normal densities with cached factors: for each, the mean, W = L⁻¹ of its covariance L
// L', and ln N(μ; μ, Σ) = −½ (d ln 2π + ln det Σ), in blocks of eight densities.

/// ln 2π.
const LN_2_PI: f64 = 1.837_877_066_409_345_6;

/// Normal densities of vectors of d components, with a copy in blocks of eight densities for the
/// steps.
#[derive(Debug, Clone)]
pub(crate) struct Normals {
    kind: CovarianceType,
    d: usize,
    means: Vec<f64>,
    /// One covariance after the other. If they are tied, each is shared by the same number of
    /// consecutive densities.
    covariances: Vec<f64>,
    settings: Settings,
    /// Means, in blocks.
    centres: Vec<Eight>,
    /// Inverse Cholesky factors, or inverse deviations.
    factors: Vec<Eight>,
    /// Logarithms of the densities at the means.
    log_norms: Vec<Eight>,
    /// Only if components may be missing: packed covariances for the elimination, or, for
    /// variances, the contribution of each component to the logarithm of the density at the mean.
    missing_cache: Vec<Eight>,
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
            missing_cache: Vec::new(),
        };
        let (each, mut factor) = (new.densities_per_covariance(), Vec::new());
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
            new.missing_cache = zeros(entries);
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
                        new.missing_cache[at / LANES * entries + shape.entry(i, j)][at % LANES] =
                            part;
                    }
                }
            }
        }
        Ok(new)
    }

    /// Number of covariances.
    fn matrices(&self) -> usize {
        self.covariances.len() / self.kind.values(self.d)
    }

    /// Number of densities that share a covariance.
    fn densities_per_covariance(&self) -> usize {
        self.count() / self.matrices()
    }

    /// Inverse Cholesky factor of the covariance of a density, or inverse deviations.
    fn factor(&self, at: usize) -> Result<Vec<f64>, EmissionError> {
        let d = self.d;
        if self.kind.shape() == Shape::Diagonal {
            return Ok((0..d).map(|c| 1.0 / self.covariance(at, c, c).sqrt()).collect());
        }
        let number = at / self.densities_per_covariance();
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
        // Only missing components change what is cached (`missing_cache`).
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
        GaussianStatistics::new(moments, sums, self.scratch_blocks())
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

    fn covariance(&self, at: usize, i: usize, j: usize) -> f64 {
        let d = self.d;
        match self.kind {
            CovarianceType::Full => self.covariances[(at * d + i) * d + j],
            CovarianceType::Tied => {
                self.covariances[(at / self.densities_per_covariance() * d + i) * d + j]
            }
            _ if i != j => 0.0,
            CovarianceType::Spherical => self.covariances[at],
            CovarianceType::Diagonal => self.covariances[at * d + i],
        }
    }

    /// Entry of the inverse Cholesky factor of a density.
    fn inverse_factor_entry(&self, at: usize, i: usize, j: usize) -> f64 {
        let shape = self.kind.shape();
        if shape == Shape::Diagonal && i != j {
            return 0.0;
        }
        self.factors[at / LANES * shape.entries(self.d) + shape.entry(i, j)][at % LANES]
    }

    fn log_determinant(&self, at: usize) -> f64 {
        -2.0 * (0..self.d).map(|i| self.inverse_factor_entry(at, i, i).ln()).sum::<f64>()
    }

    /// W x, where W is the inverse Cholesky factor of a density.
    pub(crate) fn whitened(
        &self,
        at: usize,
        x: impl Fn(usize) -> f64,
    ) -> impl Iterator<Item = f64> {
        (0..self.d).map(move |i| (0..=i).map(|j| self.inverse_factor_entry(at, i, j) * x(j)).sum())
    }

    /// Variances of a component in a block; 0 beyond the last density.
    pub(crate) fn variances(&self, block: usize, c: usize) -> Eight {
        let variance = |at: usize| if at < self.count() { self.covariance(at, c, c) } else { 0.0 };
        std::array::from_fn(|l| variance(block * LANES + l))
    }

    /// Draws an observation of a density.
    pub(crate) fn sample<R: Rng + ?Sized>(&self, at: usize, rng: &mut R) -> Vec<f64> {
        let mut x: Vec<f64> = Vec::with_capacity(self.d);
        for i in 0..self.d {
            let z: f64 = rng.sample(StandardNormal);
            // W (x − μ) = z by forward substitution, so x has the covariance (W' W)⁻¹ = Σ.
            let before: f64 = (0..i).map(|j| self.inverse_factor_entry(at, i, j) * x[j]).sum();
            x.push((z - before) / self.inverse_factor_entry(at, i, i));
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
            let first = order
                .iter()
                .step_by(self.densities_per_covariance())
                .map(|at| at / self.densities_per_covariance());
            first.flat_map(|number| &self.covariances[number * each..][..each]).copied().collect()
        };
        let means = means.copied().collect();
        Self::new(self.kind, self.d, means, covariances, self.settings.clone())
            .expect("these have been factored before")
    }
}

// Settings that all families built on [`Normals`] share.

/// Settings of a family, which learning does not change.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Settings {
    /// True if NaN stands for a missing component.
    pub(crate) missing: bool,
    /// True if learning keeps the means.
    pub(crate) fixed_means: bool,
    /// True if learning keeps the covariances.
    pub(crate) fixed_covariances: bool,
    /// Prior of learning, if there is one.
    pub(crate) prior: Option<GaussianPrior>,
}

/// Methods of a family with the field `normals`.
macro_rules! settings {
    () => {
        /// Returns the family with missing components allowed, given as NaN. They are integrated
        /// out of the density; learning takes their expectation given the others. Without this
        /// setting, NaN is an error.
        #[must_use]
        pub fn with_missing(mut self) -> Self {
            self.normals = self.normals.with(|settings| settings.missing = true);
            self
        }

        /// Returns the family with a prior of each state's mean and covariance, for learning.
        /// By default there is none, and learning maximises the likelihood.
        ///
        /// # Errors
        ///
        /// [`EmissionError::Length`](crate::EmissionError::Length) if the prior has
        /// another number of components.
        pub fn with_prior(
            mut self,
            prior: $crate::GaussianPrior,
        ) -> Result<Self, $crate::EmissionError> {
            self.normals = self.normals.with_prior(prior)?;
            Ok(self)
        }

        /// Returns the family with means that learning keeps.
        #[must_use]
        pub fn with_fixed_means(mut self) -> Self {
            self.normals = self.normals.with(|settings| settings.fixed_means = true);
            self
        }

        /// Returns the family with covariances that learning keeps.
        #[must_use]
        pub fn with_fixed_covariances(mut self) -> Self {
            self.normals = self.normals.with(|settings| settings.fixed_covariances = true);
            self
        }

        /// Type of the covariances.
        #[must_use]
        pub fn covariance_type(&self) -> $crate::CovarianceType {
            self.normals.kind()
        }

        /// True if NaN stands for a missing component.
        #[must_use]
        pub fn takes_missing(&self) -> bool {
            self.normals.settings().missing
        }

        /// True if learning keeps the means.
        #[must_use]
        pub fn has_fixed_means(&self) -> bool {
            self.normals.settings().fixed_means
        }

        /// True if learning keeps the covariances.
        #[must_use]
        pub fn has_fixed_covariances(&self) -> bool {
            self.normals.settings().fixed_covariances
        }

        /// The prior of learning, if there is one.
        #[must_use]
        pub fn prior(&self) -> Option<&$crate::GaussianPrior> {
            self.normals.settings().prior.as_ref()
        }
    };
}

pub(crate) use settings;

// Marginal distributions of single components: N(μ_c, Σ_cc), whatever the other components are.

impl Normals {
    /// Value of a component of an observation, or `None` if it is missing.
    pub(crate) fn number(
        &self,
        row: &[f64],
        component: usize,
    ) -> Result<Option<f64>, EmissionError> {
        check_components(row, self.d)?;
        let value = row[component];
        if value.is_nan() && self.settings.missing {
            return Ok(None);
        }
        if !value.is_finite() {
            return Err(EmissionError::Observation {
                component,
                value,
                expected: "a finite value",
            });
        }
        Ok(Some(value))
    }

    /// Distance of a number from the mean of a component in standard deviations, and the logarithm
    /// of the standard deviation.
    pub(crate) fn standardize(&self, at: usize, component: usize, y: f64) -> [f64; 2] {
        let variance = self.covariance(at, component, component);
        // The difference of two halves does not overflow.
        let half = 0.5 * y - 0.5 * self.means[at * self.d + component];
        [2.0 * (half / variance.sqrt()), 0.5 * variance.ln()]
    }

    /// Logarithm of the marginal density of a component; −∞ unless y is finite.
    pub(crate) fn log_marginal(&self, at: usize, component: usize, y: f64) -> f64 {
        if !y.is_finite() {
            return f64::NEG_INFINITY;
        }
        let [z, ln_deviation] = self.standardize(at, component, y);
        log_density_or_zero(-0.5 * (z * z + LN_2_PI) - ln_deviation)
    }

    /// Tails of the marginal distribution of a component.
    pub(crate) fn tails(&self, at: usize, component: usize, y: f64) -> Tails {
        Tails::of_normal(self.standardize(at, component, y)[0])
    }
}
