//! Formats of Gaussian families.

use super::stored;
use crate::emission::{CovarianceType, EmissionError, Gaussian, GaussianMixture, GaussianPrior};

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
        .map(|new| when(missing, new, Self::with_missing))
        .map(|new| when(fixed_means, new, Self::with_fixed_means))
        .map(|new| when(fixed_covariances, new, Self::with_fixed_covariances))
        .and_then(|new| prior.into_iter().try_fold(new, Self::with_prior));

    [] GaussianMixture in emission: [], |family| {
        covariance_type: CovarianceType = family.covariance_type(),
        weights: Vec<Vec<f64>> = weights_of(family),
        means: Vec<Vec<Vec<f64>>> = family.means(),
        covariances: Vec<Vec<Vec<f64>>> = family.covariances(),
        missing: bool = family.takes_missing(),
        fixed_means: bool = family.has_fixed_means(),
        fixed_covariances: bool = family.has_fixed_covariances(),
        prior: Option<GaussianPrior> = family.prior(),
    } => Self::new(covariance_type, &weights, &means, &covariances)
        .map(|new| when(missing, new, Self::with_missing))
        .map(|new| when(fixed_means, new, Self::with_fixed_means))
        .map(|new| when(fixed_covariances, new, Self::with_fixed_covariances))
        .and_then(|new| prior.into_iter().try_fold(new, Self::with_prior));

    [] StudentT in emission: [], |family| {
        scale_type: CovarianceType = family.gaussian().covariance_type(),
        degrees: Vec<f64> = family.degrees(),
        means: Vec<Vec<f64>> = family.gaussian().means(),
        scales: Vec<Vec<f64>> = family.gaussian().covariances(),
        fixed_degrees: bool = family.has_fixed_degrees(),
        missing: bool = family.gaussian().takes_missing(),
        fixed_means: bool = family.gaussian().has_fixed_means(),
        fixed_covariances: bool = family.gaussian().has_fixed_covariances(),
        prior: Option<GaussianPrior> = family.gaussian().prior(),
    } => Gaussian::new(scale_type, &means, &scales)
        .map(|new| when(missing, new, Gaussian::with_missing))
        .map(|new| when(fixed_means, new, Gaussian::with_fixed_means))
        .map(|new| when(fixed_covariances, new, Gaussian::with_fixed_covariances))
        .and_then(|new| prior.into_iter().try_fold(new, Gaussian::with_prior))
        .and_then(|gaussian| Self::new(&degrees, gaussian))
        .map(|new| when(fixed_degrees, new, Self::with_fixed_degrees));

    [] LinearRegression in emission: [], |family| {
        full: bool = (family.noise().covariance_type() == CovarianceType::Full),
        coefficients: Vec<Vec<f64>> = by_state(|state| family.coefficients(state)),
        intercepts: Vec<Vec<f64>> = by_state(|state| family.intercept(state)),
        covariances: Vec<Vec<f64>> = family.noise().covariances(),
        missing: bool = family.noise().takes_missing(),
        ridge: f64 = family.ridge(),
        noise_prior: Option<GaussianPrior> = family.noise().prior(),
    } => Self::new(matrices(full), &coefficients, &intercepts, &covariances)
        .and_then(|new| new.with_ridge(ridge))
        .map(|new| when(missing, new, Self::with_missing))
        .and_then(|new| noise_prior.into_iter().try_fold(new, Self::with_noise_prior));
}

/// Changes a family, if it was changed before.
pub(super) fn when<F>(changed: bool, family: F, change: fn(F) -> F) -> F {
    if changed { change(family) } else { family }
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
