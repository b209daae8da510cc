//! Log densities of all rows in all states.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use wayfix::Likelihood;
use wayfix::emission::{Gaussian, Poisson};
use wayfix::likelihood::Scratch;

use crate::array::{contiguous, matrix};
use crate::error::invalid;

/// Returns log densities of Gaussians: `covariances` has one row for each state, with one
/// variance, one for each column, or a matrix row by row.
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
    let width = covariances.shape()[1];
    let covariances = contiguous(covariances.as_slice(), "covariances")?;
    let parts: Vec<&[f64]> = covariances.chunks_exact(width.max(1)).collect();
    let family = if width == d {
        Gaussian::diagonal(&means, &parts)
    } else if width == 1 {
        Gaussian::spherical(&means, covariances)
    } else {
        Gaussian::full(&means, &parts)
    };
    log_densities(py, &family.map_err(invalid)?, values, d)
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
