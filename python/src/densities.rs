//! Log densities of all rows in all states, by the library's families, for `wayfix.hmmlearn` and
//! `Family.log_likelihoods`.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use wayfix::Likelihood;
use wayfix::likelihood::Scratch;
use wayfix_learn::{Gaussian, Poisson};

use crate::array::matrix;
use crate::error::{invalid, of_step};

/// Returns log densities of Gaussians with diagonal covariances, from a row of variances for each
/// state.
#[pyfunction]
pub(crate) fn diagonal_log_densities<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    means: PyReadonlyArray2<'py, f64>,
    variances: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let d = rows.shape()[1];
    let (means, variances) = (states(&means, d, "means")?, states(&variances, d, "variances")?);
    log_densities(py, &Gaussian::diagonal(&means, &variances).map_err(invalid)?, &rows, d)
}

/// Returns log densities of Gaussians, from a covariance matrix for each state, flattened by rows.
#[pyfunction]
pub(crate) fn gaussian_log_densities<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    means: PyReadonlyArray2<'py, f64>,
    covariances: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let d = rows.shape()[1];
    let means = states(&means, d, "means")?;
    let covariances = states(&covariances, d * d, "covariance matrices")?;
    log_densities(py, &Gaussian::full(&means, &covariances).map_err(invalid)?, &rows, d)
}

/// Returns log-probabilities of counts under Poisson distributions.
#[pyfunction]
pub(crate) fn poisson_log_densities<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    rates: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let d = rows.shape()[1];
    let rates = states(&rates, d, "rates")?;
    log_densities(py, &Poisson::family(&rates).map_err(invalid)?, &rows, d)
}

/// Returns the parameters of each state, a row of the array.
fn states<'a>(
    array: &'a PyReadonlyArray2<'_, f64>,
    width: usize,
    what: &str,
) -> PyResult<Vec<&'a [f64]>> {
    Ok(matrix(array, width, what)?.chunks_exact(width.max(1)).collect())
}

/// Returns log densities of rows of `width` numbers under any family.
pub(crate) fn log_densities<'py, B>(
    py: Python<'py>,
    family: &B,
    rows: &PyReadonlyArray2<'py, f64>,
    width: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>>
where
    B: Likelihood<Observation = [f64]> + Sync,
{
    let (count, n) = (rows.shape()[0], family.states());
    let values = matrix(rows, width, "observations")?;
    // Errors are kept as text, since exceptions need the global lock.
    let computed = py.detach(|| {
        let (mut out, mut scratch) = (Vec::with_capacity(count * n), Scratch::default());
        for (row, observation) in values.chunks_exact(width.max(1)).enumerate() {
            let diagonal = family
                .diagonal(observation, &mut scratch)
                .map_err(|error| (row + 1, format!("step {}: {error}", row + 1)))?;
            // b is known up to a factor that the family took out; here it is put back. A b of 0
            // becomes minus infinity.
            let factor = diagonal.log_factor();
            let log = |b: &f64| if diagonal.is_log() { b + factor } else { b.ln() + factor };
            out.extend(diagonal.as_slice().iter().map(log));
        }
        Ok::<_, (usize, String)>(out)
    });
    let out = computed.map_err(|(step, message)| of_step(py, 0, step, message))?;
    PyArray1::from_vec(py, out).reshape([count, n])
}
