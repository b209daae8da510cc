//! Student's t distribution of vectors: its densities b_i(y) (section 1 of the guide's formulas),
//! by the squared distance that a Gaussian with its scale as covariance has.

use std::error::Error;
use std::f64::consts::TAU;

use rand::Rng;
use rand_distr::{ChiSquared, Distribution};
use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Diagonal, Likelihood, LikelihoodError, ReorderStates, Scratch};

use crate::clusters::ROUNDS;
use crate::error::{check, check_length, with_place};
use crate::normal::{GaussianStatistics, as_blocks, in_blocks, log_density_or_zero};
use crate::special::{Odds, inverse_ln_minus_digamma, ln_minus_digamma, ln_rising, log_excess};
use crate::{Clusters, EmissionError, Family, Gaussian, Marginals, StartFromClusters, Tails};

/// Vectors with Student's t distribution, for noise with outliers: a [`Gaussian`] whose covariance
/// is the scale, and degrees of freedom for each state.
///
/// With the mean μ, the scale Σ and the degrees of freedom ν of a state, the density of an
/// observation of d numbers is
///
/// ```text
/// p(y) = Γ((ν+d)/2) / (Γ(ν/2) (νπ)^(d/2) det(Σ)^(1/2)) (1 + (y − μ)' Σ⁻¹ (y − μ) / ν)^(−(ν+d)/2),
/// ```
///
/// a Gaussian for large ν; its covariance is Σ ν / (ν − 2) for ν > 2.
///
/// Each observation is treated as Gaussian with its precision multiplied by an unknown u of mean 1.
/// Learning takes the expectation of u (so that outliers count little), then maximises means and
/// scales in closed form, and ν by Newton's method (Liu and Rubin 1995, without their second pass).
/// The likelihood never falls, but where the tails are light, ν grows without end, ever more
/// slowly; then a [`Gaussian`] fits. [`with_fixed_degrees`](Self::with_fixed_degrees) keeps ν.
///
/// Priors, missing components, fixed parameters and the complexity of a step are those of the
/// [`Gaussian`], with Σ in place of its covariance; a step also takes n logarithms.
///
/// ```
/// use wayfix_learn::{Gaussian, Rows, StudentT};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let values = [0.1, -0.2, 0.3, 90.0, 0.0, -0.1, 5.2, 4.9, -70.0, 5.0, 5.1, 0.2, -0.3];
/// let family = StudentT::new(&[2.0, 2.0], Gaussian::spherical(&[[-1.0], [4.0]], &[1.0, 1.0])?)?;
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.8, 0.2], [0.2, 0.8]])?,
///     family.with_fixed_degrees(),
/// )?;
/// let learned = hmm.learn(&[Rows::new(&values, 1)?], &LearningOptions::default())?;
/// let found = learned.model().likelihood().gaussian();
/// assert!(found.mean(0).unwrap()[0].abs() < 0.2); // in spite of 90
/// assert!((found.mean(1).unwrap()[0] - 5.0).abs() < 0.2); // and of -70
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct StudentT {
    gaussian: Gaussian,
    degrees: Vec<f64>,
    /// True if the degrees of freedom are not learned.
    fixed: bool,
    /// For each state, ln(Γ((ν+k)/2) / (Γ(ν/2) (ν/2)^(k/2))) for k = 0 to d components.
    log_norms: Vec<f64>,
}

/// Smallest number of degrees of freedom: with fewer, draws leave the range of doubles.
const LEAST: f64 = 0.01;

impl StudentT {
    /// Creates a family from the degrees of freedom of each state, and a Gaussian with its mean and
    /// its scale.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for another number of states, or degrees of freedom that are not finite
    /// and at least 0.01.
    pub fn new(degrees: &[f64], gaussian: Gaussian) -> Result<Self, EmissionError> {
        check_length("list of degrees of freedom", None, degrees.len(), gaussian.states())?;
        Self::of(gaussian, degrees.to_vec(), false)
    }

