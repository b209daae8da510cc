//! Priors of Gaussian families: normal for the mean and inverse Wishart for the covariance.

use super::covariance::is_semidefinite;
use crate::EmissionError;
use crate::error::{check, check_length};

/// Largest asymmetry of a matrix that counts as rounding, relative to the diagonal.
pub(super) const SYMMETRY: f64 = 1e-9;

/// Prior of the means and covariances of a Gaussian family, the same for each state.
///
/// Up to a constant, its log density at a mean μ and a covariance Σ is
///
/// ```text
/// −½ κ (μ − μ0)' Σ⁻¹ (μ − μ0) − ½ (ν ln det Σ + tr(Ψ Σ⁻¹)),
/// ```
///
/// where the second part counts once if the covariance is tied. With the weight N of a state, the
/// weighted mean m of its observations and their scatter S about the new mean, the maximum is at
///
/// ```text
/// μ = (κ μ0 + N m) / (κ + N),    Σ = (Ψ + S + κ (μ − μ0)(μ − μ0)') / (ν + N),
/// ```
///
/// or the diagonal of this Σ, or the mean of its diagonal. Each of κ, ν and Ψ may be 0; without a
/// prior, all are. Ψ = 0.01 times the variances of all observations, with ν = 0, keeps covariances
/// positive definite and hardly changes them otherwise. A component that never changes has a
/// variance of 0, and so would Ψ: give it the square of the sensor's resolution instead (1 for
/// whole numbers), which leaves a variance of Ψ / N, or leave the component out.
///
/// # From hmmlearn
///
/// `means_weight` is κ and `means_prior` μ0. In d dimensions,
///
/// | class | `covariance_type` | Ψ | ν |
/// |---|---|---|---|
/// | `GaussianHMM` | `spherical`, `diag` | diagonal: `covars_prior` | max(`covars_weight` − 1, 0) |
/// | `GaussianHMM` | `full`, `tied` | `covars_prior`; a number stands for a matrix with **all** entries equal to it | max(`covars_weight` − d, 0) |
/// | `GMMHMM` | `diag` | diagonal: 2 `covars_weight` | 2 `covars_prior` + 3 |
/// | `GMMHMM` | `full` | `covars_prior` | `covars_weight` + d + 2 |
///
/// So the defaults of `GaussianHMM` (0, 0, 0.01 and 1) are Ψ = 0.01 for each variance, or for each
/// of the d² entries of a matrix, with ν = 0. The defaults of `GMMHMM` mean no prior.
///
/// ```
/// use wayfix_learn::{Gaussian, GaussianPrior};
///
/// let prior = GaussianPrior::new(2)?.with_covariance(0.0, &[0.01, 0.01])?;
/// let family = Gaussian::diagonal(&[[0.0, 0.0], [4.0, 4.0]], &[[1.0, 2.0], [1.0, 2.0]])?;
/// let family = family.with_prior(prior)?; // as `GaussianHMM(2)`
/// # assert!(family.prior().is_some());
/// # Ok::<(), wayfix_learn::EmissionError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct GaussianPrior {
    pub(crate) mean_weight: f64,
    pub(crate) mean: Vec<f64>,
    pub(super) covariance_weight: f64,
    /// Ψ, row after row.
    pub(super) scale: Vec<f64>,
}

impl GaussianPrior {
    /// Creates a flat prior for observations of d components.
    ///
    /// # Errors
    ///
    /// [`EmissionError::Empty`] without components.
    pub fn new(components: usize) -> Result<Self, EmissionError> {
        if components == 0 {
            return Err(EmissionError::Empty { states: 1, components });
        }
        let scale = vec![0.0; components * components];
        Ok(Self { mean_weight: 0.0, mean: vec![0.0; components], covariance_weight: 0.0, scale })
    }

    /// Sets κ, the number of observations that the prior mean counts for, and the prior mean μ0.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] unless κ is finite and not negative, and μ0 has d finite values.
    pub fn with_mean(self, weight: f64, mean: &[f64]) -> Result<Self, EmissionError> {
        self.check("mean of the prior", mean, self.mean.len())?;
        check_weight("weight of the prior mean", weight)?;
        Ok(Self { mean_weight: weight, mean: mean.to_vec(), ..self })
    }

