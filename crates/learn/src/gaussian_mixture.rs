//! Mixtures of Gaussians: their densities b_i(y) = Σ_p w_p N(y; μ_p, Σ_p) (section 1 of the guide's
//! formulas), summed in logarithms relative to the largest part.

use std::error::Error;

use rand::Rng;
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::internal::{SUM_TOLERANCE, index, shares};
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Diagonal, Likelihood, LikelihoodError, ReorderStates, Scratch};
use wayfix_kernels::{Eight, log_sum};

use crate::error::{check, check_length, flatten, with_place};
use crate::normal::{
    CovarianceType, GaussianStatistics, Normals, Settings, as_blocks, flatten_covariances, settings,
};
use crate::{Clusters, EmissionError, Family, Gaussian, Marginals, StartFromClusters, Tails};

/// Mixtures of m Gaussians for each state, with covariances of one of four [types](CovarianceType):
/// the counterpart of hmmlearn's `GMMHMM`. A tied covariance is shared by all parts of a state.
///
/// With the weights w, means μ and covariances Σ of a state's parts, the density of an observation
/// of d numbers is
///
/// ```text
/// p(y) = Σ_p w_p N(y; μ_p, Σ_p).
/// ```
///
/// Learning divides the weight of an observation between the parts by their posterior
/// probabilities (Juang, Levinson and Sondhi 1986) and then estimates each part as a
/// [`Gaussian`](crate::Gaussian), and the weights as shares. The pseudo-count of
/// [learning](wayfix::inference::LearningOptions::likelihood_pseudo_count) is that of a Dirichlet
/// prior on the weights above 0, so 1 less than hmmlearn's `weights_prior`. The prior of means and
/// covariances is set by [`with_prior`](Self::with_prior) and is the same for all parts. A weight
/// of 0 stays 0, and a part without weight keeps its mean and covariance.
///
/// Covariances are estimated about the new means. (hmmlearn's `GMMHMM` takes them about the means
/// of the previous iteration, which is not a maximum; both have the same fixed points.)
///
/// A step takes O(n m d) for variances, O(n m d²) for matrices, and n m exponentials; it
/// allocates nothing. Missing components are treated as in a [`Gaussian`](crate::Gaussian).
///
/// ```
/// use wayfix_learn::{GaussianMixture, Rows};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// // State 0 shows values near -1 or 1, state 1 near 5.
/// let family = GaussianMixture::diagonal(
///     &[[0.5, 0.5], [0.5, 0.5]],
///     &[[[-2.0], [2.0]], [[4.0], [6.0]]],
///     &[[[1.0], [1.0]], [[1.0], [1.0]]],
/// )?;
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.8, 0.2], [0.2, 0.8]])?,
///     family,
/// )?;
/// let values = [-1.1, 0.9, 1.2, -0.8, -1.0, 1.0, 4.8, 5.1, 5.3, 4.9, 5.0, 5.2, -0.9, 1.1];
/// let learned = hmm.learn(&[Rows::new(&values, 1)?], &LearningOptions::default())?;
/// let found = learned.model().likelihood();
/// assert!((found.mean(0, 0).unwrap()[0] + 0.95).abs() < 0.05);
/// assert!((found.mean(0, 1).unwrap()[0] - 1.05).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct GaussianMixture {
    /// All parts, state by state: part p of state i at i m + p, as are the weights.
    normals: Normals,
    parts: usize,
    weights: Vec<f64>,
    log_weights: Vec<f64>,
}

impl GaussianMixture {
    /// Creates mixtures of Gaussians with one variance for all components: for each state the
    /// weights of its parts, and for each part a mean and a variance.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as for [`diagonal`](Self::diagonal).
    pub fn spherical<P: AsRef<[f64]>>(
        weights: &[impl AsRef<[f64]>],
        means: &[impl AsRef<[P]>],
        variances: &[impl AsRef<[f64]>],
    ) -> Result<Self, EmissionError> {
        let rows = variances.iter().map(|row| row.as_ref().iter().map(|v| [*v]).collect());
        let rows: Vec<Vec<[f64; 1]>> = rows.collect();
        Self::new(CovarianceType::Spherical, weights, means, &rows)
    }

