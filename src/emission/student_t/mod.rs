//! Student's t distribution of vectors.

mod learn;
mod start;

use rand::Rng;
use rand_distr::{ChiSquared, Distribution};

use super::EmissionError;
use super::gaussian::Gaussian;
use super::normal::{CovarianceType, GaussianPrior, Normals, density, eights, settings};
use super::special::{log_excess, stirling};
use crate::error::LikelihoodError;
use crate::likelihood::{Diagonal, Likelihood, SampleObservation, Scratch};
use crate::reorder::ReorderStates;

pub use learn::StudentTStatistics;

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

    settings!();

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
        let mean = self.normals.mean(state).expect("the state exists");
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

impl ReorderStates for StudentT {
    fn reordered(&self, order: &[usize]) -> Self {
        let d = self.normals.components();
        let norms = order.iter().flat_map(|state| &self.log_norms[state * (d + 1)..][..=d]);
        Self {
            normals: self.normals.select(order),
            degrees: order.iter().map(|state| self.degrees[*state]).collect(),
            fixed: self.fixed,
            log_norms: norms.copied().collect(),
            prior: self.prior.clone(),
        }
    }
}
