//! Log densities of all rows in all states.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use wayfix::Likelihood;
use wayfix::emission::{Gaussian, Poisson};
use wayfix::likelihood::Scratch;

use crate::array::matrix;
use crate::error::invalid;

/// Returns log densities of Gaussians without covariances, from a row of variances for each state.
#[pyfunction]
pub(crate) fn diagonal_log_densities<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    means: PyReadonlyArray2<'py, f64>,
    variances: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let d = rows.shape()[1];
    let values = matrix(&rows, d, "rows")?;
    let means: Vec<&[f64]> = matrix(&means, d, "means")?.chunks_exact(d.max(1)).collect();
    let variances = matrix(&variances, d, "variances")?.chunks_exact(d.max(1)).collect::<Vec<_>>();
    log_densities(py, &Gaussian::diagonal(&means, &variances).map_err(invalid)?, values, d)
}

/// Returns log densities of Gaussians, from a covariance matrix for each state, row by row.
#[pyfunction]
pub(crate) fn gaussian_log_densities<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    means: PyReadonlyArray2<'py, f64>,
    covariances: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let d = rows.shape()[1];
    let values = matrix(&rows, d, "rows")?;
    let means: Vec<&[f64]> = matrix(&means, d, "means")?.chunks_exact(d.max(1)).collect();
    let covariances = matrix(&covariances, d * d, "covariance matrices")?;
    let covariances: Vec<&[f64]> = covariances.chunks_exact((d * d).max(1)).collect();
    log_densities(py, &Gaussian::full(&means, &covariances).map_err(invalid)?, values, d)
}

/// Returns log-probabilities of counts under Poisson distributions.
#[pyfunction]
pub(crate) fn poisson_log_densities<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    rates: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let d = rows.shape()[1];
    let values = matrix(&rows, d, "rows")?;
    let rates: Vec<&[f64]> = matrix(&rates, d, "rates")?.chunks_exact(d.max(1)).collect();
    log_densities(py, &Poisson::family(&rates).map_err(invalid)?, values, d)
}

fn log_densities<'py, B>(
    py: Python<'py>,
    family: &B,
    values: &[f64],
    width: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>>
where
    B: Likelihood<Observation = [f64]> + Sync,
{
    let n = family.states();
    let computed = py.detach(|| {
        let (mut out, mut scratch) =
            (Vec::with_capacity(values.len() / width * n), Scratch::default());
        for (row, observation) in values.chunks_exact(width).enumerate() {
            let diagonal = family
                .diagonal(observation, &mut scratch)
                .map_err(|error| format!("row {row}: {error}"))?;
            let factor = diagonal.log_factor();
            if diagonal.is_log() {
                out.extend(diagonal.as_slice().iter().map(|log| log + factor));
            } else {
                out.extend(diagonal.as_slice().iter().map(|b| b.ln() + factor));
            }
        }
        Ok::<_, String>(out)
    });
    let out = computed.map_err(invalid)?;
    let rows = out.len() / n;
    PyArray1::from_vec(py, out).reshape([rows, n])
}