    /// Creates mixtures of Gaussians with diagonal covariances: for each state the weights of its
    /// parts, and for each part a mean and its variances.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] without states, parts or components, for a wrong length, weights that are
    /// negative or do not sum to one within 1e-9, a mean that is not finite, or a variance that is
    /// not finite and above 2.2e-308. An error of a part names the part.
    pub fn diagonal<P: AsRef<[f64]>, Q: AsRef<[f64]>>(
        weights: &[impl AsRef<[f64]>],
        means: &[impl AsRef<[P]>],
        variances: &[impl AsRef<[Q]>],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Diagonal, weights, means, variances)
    }

    /// Creates mixtures of Gaussians with full covariances: for each state the weights of its
    /// parts, and for each part a mean and a covariance of d × d values, row after row.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as for [`diagonal`](Self::diagonal), and for a covariance that is not
    /// symmetric within 1e-9 and positive definite.
    pub fn full<P: AsRef<[f64]>, Q: AsRef<[f64]>>(
        weights: &[impl AsRef<[f64]>],
        means: &[impl AsRef<[P]>],
        covariances: &[impl AsRef<[Q]>],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Full, weights, means, covariances)
    }

    /// Creates mixtures of Gaussians with one full covariance for each state, shared by its parts:
    /// for each state the weights of its parts, a mean for each part, and d × d values, row after
    /// row.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as for [`full`](Self::full); an error of a covariance names the state.
    pub fn tied<P: AsRef<[f64]>>(
        weights: &[impl AsRef<[f64]>],
        means: &[impl AsRef<[P]>],
        covariances: &[impl AsRef<[f64]>],
    ) -> Result<Self, EmissionError> {
        let rows: Vec<[&[f64]; 1]> = covariances.iter().map(|matrix| [matrix.as_ref()]).collect();
        Self::new(CovarianceType::Tied, weights, means, &rows)
    }

    /// Creates mixtures with covariances of this type: one for each part, or one for each state if
    /// they are tied.
    pub(crate) fn new<P: AsRef<[f64]>, Q: AsRef<[f64]>>(
        kind: CovarianceType,
        weights: &[impl AsRef<[f64]>],
        means: &[impl AsRef<[P]>],
        covariances: &[impl AsRef<[Q]>],
    ) -> Result<Self, EmissionError> {
        let (states, parts) = (weights.len(), weights.first().map_or(0, |w| w.as_ref().len()));
        let first = means.first().and_then(|means| means.as_ref().first());
        let d = first.map_or(0, |mean| mean.as_ref().len());
        if states == 0 || parts == 0 || d == 0 {
            return Err(EmissionError::Empty { states: states.min(parts), components: d });
        }
        let weights = flatten("list of weights", weights, parts)?;
        check_weights(&weights, parts)?;
        let mean = |rows: &[P]| flatten("mean", rows, d);
        let means = of_parts("list of means", means, [states, parts], mean)?;
        let tied = kind == CovarianceType::Tied;
        let what = "list of covariances";
        let covariances = if tied {
            check_length(what, None, covariances.len(), states)?;
            let mut rows = Vec::with_capacity(states);
            for (state, own) in covariances.iter().enumerate() {
                check_length(what, Some(state), own.as_ref().len(), 1)?;
                rows.push(own.as_ref()[0].as_ref());
            }
            flatten_covariances(kind, &rows, d)?
        } else {
            let covariance = |rows: &[Q]| flatten_covariances(kind, rows, d);
            of_parts(what, covariances, [states, parts], covariance)?
        };
        let normals = Normals::new(kind, d, means, covariances, Settings::default());
        // An error of a tied covariance already names its state; other errors count parts over all
        // states.
        let normals =
            normals.map_err(|error| if tied { error } else { error.in_part(None, parts) })?;
        Ok(Self::of(normals, parts, weights))
    }

    fn of(normals: Normals, parts: usize, weights: Vec<f64>) -> Self {
        let log_weights = weights.iter().map(|weight| weight.ln()).collect();
        Self { normals, parts, weights, log_weights }
    }

    settings!();

    /// Number of Gaussians of each state, m.
    #[must_use]
    pub fn parts(&self) -> usize {
        self.parts
    }

    /// Returns the weights of a state's parts, or `None` if the state does not exist.
    #[must_use]
    pub fn weights(&self, state: usize) -> Option<&[f64]> {
        self.weights.chunks_exact(self.parts).nth(state)
    }

    /// Returns the mean of a part, or `None` if the state or the part does not exist.
    #[must_use]
    pub fn mean(&self, state: usize, part: usize) -> Option<&[f64]> {
        self.normals.mean(self.at(state, part)?)
    }

    /// Returns the covariance of a part, d × d values row after row whatever its type, or `None`
    /// if the state or the part does not exist.
    #[must_use]
    pub fn covariance(&self, state: usize, part: usize) -> Option<Vec<f64>> {
        self.normals.full_covariance(self.at(state, part)?)
    }

    /// Means of all parts, as the constructors take them.
    #[must_use]
    pub fn means(&self) -> Vec<Vec<Vec<f64>>> {
        self.normals.means().chunks(self.parts).map(<[_]>::to_vec).collect()
    }

    /// Covariances of the parts of each state, or a single one if they are tied: a variance, d
    /// variances, or d × d values row after row.
    #[must_use]
    pub fn covariances(&self) -> Vec<Vec<Vec<f64>>> {
        let all = self.normals.covariances();
        all.chunks(all.len() / self.states()).map(<[_]>::to_vec).collect()
    }

    /// Position of a part among the parts of all states.
    fn at(&self, state: usize, part: usize) -> Option<usize> {
        (state < self.states() && part < self.parts).then_some(state * self.parts + part)
    }

    /// Writes ln(w N(y; μ, Σ)) of all parts to the start of `memory`.
    #[inline]
    fn logs<'a>(&self, y: &[f64], memory: &'a mut [Eight]) -> Result<&'a mut [f64], EmissionError> {
        let result = self.normals.distances(y, memory);
        result.map_err(|error| error.in_part(None, self.parts))?;
        self.normals.logs(memory);
        let logs = &mut memory.as_flattened_mut()[..self.weights.len()];
        logs.iter_mut().zip(&self.log_weights).for_each(|(log, weight)| *log += weight);
        Ok(logs)
    }
}