    fn of(gaussian: Gaussian, degrees: Vec<f64>, fixed: bool) -> Result<Self, EmissionError> {
        for (state, &nu) in degrees.iter().enumerate() {
            let valid = nu >= LEAST && nu.is_finite();
            check("degrees of freedom", nu, valid, "a finite value of at least 0.01")
                .map_err(|error| with_place(error, state, None))?;
        }
        let d = gaussian.components();
        // (νπ)^(−k/2) = (2π)^(−k/2) (ν/2)^(−k/2), and the Gaussian norm has the first factor. The
        // rest, Γ((ν+k)/2) / (Γ(ν/2) (ν/2)^(k/2)), is `ln_rising`, for each number k of components
        // that are not missing.
        let norms = degrees.iter().flat_map(|nu| (0..=d).map(move |k| ln_rising(nu / 2.0, k)));
        Ok(Self { log_norms: norms.collect(), gaussian, degrees, fixed })
    }

    /// Returns the family with its degrees of freedom fixed during learning.
    #[must_use]
    pub fn with_fixed_degrees(self) -> Self {
        Self { fixed: true, ..self }
    }

    /// Means, scales (as covariances) and settings.
    #[must_use]
    pub fn gaussian(&self) -> &Gaussian {
        &self.gaussian
    }

    /// Degrees of freedom of each state.
    #[must_use]
    pub fn degrees(&self) -> &[f64] {
        &self.degrees
    }

    /// True if learning keeps the degrees of freedom.
    #[must_use]
    pub fn has_fixed_degrees(&self) -> bool {
        self.fixed
    }
}

impl Likelihood for StudentT {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.degrees.len()
    }

    fn diagonal<'a>(
        &'a self,
        y: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let (normals, n) = (self.gaussian.normals(), self.degrees.len());
        let d = normals.components();
        let values = scratch.values(normals.scratch_blocks() * 8);
        let memory = as_blocks(values);
        // ln p = ln N(μ; μ, Σ) + ln norm − (ν + k)/2 · ln(1 + distance / ν), for k observed
        // components.
        let observed = normals.distances(y, memory)?;
        let (distances, norms) = memory.as_flattened_mut().split_at_mut(normals.blocks() * 8);
        for (state, (distance, norm)) in distances.iter_mut().zip(norms).enumerate().take(n) {
            let nu = self.degrees[state];
            let power = 0.5 * (nu + observed as f64) * (*distance / nu).ln_1p();
            *distance =
                log_density_or_zero(*norm + self.log_norms[state * (d + 1) + observed] - power);
        }
        Ok(Diagonal::log(&values[..n]))
    }
}

impl Family for StudentT {
    fn components(&self) -> usize {
        self.gaussian.components()
    }
}

impl SampleObservation for StudentT {
    type Sample = Vec<f64>;

    /// Draws an observation, again if it is beyond the range of doubles.
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        let nu = self.degrees[state];
        let chi_squared = ChiSquared::new(nu).expect("degrees of freedom are above 0");
        let mean = self.gaussian.mean(state).expect("the state exists");
        // μ + (Gaussian − μ) / √u, where ν u has a chi-squared distribution.
        loop {
            let mut y = self.gaussian.sample(state, rng);
            let stretch = (nu / chi_squared.sample(rng)).sqrt();
            y.iter_mut().zip(mean).for_each(|(y, mean)| *y = mean + (*y - mean) * stretch);
            if y.iter().all(|y| y.is_finite()) {
                return y;
            }
        }
    }
}

impl ReorderStates for StudentT {
    fn reordered(&self, order: &[usize]) -> Self {
        let d = self.gaussian.components();
        let norms = order.iter().flat_map(|state| &self.log_norms[state * (d + 1)..][..=d]);
        Self {
            gaussian: self.gaussian.reordered(order),
            degrees: order.iter().map(|state| self.degrees[*state]).collect(),
            fixed: self.fixed,
            log_norms: norms.copied().collect(),
        }
    }
}

/// The marginal distribution of each component, with its own scale. Tails take O(1): an incomplete
/// beta function, in some hundred evaluations.
impl Marginals for StudentT {
    fn numbers(&self) -> usize {
        self.gaussian.components()
    }

    fn number(&self, row: &[f64], component: usize) -> Result<Option<f64>, LikelihoodError> {
        self.gaussian.number(row, component)
    }

