//! Student's t distribution of vectors.

use std::error::Error;

use rand::Rng;
use rand_distr::{ChiSquared, Distribution};

use super::EmissionError;
use super::gaussian::Gaussian;
use super::normal::{CovarianceType, GaussianPrior, Moments, Normals, density, eights, in_blocks};
use super::special::{ln_minus_digamma, log_excess, stirling};
use crate::error::LikelihoodError;
use crate::kernels::Eight;
use crate::likelihood::{Diagonal, LearnLikelihood, Likelihood, SampleObservation, Scratch};
use crate::reorder::ReorderStates;

/// Vectors with Student's t distribution, for noise with outliers: a mean, a scale of one of
/// [four types](CovarianceType) and degrees of freedom for each state.
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
/// An observation is taken for a Gaussian one whose precision is multiplied by an unknown u, of
/// mean 1. Learning expects u (so that outliers count little) and then maximises means and scales
/// in closed form, and ν by Newton's method (Liu and Rubin 1995, without their second pass). It
/// never falls, but where the tails are light, ν grows without end, ever more slowly; then a
/// [`Gaussian`] fits. [`with_fixed_degrees`](Self::with_fixed_degrees) keeps ν.
///
/// Priors, missing components and the complexity of a step are those of a [`Gaussian`], with Σ in
/// place of its covariance; a step also takes n logarithms.
///
/// ```
/// use wayfix::emission::{Rows, StudentT};
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Belief, DenseTransition, Hmm, Prior};
///
/// let values = [0.1, -0.2, 0.3, 90.0, 0.0, -0.1, 5.2, 4.9, -70.0, 5.0, 5.1, 0.2, -0.3];
/// let family = StudentT::spherical(&[2.0, 2.0], &[[-1.0], [4.0]], &[1.0, 1.0])?;
/// let hmm = Hmm::new(
///     Prior::AtFirstObservation(Belief::uniform(2)?),
///     DenseTransition::from_rows(&[[0.8, 0.2], [0.2, 0.8]])?,
///     family.with_fixed_degrees(),
/// )?;
/// let learned = hmm.learn(&[Rows::new(&values, 1)?], &LearningOptions::default())?;
/// let found = learned.model().likelihood();
/// assert!(found.mean(0).unwrap()[0].abs() < 0.2); // in spite of 90
/// assert!((found.mean(1).unwrap()[0] - 5.0).abs() < 0.2); // and of -70
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct StudentT {
    normals: Normals,
    degrees: Vec<f64>,
    /// True if the degrees of freedom are not learned.
    fixed: bool,
    /// For each state, ln(Γ((ν+k)/2) / (Γ(ν/2) (ν/2)^(k/2))) for k = 0 to d components.
    log_norms: Vec<f64>,
    prior: Option<GaussianPrior>,
}

/// Least degrees of freedom: with fewer, draws leave the range of doubles.
const LEAST: f64 = 0.01;

impl StudentT {
    /// Creates a family with one squared scale for each state.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as [`new`](Self::new).
    pub fn spherical<M: AsRef<[f64]>>(
        degrees: &[f64],
        means: &[M],
        scales: &[f64],
    ) -> Result<Self, EmissionError> {
        Self::of_gaussian(degrees, Gaussian::spherical(means, scales)?)
    }