impl Likelihood for GaussianMixture {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.normals.count() / self.parts
    }

    fn diagonal<'a>(
        &'a self,
        y: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let states = self.states();
        let values = scratch.values(self.normals.scratch_blocks() * 8);
        let logs = self.logs(y, as_blocks(values))?;
        for state in 0..states {
            let parts = &logs[state * self.parts..][..self.parts];
            // Relative to the largest part, whose exponential is 1: the sum neither overflows nor
            // vanishes.
            let largest = parts.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let sum: f64 = parts.iter().map(|log| (log - largest).exp()).sum();
            // Overwrites a part of this state or of an earlier one, which is no longer needed.
            logs[state] = if largest == f64::NEG_INFINITY { largest } else { largest + sum.ln() };
        }
        Ok(Diagonal::log(&values[..states]))
    }
}

impl Family for GaussianMixture {
    fn components(&self) -> usize {
        self.normals.components()
    }
}

impl SampleObservation for GaussianMixture {
    type Sample = Vec<f64>;

    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        let first = state * self.parts;
        let weights = self.weights[first..first + self.parts].iter().copied().enumerate();
        self.normals.sample(first + index(weights, 1.0, rng), rng)
    }
}

impl ReorderStates for GaussianMixture {
    fn reordered(&self, order: &[usize]) -> Self {
        let m = self.parts;
        let parts = order.iter().flat_map(|state| state * m..(state + 1) * m);
        let parts: Vec<usize> = parts.collect();
        let weights = parts.iter().map(|at| self.weights[*at]).collect();
        Self::of(self.normals.select(&parts), m, weights)
    }
}

/// The marginal distribution of each component: a mixture with the same weights.
impl Marginals for GaussianMixture {
    fn numbers(&self) -> usize {
        self.normals.components()
    }

    fn number(&self, row: &[f64], component: usize) -> Result<Option<f64>, LikelihoodError> {
        Ok(self.normals.number(row, component)?)
    }

    fn log_density(&self, state: usize, component: usize, y: f64) -> f64 {
        let parts = state * self.parts..(state + 1) * self.parts;
        log_sum(parts.map(|at| self.log_weights[at] + self.normals.log_marginal(at, component, y)))
    }