    fn log_density(&self, state: usize, component: usize, y: f64) -> f64 {
        if !y.is_finite() {
            return f64::NEG_INFINITY;
        }
        let [z, ln_scale] = self.gaussian.normals().standardize(state, component, y);
        let (nu, d) = (self.degrees[state], self.gaussian.components());
        // ln(1 + z² / ν), computed as 2 ln |z / √ν| where the square might overflow.
        let ratio = z.abs() / nu.sqrt();
        let tail = if ratio < 1e100 { (ratio * ratio).ln_1p() } else { 2.0 * ratio.ln() };
        let norm = self.log_norms[state * (d + 1) + 1] - 0.5 * TAU.ln() - ln_scale;
        log_density_or_zero(norm - 0.5 * (nu + 1.0) * tail)
    }

    fn tails(&self, state: usize, component: usize, y: f64) -> Tails {
        let z = self.gaussian.normals().standardize(state, component, y)[0];
        // By symmetry half of P(|T| > |z|) is beyond z, and half of the rest between it and the
        // mean.
        let [beyond, within] = Odds::student(self.degrees[state], z).map(|p| 0.5 * p);
        let sides = [beyond, 0.5 + within];
        Tails::between(if z < 0.0 { sides } else { [sides[1], sides[0]] })
    }
}

// Learning of Student's t (section 9 of the formulas): expected precisions in the E step, weighted
// least squares in the M step.
//
// Given u, an observation is N(μ, Σ / u), and u is gamma with shape and rate ν/2. Its posterior is
// gamma with shape (ν + k)/2 and rate (ν + δ²)/2, for k observed components at the squared
// distance δ²:
//
// ```text
// E[u]     = (ν + k) / (ν + δ²)
// E[ln u]  = ψ((ν + k)/2) − ln((ν + δ²)/2)
// ```

impl LearnLikelihood for StudentT {
    /// The sums are the weights γ, without precisions u, by state and component, and then for each
    /// state the sum of γ and that of γ E[u − 1 − ln u].
    type Statistics = GaussianStatistics;

    fn statistics(&self) -> GaussianStatistics {
        self.gaussian.normals().statistics(self.degrees.len() * (self.gaussian.components() + 2))
    }

    fn add(&self, statistics: &mut GaussianStatistics, y: &[f64], posterior: &[f64]) {
        let GaussianStatistics { moments, sums, weights: [weighted, plain], memory } = statistics;
        let normals = self.gaussian.normals();
        let observed = match normals.distances(y, memory) {
            Ok(observed) if observed > 0 => observed as f64,
            _ => return, // invalid, or entirely missing
        };
        let d = normals.components();
        let by_component = normals.counts_by_component();
        let (counts, excess) = sums.split_at_mut(self.degrees.len() * d);
        let excess = excess.as_chunks_mut::<2>().0;
        // Lanes beyond the last state stay at 0.
        let weights = weighted.as_flattened_mut();
        for (state, (w, distance)) in posterior.iter().zip(memory.as_flattened()).enumerate() {
            let nu = self.degrees[state];
            // Means and scales are weighted by γ E[u], as in the formula at the top.
            let u = (nu + observed) / (nu + distance);
            weights[state] = w * u;
            if *w > 0.0 {
                // E[u − 1 − ln u] = (E[u] − 1 − ln E[u]) + (ln a − ψ(a)) with a = (ν + k)/2: two
                // positive terms with all their digits. Subtracting 1 from E[u] would cancel for
                // large ν.
                let u_less_1 = (observed - distance) / (nu + distance);
                let value = log_excess(u_less_1) + ln_minus_digamma(0.5 * (nu + observed)).0;
                excess[state][0] += w;
                excess[state][1] += w * value;
                // The scale is divided by Σ γ, not Σ γ u. A component that is expected given the
                // others counts; one that is left out does not.
                let counts = counts[state * d..][..d].iter_mut().zip(y);
                let seen = counts.filter(|(_, y)| !(by_component && y.is_nan()));
                seen.for_each(|(count, _)| *count += w);
            }
        }
        // The conditional covariance of missing components is Σ / u, and weighted by γ u it counts
        // with γ alone.
        in_blocks(posterior, plain);
        normals.add(moments, y, weighted, plain, memory);
    }

