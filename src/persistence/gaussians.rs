//! Formats of Gaussian families.

use super::stored;
use crate::emission::{CovarianceType, EmissionError, GaussianMixture, GaussianPrior};

stored! {
    [] GaussianPrior in emission: [], |prior| {
        mean_weight: f64 = prior.mean().0,
        mean: Vec<f64> = prior.mean().1,
        covariance_weight: f64 = prior.covariance().0,
        scale: Vec<f64> = prior.covariance().1,
    } => prior(mean_weight, &mean, covariance_weight, &scale);

    [] Gaussian in emission: [], |family| {
        covariance_type: CovarianceType = family.covariance_type(),
        means: Vec<Vec<f64>> = family.means(),
        covariances: Vec<Vec<f64>> = family.covariances(),
        missing: bool = family.takes_missing(),
        fixed_means: bool = family.has_fixed_means(),
        fixed_covariances: bool = family.has_fixed_covariances(),
        prior: Option<GaussianPrior> = family.prior(),
    } => Self::new(covariance_type, &means, &covariances)
        .and_then(|family| family.restored([missing, fixed_means, fixed_covariances], prior));

    [] GaussianMixture in emission: [], |family| {
        full: bool = (family.covariance_type() == CovarianceType::Full),
        weights: Vec<Vec<f64>> = weights_of(family),
        means: Vec<Vec<Vec<f64>>> = family.means(),
        covariances: Vec<Vec<Vec<f64>>> = family.covariances(),
        missing: bool = family.takes_missing(),
        fixed_means: bool = family.has_fixed_means(),
        fixed_covariances: bool = family.has_fixed_covariances(),
        prior: Option<GaussianPrior> = family.prior(),
    } => Self::new(matrices(full), &weights, &means, &covariances)
        .and_then(|family| family.restored([missing, fixed_means, fixed_covariances], prior));

    [] StudentT in emission: [], |family| {
        scale_type: CovarianceType = family.scale_type(),
        degrees: Vec<f64> = family.degrees(),
        means: Vec<Vec<f64>> = family.means(),
        scales: Vec<Vec<f64>> = family.scales(),
        fixed_degrees: bool = family.has_fixed_degrees(),
        missing: bool = family.takes_missing(),
        fixed_means: bool = family.has_fixed_means(),
        fixed_covariances: bool = family.has_fixed_covariances(),
        prior: Option<GaussianPrior> = family.prior(),
    } => Self::new(scale_type, &degrees, &means, &scales)
        .map(|family| if fixed_degrees { family.with_fixed_degrees() } else { family })
        .and_then(|family| family.restored([missing, fixed_means, fixed_covariances], prior));

    [] LinearRegression in emission: [], |family| {
        full: bool = (family.covariance_type() == CovarianceType::Full),
        coefficients: Vec<Vec<f64>> = by_state(|state| family.coefficients(state)),
        intercepts: Vec<Vec<f64>> = by_state(|state| family.intercept(state)),
        covariances: Vec<Vec<f64>> = family.covariances(),
        missing: bool = family.takes_missing(),
        ridge: f64 = family.ridge(),
        noise_prior: Option<GaussianPrior> = family.noise_prior(),
    } => Self::new(matrices(full), &coefficients, &intercepts, &covariances)
        .and_then(|family| family.with_ridge(ridge))
        .map(|family| if missing { family.with_missing() } else { family })
        .and_then(|family| match noise_prior {
            Some(prior) => family.with_noise_prior(prior),
            None => Ok(family),
        });
}

/// Type of covariances that are matrices, or variances.
fn matrices(full: bool) -> CovarianceType {
    if full { CovarianceType::Full } else { CovarianceType::Diagonal }
}

fn weights_of(family: &GaussianMixture) -> Vec<Vec<f64>> {
    by_state(|state| family.weights(state).map(<[f64]>::to_vec))
}

/// Values of all states.
fn by_state(values: impl Fn(usize) -> Option<Vec<f64>>) -> Vec<Vec<f64>> {
    (0..).map_while(values).collect()
}

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