    /// Creates a family with the squared scales of each state's components.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as [`new`](Self::new).
    pub fn diagonal<M: AsRef<[f64]>, V: AsRef<[f64]>>(
        degrees: &[f64],
        means: &[M],
        scales: &[V],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Diagonal, degrees, means, scales)
    }

    /// Creates a family with a scale matrix for each state: d × d values, row after row.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as [`new`](Self::new).
    pub fn full<M: AsRef<[f64]>, V: AsRef<[f64]>>(
        degrees: &[f64],
        means: &[M],
        scales: &[V],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Full, degrees, means, scales)
    }

    /// Creates a family with one scale matrix of all states: d × d values, row after row.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] as [`new`](Self::new).
    pub fn tied<M: AsRef<[f64]>>(
        degrees: &[f64],
        means: &[M],
        scale: &[f64],
    ) -> Result<Self, EmissionError> {
        Self::new(CovarianceType::Tied, degrees, means, &[scale])
    }

    /// Creates a family from the degrees of freedom and the mean of each state, and scales of this
    /// type: one for each state, or a single one if they are tied.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] for degrees of freedom that are not finite and at least 0.01, and as
    /// [`Gaussian::new`], whose covariances the scales are.
    pub fn new<M: AsRef<[f64]>, V: AsRef<[f64]>>(
        scale_type: CovarianceType,
        degrees: &[f64],
        means: &[M],
        scales: &[V],
    ) -> Result<Self, EmissionError> {
        Self::of_gaussian(degrees, Gaussian::new(scale_type, means, scales)?)
    }

    fn of_gaussian(degrees: &[f64], gaussian: Gaussian) -> Result<Self, EmissionError> {
        let (normals, prior) = gaussian.into_parts();
        let (expected, found) = (normals.count(), degrees.len());
        if found != expected {
            let (what, state) = ("list of degrees of freedom", None);
            return Err(EmissionError::Length { what, state, found, expected });
        }
        Self::of(normals, degrees.to_vec(), false, prior)
    }

    fn of(
        normals: Normals,
        degrees: Vec<f64>,
        fixed: bool,
        prior: Option<GaussianPrior>,
    ) -> Result<Self, EmissionError> {
        let valid = |degrees: &f64| *degrees >= LEAST && degrees.is_finite();
        if let Some(state) = degrees.iter().position(|degrees| !valid(degrees)) {
            let (what, value, component) = ("degrees of freedom", degrees[state], None);
            let (state, expected) = (Some(state), "a finite value of at least 0.01");
            return Err(EmissionError::Parameter { what, state, component, value, expected });
        }
        let d = normals.components();
        let norms = degrees.iter().flat_map(|nu| (0..=d).map(move |k| log_norm(nu / 2.0, k)));
        Ok(Self { log_norms: norms.collect(), normals, degrees, fixed, prior })
    }

    /// Returns the family with degrees of freedom that learning keeps.
    #[must_use]
    pub fn with_fixed_degrees(self) -> Self {
        Self { fixed: true, ..self }
    }

    /// Returns the family with missing components, given as NaN, as [`Gaussian::with_missing`].
    #[must_use]
    pub fn with_missing(self) -> Self {
        Self { normals: self.normals.with_missing(), ..self }
    }

    /// Returns the family with a prior of means and scales, for learning, as
    /// [`Gaussian::with_prior`].
    ///
    /// # Errors
    ///
    /// [`EmissionError::Length`] if the prior has another number of components.
    pub fn with_prior(self, prior: GaussianPrior) -> Result<Self, EmissionError> {
        prior.check_components(self.components())?;
        Ok(Self { prior: Some(prior), ..self })
    }

    /// Number of components of an observation, d.
    #[must_use]
    pub fn components(&self) -> usize {
        self.normals.components()
    }

    /// Type of the scales.
    #[must_use]
    pub fn scale_type(&self) -> CovarianceType {
        self.normals.kind()
    }

    /// Degrees of freedom of each state.
    #[must_use]
    pub fn degrees(&self) -> &[f64] {
        &self.degrees
    }

    /// Returns the mean of a state, or `None` if it does not exist.
    #[must_use]
    pub fn mean(&self, state: usize) -> Option<&[f64]> {
        self.normals.mean(state)
    }

    /// Returns the scale matrix of a state, d × d values row after row whatever its type, or
    /// `None` if the state does not exist.
    #[must_use]
    pub fn scale(&self, state: usize) -> Option<Vec<f64>> {
        self.normals.full_covariance(state)
    }

    /// Means of all states, as [`new`](Self::new) takes them.
    #[must_use]
    pub fn means(&self) -> Vec<Vec<f64>> {
        self.normals.means()
    }

    /// Scales in the form in which [`new`](Self::new) takes them.
    #[must_use]
    pub fn scales(&self) -> Vec<Vec<f64>> {
        self.normals.covariances()
    }

    /// True if learning keeps the degrees of freedom.
    #[must_use]
    pub fn has_fixed_degrees(&self) -> bool {
        self.fixed
    }

    /// True if components may be missing.
    #[must_use]
    pub fn has_missing(&self) -> bool {
        self.normals.has_missing()
    }

    /// The prior of learning, if there is one.
    #[must_use]
    pub fn prior(&self) -> Option<&GaussianPrior> {
        self.prior.as_ref()
    }
}

