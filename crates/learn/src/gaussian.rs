//! Gaussian vectors: their densities b_i(y) (section 1 of the guide's formulas) and M step (section
//! 9). The work is done by `Normals`, with one density for each state.

use std::error::Error;

use rand::Rng;

use super::normal::{
    CovarianceType, GaussianStatistics, Normals, Settings, as_blocks, flatten_covariances,
    in_blocks, settings,
};
use super::{EmissionError, Family, Marginals, StartFromClusters, Tails};
use crate::error::{check_length, flatten};
use wayfix::LikelihoodError;
use wayfix::ReorderStates;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Diagonal, Likelihood, Scratch};

/// Gaussian vectors, with a mean for each state and a covariance of one of
/// [four types](CovarianceType): the counterpart of hmmlearn's `GaussianHMM`.
///
/// With the mean μ and the covariance Σ of a state, the density of an observation of d numbers is
///
/// ```text
/// p(y) = (2π)^(−d/2) det(Σ)^(−1/2) exp(−½ (y − μ)' Σ⁻¹ (y − μ)).
/// ```
///
/// Learning replaces μ by the weighted mean and Σ by the weighted covariance of the observations
/// of a state (Baum, Petrie, Soules and Weiss 1970), or, [with a prior](Self::with_prior), by the
/// maximum of the posterior density, in closed form. A covariance must be positive definite to
/// working precision: an elimination that leaves at most 1e-12 of a diagonal entry is an error.
///
/// Covariances are factored once for each set of parameters. A step takes O(n d) for spherical and
/// diagonal covariances and O(n d²) for full and tied ones, eight states side by side, and
/// allocates nothing. A log-density below −1e300 counts as −∞, a density of 0.
///
/// Components may be missing [if this is allowed](Self::with_missing): they are integrated out,
/// which takes O(n d³) for such a step with a full or tied covariance.
///
/// ```
/// use wayfix_learn::{Gaussian, Rows};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let values = [0.1, 1.0, -0.2, 1.1, 0.1, 0.8, 5.2, 2.9, 4.9, 3.1, 5.0, 3.2, 0.0, 1.1, 0.2, 0.9];
/// let family = Gaussian::diagonal(&[[0.0, 0.0], [4.0, 4.0]], &[[1.0, 1.0], [1.0, 1.0]])?;
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.8, 0.2], [0.2, 0.8]])?,
///     family,
/// )?;
/// let learned = hmm.learn(&[Rows::new(&values, 2)?], &LearningOptions::default())?;
/// let mean = learned.model().likelihood().mean(1).unwrap();
/// assert!((mean[0] - 5.033).abs() < 0.01 && (mean[1] - 3.067).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Gaussian {
    normals: Normals,
}

impl Gaussian {
    /// Creates a family with one variance for each state.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] without states or components, for a wrong length, a mean that is not
    /// finite, or a variance that is not finite and above 2.2e-308.
    pub fn spherical<M: AsRef<[f64]>>(
        means: &[M],
        variances: &[f64],
    ) -> Result<Self, EmissionError> {
        let rows: Vec<[f64; 1]> = variances.iter().map(|variance| [*variance]).collect();
        Self::new(CovarianceType::Spherical, means, &rows)
    }

    /// Creates a family with the variances of each state's components.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as [`spherical`](Self::spherical).
    pub fn diagonal<M: AsRef<[f64]>, V: AsRef<[f64]>>(
        means: &[M],
        variances: &[V],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Diagonal, means, variances)
    }

    /// Creates a family with a covariance for each state: d × d values, row after row.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] without states or components, for a wrong length, a value that is not
    /// finite, or a covariance that is not symmetric within 1e-9 and positive definite.
    pub fn full<M: AsRef<[f64]>, V: AsRef<[f64]>>(
        means: &[M],
        covariances: &[V],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Full, means, covariances)
    }

    /// Creates a family with one covariance shared by all states: d × d values, row after row.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as [`full`](Self::full).
    pub fn tied<M: AsRef<[f64]>>(means: &[M], covariance: &[f64]) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Tied, means, &[covariance])
    }

    /// Creates a family with covariances of this type, given as its own constructor takes them: one
    /// for each state, or a single one if they are tied.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as for the constructor of the type.
    pub fn new<M: AsRef<[f64]>, V: AsRef<[f64]>>(
        covariance_type: CovarianceType,
        means: &[M],
        covariances: &[V],
    ) -> Result<Self, EmissionError> {
        let (kind, states) = (covariance_type, means.len());
        let d = means.first().map_or(0, |mean| mean.as_ref().len());
        if states == 0 || d == 0 {
            return Err(EmissionError::Empty { states, components: d });
        }
        let means = flatten("mean", means, d)?;
        let expected = if kind == CovarianceType::Tied { 1 } else { states };
        check_length("list of covariances", None, covariances.len(), expected)?;
        let covariances = flatten_covariances(kind, covariances, d)?;
        Ok(Self { normals: Normals::new(kind, d, means, covariances, Settings::default())? })
    }

    settings!();

    /// Returns the mean of a state, or `None` if it does not exist.
    #[must_use]
    pub fn mean(&self, state: usize) -> Option<&[f64]> {
        self.normals.mean(state)
    }

    /// Returns the covariance of a state, d × d values row after row whatever its type, or `None`
    /// if the state does not exist.
    #[must_use]
    pub fn covariance(&self, state: usize) -> Option<Vec<f64>> {
        self.normals.full_covariance(state)
    }

    /// Means of all states, as [`new`](Self::new) takes them.
    #[must_use]
    pub fn means(&self) -> Vec<Vec<f64>> {
        self.normals.means()
    }

    /// Covariances in the form that [`new`](Self::new) takes.
    #[must_use]
    pub fn covariances(&self) -> Vec<Vec<f64>> {
        self.normals.covariances()
    }

    pub(super) fn of(normals: Normals) -> Self {
        Self { normals }
    }

    pub(super) fn normals(&self) -> &Normals {
        &self.normals
    }
}

