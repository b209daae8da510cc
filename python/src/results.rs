//! Results, as Python sees them.

use numpy::{PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;

/// Probabilities of all states at each step.
///
/// Attributes
/// ----------
/// probabilities : array, shape (steps, n)
///     A row for each observation; rows sum to one.
/// log_likelihood : float
///     Log-likelihood of the observations.
#[pyclass(name = "Smoothed", module = "wayfix", frozen)]
#[derive(Debug)]
pub(crate) struct PySmoothed {
    #[pyo3(get)]
    probabilities: Py<PyArray2<f64>>,
    #[pyo3(get)]
    log_likelihood: f64,
}

impl PySmoothed {
    /// Creates the result from rows of all steps from 0 on, of which the first is left out.
    pub(crate) fn new(
        py: Python<'_>,
        mut rows: Vec<f64>,
        states: usize,
        log_likelihood: f64,
    ) -> PyResult<Self> {
        rows.drain(..states);
        let steps = rows.len() / states;
        let probabilities = PyArray1::from_vec(py, rows).reshape([steps, states])?.unbind();
        Ok(Self { probabilities, log_likelihood })
    }
}

#[pymethods]
impl PySmoothed {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let shape: (usize, usize) = self.probabilities.bind(py).getattr("shape")?.extract()?;
        let (steps, states) = shape;
        Ok(format!(
            "<Smoothed: {steps} steps, {states} states, log-likelihood {}>",
            self.log_likelihood
        ))
    }
}

/// A path.
///
/// Attributes
/// ----------
/// states : array of int, shape (steps,)
///     The state of each observation.
/// log_probability : float
///     Logarithm of the probability of path and observations together.
#[pyclass(name = "Path", module = "wayfix", frozen)]
#[derive(Debug)]
pub(crate) struct PyPath {
    #[pyo3(get)]
    states: Py<PyArray1<i64>>,
    #[pyo3(get)]
    log_probability: f64,
}

impl PyPath {
    pub(crate) fn new(py: Python<'_>, states: &[usize], log_probability: f64) -> Self {
        let states: Vec<i64> =
            states.iter().map(|s| i64::try_from(*s).unwrap_or(i64::MAX)).collect();
        Self { states: states.to_pyarray(py).unbind(), log_probability }
    }
}

#[pymethods]
impl PyPath {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let steps = self.states.bind(py).len()?;
        Ok(format!("<Path: {steps} steps, log-probability {}>", self.log_probability))
    }
}