    fn tails(&self, state: usize, component: usize, y: f64) -> Tails {
        let mut tails = Tails::default();
        for at in state * self.parts..(state + 1) * self.parts {
            tails.add(self.weights[at], self.normals.tails(at, component, y));
        }
        tails
    }
}

// Checks of the parameters of mixtures.

/// Checks the weights of all states.
fn check_weights(weights: &[f64], parts: usize) -> Result<(), EmissionError> {
    for (state, weights) in weights.chunks_exact(parts).enumerate() {
        for (part, &weight) in weights.iter().enumerate() {
            check("weight", weight, weight >= 0.0, "a value of at least 0")
                .map_err(|error| with_place(error, state, Some(part)))?;
        }
        let sum: f64 = weights.iter().sum();
        check("sum of the weights", sum, (sum - 1.0).abs() <= SUM_TOLERANCE, "1")
            .map_err(|error| with_place(error, state, None))?;
    }
    Ok(())
}

/// Checks the parameters of each state's parts, and returns them one after the other.
fn of_parts<M: AsRef<[P]>, P>(
    what: &'static str,
    all: &[M],
    [states, parts]: [usize; 2],
    flatten: impl Fn(&[P]) -> Result<Vec<f64>, EmissionError>,
) -> Result<Vec<f64>, EmissionError> {
    check_length(what, None, all.len(), states)?;
    let mut flat = Vec::new();
    for (state, rows) in all.iter().enumerate() {
        check_length(what, Some(state), rows.as_ref().len(), parts)?;
        flat.extend(flatten(rows.as_ref()).map_err(|error| error.in_part(Some(state), parts))?);
    }
    Ok(flat)
}

// Learning of Gaussian mixtures: the E step over the parts, and the M step of section 9 of the
// formulas.
//
// With the posterior γ_i of state i, part p has the posterior γ_i w_p N_p(y) / Σ_q w_q N_q(y). So
// the parts of all states are Gaussians with these weights, and the weights w_p a distribution
// that is learned from their sums.

impl LearnLikelihood for GaussianMixture {
    /// The sums are the expected numbers of observations of all parts.
    type Statistics = GaussianStatistics;

    fn statistics(&self) -> GaussianStatistics {
        self.normals.statistics(self.weights.len())
    }

    fn add(&self, statistics: &mut GaussianStatistics, y: &[f64], posterior: &[f64]) {
        let GaussianStatistics { moments, sums, weights: [weights, _], memory } = statistics;
        let Ok(logs) = self.logs(y, memory) else {
            return; // invalid
        };
        // Lanes beyond the last part stay at 0.
        let shares = &mut weights.as_flattened_mut()[..self.weights.len()];
        let states = logs.chunks_exact(self.parts).zip(shares.chunks_exact_mut(self.parts));
        for ((logs, shares), p) in states.zip(posterior) {
            let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if *p == 0.0 || largest == f64::NEG_INFINITY {
                shares.fill(0.0);
                continue;
            }
            // Relative to the largest, so the sum is from 1 to the number of parts.
            let exponentials = shares.iter_mut().zip(logs);
            exponentials.for_each(|(share, log)| *share = (log - largest).exp());
            let scale = p / shares.iter().sum::<f64>();
            shares.iter_mut().for_each(|share| *share *= scale);
        }
        sums.iter_mut().zip(shares).for_each(|(sum, share)| *sum += *share);
        self.normals.add(moments, y, weights, weights, memory);
    }

    fn merge(&self, statistics: &mut GaussianStatistics, other: &GaussianStatistics) {
        statistics.merge(other);
    }

    fn maximize(
        &self,
        statistics: &GaussianStatistics,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let normals = self.normals.maximize(&statistics.moments, None);
        let tied = self.normals.kind() == CovarianceType::Tied;
        let normals = normals.map_err(|error| match error.in_part(None, self.parts) {
            // All parts of the state share the covariance, so the error names no part.
            EmissionError::Part { cause, .. }
                if tied && matches!(*cause, EmissionError::TooFew { .. }) =>
            {
                *cause
            }
            error => error,
        })?;
        // Σ S_p ln w_p under Σ w_p = 1 is largest in proportion to S_p (with pseudo-counts).
        let states = self.weights.chunks_exact(self.parts);
        let counts = statistics.sums.chunks_exact(self.parts);
        let weights = states.zip(counts);
        let weights = weights.flat_map(|(old, counts)| shares(old, counts, pseudo_count));
        Ok(Self::of(normals, self.parts, weights.collect()))
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        let normals = self.normals.log_prior();
        if pseudo_count == 0.0 {
            return normals;
        }
        let possible = self.log_weights.iter().filter(|log| **log > f64::NEG_INFINITY);
        normals + pseudo_count * possible.sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        // The weights of a state sum to one, and those of 0 stay so.
        let weights = self.weights.iter().filter(|weight| **weight > 0.0).count();
        weights - self.states() + self.normals.free_parameters()
    }
}