/// ln(Γ(a + h) / (Γ(a) a^h)) for k = 2 h components, by Stirling's formula with its error, in
/// which what is large cancels.
fn log_norm(a: f64, k: usize) -> f64 {
    let h = k as f64 / 2.0;
    let ratio = h / a;
    (h - 0.5) * ratio - (a + h - 0.5) * log_excess(ratio) + stirling(a + h) - stirling(a)
}

impl Likelihood for StudentT {
    type Observation = [f64];

    fn states(&self) -> usize {
        self.normals.count()
    }

    fn diagonal<'a>(
        &'a self,
        y: &'a [f64],
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        let (n, d) = (self.degrees.len(), self.normals.components());
        let values = scratch.values(self.normals.memory() * 8);
        let memory = eights(values);
        let observed = self.normals.distances(y, memory)?;
        let (distances, norms) = memory.as_flattened_mut().split_at_mut(self.normals.blocks() * 8);
        for (state, (distance, norm)) in distances.iter_mut().zip(norms).enumerate().take(n) {
            let nu = self.degrees[state];
            let power = 0.5 * (nu + observed as f64) * (*distance / nu).ln_1p();
            *distance = density(*norm + self.log_norms[state * (d + 1) + observed] - power);
        }
        Ok(Diagonal::log(&values[..n]))
    }
}

impl SampleObservation for StudentT {
    type Sample = Vec<f64>;

    /// Draws an observation. Those beyond the range of doubles are drawn again.
    fn sample<R: Rng + ?Sized>(&self, state: usize, rng: &mut R) -> Vec<f64> {
        let nu = self.degrees[state];
        let chi_squared = ChiSquared::new(nu).expect("degrees of freedom are above 0");
        let mean = &self.normals.mean(state).expect("the state exists")[..];
        loop {
            let mut y = self.normals.sample(state, rng);
            let stretch = (nu / chi_squared.sample(rng)).sqrt();
            y.iter_mut().zip(mean).for_each(|(y, mean)| *y = mean + (*y - mean) * stretch);
            if y.iter().all(|y| y.is_finite()) {
                return y;
            }
        }
    }
}

/// Statistics of a [`StudentT`]: weights, means and scatter of the observations of each state, and
/// what is expected of their precisions.
#[derive(Debug, Clone)]
pub struct StudentTStatistics {
    moments: Moments,
    /// Weights of each state's observations by component, not multiplied by precisions.
    counts: Vec<f64>,
    /// Sums for each state of the weights, and of E[u − 1 − ln u].
    excess: Vec<[f64; 2]>,
    weights: Vec<f64>,
    blocks: [Vec<Eight>; 2],
    memory: Vec<Eight>,
}

impl LearnLikelihood for StudentT {
    type Statistics = StudentTStatistics;

    fn statistics(&self) -> StudentTStatistics {
        let (n, d) = (self.degrees.len(), self.normals.components());
        let blocks = vec![Eight::default(); self.normals.blocks()];
        StudentTStatistics {
            moments: self.normals.moments(),
            counts: vec![0.0; n * d],
            excess: vec![[0.0; 2]; n],
            weights: vec![0.0; n],
            blocks: [blocks.clone(), blocks],
            memory: vec![Eight::default(); self.normals.memory()],
        }
    }

