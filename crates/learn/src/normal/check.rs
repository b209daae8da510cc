//! Checks of covariances: finite, symmetric and, if diagonal, positive. Definiteness is left to the
//! Cholesky factor.

use super::form::{CovarianceType, Shape};
use super::prior::SYMMETRY;
use crate::EmissionError;
use crate::check::flatten;

/// Checks covariances as users give them, and returns them one after the other.
pub(crate) fn flatten_covariances<V: AsRef<[f64]>>(
    kind: CovarianceType,
    covariances: &[V],
    d: usize,
) -> Result<Vec<f64>, EmissionError> {
    let flat = flatten("covariance", covariances, kind.values(d))?;
    check_covariances(kind, d, &flat)?;
    Ok(flat)
}

/// Checks covariances in their stored form: one for each density, or one for all that share it.
pub(super) fn check_covariances(
    kind: CovarianceType,
    d: usize,
    covariances: &[f64],
) -> Result<(), EmissionError> {
    let what = kind.name();
    for (at, covariance) in covariances.chunks_exact(kind.values(d)).enumerate() {
        // A covariance tied across all states belongs to none; one tied across the parts of a
        // mixture has its state's number.
        let single = covariances.len() == kind.values(d);
        let state = (kind != CovarianceType::Tied || !single).then_some(at);
        let wrong = |component: usize, value, expected| {
            let component = (kind != CovarianceType::Spherical).then_some(component);
            Err(EmissionError::Parameter { what, state, component, value, expected })
        };
        for (position, &value) in covariance.iter().enumerate() {
            if kind.shape() == Shape::Diagonal {
                if !(value >= f64::MIN_POSITIVE && value.is_finite()) {
                    return wrong(position, value, "a finite value above 2.2e-308");
                }
                continue;
            }
            // Relative to √(Σ_ii Σ_jj), the largest that |Σ_ij| can be.
            let (i, j) = (position / d, position % d);
            let (other, scale) = (covariance[j * d + i], covariance[i * d + i].abs().sqrt());
            if !value.is_finite() {
                return wrong(i, value, "a finite value");
            }
            if (value - other).abs() > SYMMETRY * scale * covariance[j * d + j].abs().sqrt() {
                return wrong(i, value, "a symmetric matrix");
            }
        }
    }
    Ok(())
}