/// Log-odds of the weights above 0 relative to the largest of the state, state by state; then means
/// and covariances, except those that learning keeps.
impl FreeParameters for GaussianMixture {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut weights = self.weights.clone();
        weights.chunks_exact_mut(self.parts).for_each(|weights| by.distribution(weights));
        Ok(Self::of(self.normals.displaced(by)?, self.parts, weights))
    }
}

// Starts of Gaussian mixtures from clusters: the parts of a state are clusters within its own.

impl StartFromClusters for GaussianMixture {
    /// Takes the parts of each state from clusters within the state's cluster. A part with a weight
    /// of 0 stays as it is. Fixed means divide the observations of a state between them.
    fn start<R: Rng + ?Sized>(
        &self,
        clusters: &Clusters<'_>,
        rng: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        // Fixed means already decide which part an observation belongs to.
        if self.has_fixed_means() {
            return clusters.fit(self);
        }
        clusters.check(self)?;
        let m = self.parts;
        let mut weights = Vec::with_capacity(self.weights.len());
        let (mut means, mut covariances) = (Vec::new(), Vec::new());
        for state in 0..self.states() {
            let is_possible = |part: &usize| self.weights[state * m + part] > 0.0;
            let possible: Vec<usize> = (0..m).filter(is_possible).collect();
            let division = clusters.divide(state, &possible, rng)?;
            let parts: Vec<usize> = (state * m..(state + 1) * m).collect();
            let parts = Gaussian::of(self.normals.select(&parts));
            let parts = clusters.fit_parts(&parts, state, &division);
            let parts = parts.map_err(|error| match error.downcast::<EmissionError>() {
                Ok(error) => error.in_part(Some(state), m).into(),
                Err(error) => error,
            })?;
            means.extend(parts.means().concat());
            covariances.extend(parts.covariances().concat());
            // At least 1 each, since a weight of 0 would stay 0.
            let counts = division.counts.iter().map(|(part, count)| (*part, *count.max(&1) as f64));
            let total: f64 = counts.clone().map(|(_, count)| count).sum();
            weights.resize((state + 1) * m, 0.0);
            counts.for_each(|(part, count)| weights[state * m + part] = count / total);
        }
        let (kind, d) = (self.covariance_type(), self.components());
        let normals = Normals::new(kind, d, means, covariances, self.normals.settings().clone())
            .map_err(
                |error| if kind == CovarianceType::Tied { error } else { error.in_part(None, m) },
            )?;
        Ok(Self::of(normals, m, weights))
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] GaussianMixture: [], |family| {
        covariance_type: CovarianceType = family.covariance_type(),
        weights: Vec<Vec<f64>> = weights_of(family),
        means: Vec<Vec<Vec<f64>>> = family.means(),
        covariances: Vec<Vec<Vec<f64>>> = family.covariances(),
        missing: bool = family.takes_missing(),
        fixed_means: bool = family.has_fixed_means(),
        fixed_covariances: bool = family.has_fixed_covariances(),
        prior: Option<crate::GaussianPrior> = family.prior(),
    } => Self::new(covariance_type, &weights, &means, &covariances)
        .map(|new| crate::family::when(missing, new, Self::with_missing))
        .map(|new| crate::family::when(fixed_means, new, Self::with_fixed_means))
        .map(|new| crate::family::when(fixed_covariances, new, Self::with_fixed_covariances))
        .and_then(|new| prior.into_iter().try_fold(new, Self::with_prior));
}

#[cfg(feature = "serde")]
fn weights_of(family: &GaussianMixture) -> Vec<Vec<f64>> {
    crate::family::by_state(|state| family.weights(state).map(<[f64]>::to_vec))
}