    /// Sets ν, the number of observations that the prior covariance counts for, and their scatter
    /// Ψ: d values for a diagonal matrix, or d × d values row after row. Families with variances
    /// use only the diagonal.
    ///
    /// # Errors
    ///
    /// [`EmissionError`] unless ν is finite and not negative, and Ψ is finite, symmetric within
    /// 1e-9 and positive semi-definite.
    pub fn with_covariance(self, weight: f64, scale: &[f64]) -> Result<Self, EmissionError> {
        let (d, what) = (self.mean.len(), "scale of the prior covariance");
        check_weight("weight of the prior covariance", weight)?;
        // A diagonal or a full matrix: for d = 1 both forms are the same value.
        let full: Vec<f64> = if scale.len() == d {
            let entry = |at: usize| if at / d == at % d { scale[at / d] } else { 0.0 };
            (0..d * d).map(entry).collect()
        } else {
            scale.to_vec()
        };
        self.check(what, &full, d * d)?;
        let wrong = |i: usize, value, expected| {
            let component = Some(i);
            Err(EmissionError::Parameter { what, state: None, component, value, expected })
        };
        for i in 0..d {
            if full[i * d + i] < 0.0 {
                return wrong(i, full[i * d + i], "a value of at least 0 on the diagonal");
            }
            // Relative to √(Ψ_ii Ψ_jj), the largest that |Ψ_ij| can be.
            let scale = |j: usize| (full[i * d + i] * full[j * d + j]).sqrt();
            let differ =
                |j: &usize| (full[i * d + j] - full[j * d + i]).abs() > SYMMETRY * scale(*j);
            if let Some(j) = (0..i).find(differ) {
                return wrong(i, full[i * d + j], "a symmetric matrix");
            }
        }
        if !is_semidefinite(d, &full) {
            let (state, component) = (None, 0);
            return Err(EmissionError::NotPositiveDefinite { state, component });
        }
        Ok(Self { covariance_weight: weight, scale: full, ..self })
    }

    fn check(
        &self,
        what: &'static str,
        values: &[f64],
        expected: usize,
    ) -> Result<(), EmissionError> {
        check_length(what, None, values.len(), expected)?;
        let wrong = values.iter().position(|value| !value.is_finite());
        wrong.map_or(Ok(()), |at| {
            let component = Some(at % self.mean.len());
            let (state, value, expected) = (None, values[at], "a finite value");
            Err(EmissionError::Parameter { what, state, component, value, expected })
        })
    }

    /// Weight κ and mean μ0.
    #[must_use]
    pub fn mean(&self) -> (f64, &[f64]) {
        (self.mean_weight, &self.mean)
    }

    /// Weight ν and scale Ψ, row after row.
    #[must_use]
    pub fn covariance(&self) -> (f64, &[f64]) {
        (self.covariance_weight, &self.scale)
    }

    /// Checks that the prior is for observations of d components.
    pub(super) fn check_components(&self, d: usize) -> Result<(), EmissionError> {
        check_length("mean of the prior", None, self.mean.len(), d)
    }
}

fn check_weight(what: &'static str, value: f64) -> Result<f64, EmissionError> {
    check(what, value, value >= 0.0 && value.is_finite(), "a finite value of at least 0")
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [] GaussianPrior: [], |prior| {
        mean_weight: f64 = prior.mean().0,
        mean: Vec<f64> = prior.mean().1,
        covariance_weight: f64 = prior.covariance().0,
        scale: Vec<f64> = prior.covariance().1,
    } => prior(mean_weight, &mean, covariance_weight, &scale);
}

#[cfg(feature = "serde")]
fn prior(
    mean_weight: f64,
    mean: &[f64],
    covariance_weight: f64,
    scale: &[f64],
) -> Result<GaussianPrior, EmissionError> {
    GaussianPrior::new(mean.len())?
        .with_mean(mean_weight, mean)?
        .with_covariance(covariance_weight, scale)
}