    fn add(&self, statistics: &mut StudentTStatistics, y: &[f64], posterior: &[f64]) {
        let StudentTStatistics { moments, counts, excess, weights, blocks, memory } = statistics;
        let observed = match self.normals.distances(y, memory) {
            Ok(observed) if observed > 0 => observed as f64,
            _ => return, // has no posterior, or says nothing
        };
        let d = self.normals.components();
        let by_component = self.normals.counts_by_component();
        let logs = ln_minus_digamma;
        for (state, (w, distance)) in posterior.iter().zip(memory.as_flattened()).enumerate() {
            let nu = self.degrees[state];
            let u = (nu + observed) / (nu + distance);
            weights[state] = w * u;
            if *w > 0.0 {
                let u_less_1 = (observed - distance) / (nu + distance);
                let value = log_excess(u_less_1) + logs(0.5 * (nu + observed)).0;
                excess[state][0] += w;
                excess[state][1] += w * value;
                let counts = counts[state * d..][..d].iter_mut().zip(y);
                let seen = counts.filter(|(_, y)| !(by_component && y.is_nan()));
                seen.for_each(|(count, _)| *count += w);
            }
        }
        let [weighted, plain] = blocks;
        in_blocks(weights, weighted);
        in_blocks(posterior, plain);
        self.normals.add(moments, y, weighted, plain, memory);
    }

    fn merge(&self, statistics: &mut StudentTStatistics, other: &StudentTStatistics) {
        statistics.moments.merge(&other.moments);
        let counts = statistics.counts.iter_mut().zip(&other.counts);
        counts.for_each(|(count, other)| *count += other);
        let excess = statistics.excess.as_flattened_mut().iter_mut();
        excess.zip(other.excess.as_flattened()).for_each(|(sum, other)| *sum += other);
    }

    fn reestimate(
        &self,
        statistics: &StudentTStatistics,
        _: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let (prior, counts) = (self.prior.as_ref(), Some(&*statistics.counts));
        let normals = self.normals.maximize(&statistics.moments, counts, prior)?;
        let degrees = self.degrees.iter().zip(&statistics.excess).map(|(nu, [weight, sum])| {
            if self.fixed || *weight < f64::MIN_POSITIVE {
                *nu
            } else {
                2.0 * half_degrees(sum / weight, nu / 2.0)
            }
        });
        Ok(Self::of(normals, degrees.collect(), self.fixed, self.prior.clone())?)
    }

    fn log_prior(&self, _: f64) -> f64 {
        self.prior.as_ref().map_or(0.0, |prior| prior.log_density(&self.normals))
    }

    fn free_parameters(&self) -> usize {
        self.normals.free_parameters() + if self.fixed { 0 } else { self.degrees.len() }
    }
}

/// The a at which ln a − ψ(a) has this value, above 0. It falls as 1 / a, and as 1 / 2a for large
/// a, so that Newton's method on logarithms is nearly exact.
fn half_degrees(value: f64, start: f64) -> f64 {
    let mut log = start.ln();
    for _ in 0..50 {
        let (found, slope) = ln_minus_digamma(log.exp());
        let step = (value / found).ln() * found / slope;
        log += step;
        if step.abs() <= 1e-14 * log.abs().max(1.0) {
            break;
        }
    }
    log.exp()
}

impl ReorderStates for StudentT {
    fn reordered(&self, order: &[usize]) -> Self {
        let d = self.normals.components();
        let norms = order.iter().flat_map(|state| &self.log_norms[state * (d + 1)..][..=d]);
        Self {
            normals: self.normals.select(order.iter().copied()),
            degrees: order.iter().map(|state| self.degrees[*state]).collect(),
            fixed: self.fixed,
            log_norms: norms.copied().collect(),
            prior: self.prior.clone(),
        }
    }
}
