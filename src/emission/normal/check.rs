//! Checks of parameters.

use super::super::EmissionError;
use super::{CovarianceType, Shape};

/// Difference of two entries that are taken for one, relative to the diagonal.
pub(super) const SYMMETRY: f64 = 1e-9;

/// Checks parameters, one row for each state, and returns them one after the other.
pub(in super::super) fn flatten<R: AsRef<[f64]>>(
    what: &'static str,
    rows: &[R],
    expected: usize,
) -> Result<Vec<f64>, EmissionError> {
    let mut all = Vec::with_capacity(rows.len() * expected);
    for (state, row) in rows.iter().enumerate() {
        let (row, state) = (row.as_ref(), Some(state));
        let found = row.len();
        if found != expected {
            return Err(EmissionError::Length { what, state, found, expected });
        }
        if let Some(component) = row.iter().position(|value| !value.is_finite()) {
            let (value, expected) = (row[component], "a finite value");
            let component = Some(component);
            return Err(EmissionError::Parameter { what, state, component, value, expected });
        }
        all.extend_from_slice(row);
    }
    Ok(all)
}

/// Checks covariances in their stored form, one for each density, or one if they are tied.
pub(in super::super) fn check_covariances(
    kind: CovarianceType,
    d: usize,
    covariances: &[f64],
) -> Result<(), EmissionError> {
    let what = kind.name();
    for (at, covariance) in covariances.chunks_exact(kind.values(d)).enumerate() {
        let state = (kind != CovarianceType::Tied).then_some(at);
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