impl Likelihood for Gaussian {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.normals.count()
    }

    #[inline]
    fn diagonal<'a>(
        &'a self,
        y: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        // ln b_i = ln N(μ; μ, Σ) − ½ ‖W (y − μ)‖², which replaces the distances at the start of the
        // memory.
        let values = scratch.values(self.normals.scratch_blocks() * 8);
        let memory = as_blocks(values);
        self.normals.distances(y, memory)?;
        self.normals.logs(memory);
        Ok(Diagonal::log(&values[..self.normals.count()]))
    }
}

impl Family for Gaussian {
    fn components(&self) -> usize {
        self.normals.components()
    }
}

impl SampleObservation for Gaussian {
    type Sample = Vec<f64>;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        self.normals.sample(state, rng)
    }
}

impl LearnLikelihood for Gaussian {
    type Statistics = GaussianStatistics;

    fn statistics(&self) -> GaussianStatistics {
        self.normals.statistics(0)
    }

    #[inline]
    fn add(&self, statistics: &mut GaussianStatistics, y: &[f64], posterior: &[f64]) {
        let GaussianStatistics { moments, weights: [weights, _], memory, .. } = statistics;
        in_blocks(posterior, weights);
        // Values and conditional covariances have the same weights γ.
        self.normals.add(moments, y, weights, weights, memory);
    }

    fn merge(&self, statistics: &mut GaussianStatistics, other: &GaussianStatistics) {
        statistics.merge(other);
    }

    fn maximize(
        &self,
        statistics: &GaussianStatistics,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self { normals: self.normals.maximize(&statistics.moments, None)? })
    }

    fn log_prior(&self, _: f64) -> f64 {
        self.normals.log_prior()
    }

    fn free_parameters(&self) -> usize {
        self.normals.free_parameters()
    }
}

impl StartFromClusters for Gaussian {}

impl ReorderStates for Gaussian {
    fn reordered(&self, order: &[usize]) -> Self {
        Self { normals: self.normals.select(order) }
    }
}

/// Means, then variances or covariances, except those that learning keeps.
impl FreeParameters for Gaussian {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        Ok(Self { normals: self.normals.displaced(by)? })
    }
}

/// The marginal distribution of each component, with its own variance.
impl Marginals for Gaussian {
    fn numbers(&self) -> usize {
        self.normals.components()
    }

    fn number(&self, row: &[f64], component: usize) -> Result<Option<f64>, LikelihoodError> {
        Ok(self.normals.number(row, component)?)
    }

    fn log_density(&self, state: usize, component: usize, y: f64) -> f64 {
        self.normals.log_marginal(state, component, y)
    }

    fn tails(&self, state: usize, component: usize, y: f64) -> Tails {
        self.normals.tails(state, component, y)
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] Gaussian: [], |family| {
        covariance_type: CovarianceType = family.covariance_type(),
        means: Vec<Vec<f64>> = family.means(),
        covariances: Vec<Vec<f64>> = family.covariances(),
        missing: bool = family.takes_missing(),
        fixed_means: bool = family.has_fixed_means(),
        fixed_covariances: bool = family.has_fixed_covariances(),
        prior: Option<crate::GaussianPrior> = family.prior(),
    } => Self::new(covariance_type, &means, &covariances)
        .map(|new| crate::family::when(missing, new, Self::with_missing))
        .map(|new| crate::family::when(fixed_means, new, Self::with_fixed_means))
        .map(|new| crate::family::when(fixed_covariances, new, Self::with_fixed_covariances))
        .and_then(|new| prior.into_iter().try_fold(new, Self::with_prior));
}