    fn merge(&self, statistics: &mut GaussianStatistics, other: &GaussianStatistics) {
        statistics.merge(other);
    }

    fn maximize(
        &self,
        statistics: &GaussianStatistics,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let normals = self.gaussian.normals();
        let (counts, excess) = statistics.sums.split_at(self.degrees.len() * normals.components());
        let gaussian = Gaussian::of(normals.maximize(&statistics.moments, Some(counts))?);
        // Q as a function of ν is Σ γ (ν/2 · (ln(ν/2) + E[ln u − u]) − ln Γ(ν/2)): its derivative
        // is 0 where ln(ν/2) − ψ(ν/2) is the mean of E[u − 1 − ln u]. The left side falls in ν, so
        // the root is unique.
        let excess = excess.as_chunks::<2>().0;
        let degrees = self.degrees.iter().zip(excess).map(|(nu, [weight, sum])| {
            if self.fixed || *weight < f64::MIN_POSITIVE {
                *nu
            } else {
                2.0 * inverse_ln_minus_digamma(sum / weight, nu / 2.0)
            }
        });
        Ok(Self::of(gaussian, degrees.collect(), self.fixed)?)
    }

    fn log_prior(&self, _: f64) -> f64 {
        self.gaussian.normals().log_prior()
    }

    fn free_parameters(&self) -> usize {
        self.gaussian.free_parameters() + if self.fixed { 0 } else { self.degrees.len() }
    }
}

/// Means, then scales, then degrees of freedom, except those that learning keeps.
impl FreeParameters for StudentT {
    fn displaced(&self, by: &mut Displacement<'_>) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let gaussian = self.gaussian.displaced(by)?;
        let mut degrees = self.degrees.clone();
        if !self.fixed {
            degrees.iter_mut().for_each(|nu| *nu = by.positive(*nu));
        }
        Ok(Self::of(gaussian, degrees, self.fixed)?)
    }
}

// Starts of Student's t from clusters.

impl StartFromClusters for StudentT {
    /// Takes means and covariances from the clusters as for a Gaussian, and improves them in a few
    /// rounds of learning. Degrees of freedom stay as they are: far from the right means they would
    /// be learned from outliers alone.
    fn start<R: Rng + ?Sized>(
        &self,
        clusters: &Clusters<'_>,
        _: &mut R,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        // Each round is an E and an M step with fixed degrees of freedom. The setting itself is
        // kept.
        let first = Self::of(clusters.fit(&self.gaussian)?, self.degrees.clone(), true)?;
        let last = (0..ROUNDS).try_fold(first, |family, _| clusters.round(&family))?;
        Ok(Self { fixed: self.fixed, ..last })
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] StudentT: [], |family| {
        scale_type: crate::CovarianceType = family.gaussian().covariance_type(),
        degrees: Vec<f64> = family.degrees(),
        means: Vec<Vec<f64>> = family.gaussian().means(),
        scales: Vec<Vec<f64>> = family.gaussian().covariances(),
        fixed_degrees: bool = family.has_fixed_degrees(),
        missing: bool = family.gaussian().takes_missing(),
        fixed_means: bool = family.gaussian().has_fixed_means(),
        fixed_covariances: bool = family.gaussian().has_fixed_covariances(),
        prior: Option<crate::GaussianPrior> = family.gaussian().prior(),
    } => Gaussian::new(scale_type, &means, &scales)
        .map(|new| crate::family::when(missing, new, Gaussian::with_missing))
        .map(|new| crate::family::when(fixed_means, new, Gaussian::with_fixed_means))
        .map(|new| crate::family::when(fixed_covariances, new, Gaussian::with_fixed_covariances))
        .and_then(|new| prior.into_iter().try_fold(new, Gaussian::with_prior))
        .and_then(|gaussian| Self::new(&degrees, gaussian))
        .map(|new| crate::family::when(fixed_degrees, new, Self::with_fixed_degrees));
}
