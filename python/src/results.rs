//! The results `Smoothed` and `Path`: arrays that take over the memory of the library's results.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyType;
use wayfix::inference::{FilteredSequence, SmoothedSequence, ViterbiPath};

use crate::array;

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
    /// Creates the result from the rows of steps 0 to T. Step 0, before the first observation, is
    /// left out.
    fn over(
        py: Python<'_>,
        mut rows: Vec<f64>,
        states: usize,
        log_likelihood: f64,
    ) -> PyResult<Self> {
        // Moves the rest to the front in place; a second vector might not fit into memory.
        rows.drain(..states);
        let steps = rows.len() / states;
        let probabilities = PyArray1::from_vec(py, rows).reshape([steps, states])?.unbind();
        Ok(Self { probabilities, log_likelihood })
    }

    pub(crate) fn smoothed(py: Python<'_>, result: SmoothedSequence) -> PyResult<Self> {
        let (states, log_likelihood) = (result.posteriors().states(), result.log_likelihood());
        Self::over(py, result.into_posteriors().into_vec(), states, log_likelihood)
    }

    pub(crate) fn filtered(py: Python<'_>, result: FilteredSequence) -> PyResult<Self> {
        let (states, log_likelihood) = (result.posteriors().states(), result.log_likelihood());
        Self::over(py, result.into_posteriors().into_vec(), states, log_likelihood)
    }
}

#[pymethods]
impl PySmoothed {
    #[new]
    fn new(probabilities: &Bound<'_, PyAny>, log_likelihood: f64) -> PyResult<Self> {
        // `clone` adds a reference: the array that a pickle holds is kept, not copied.
        let probabilities = (*array::rows(probabilities, "probabilities")?).clone().unbind();
        Ok(Self { probabilities, log_likelihood })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, (Py<PyArray2<f64>>, f64)) {
        (py.get_type::<Self>(), (self.probabilities.clone_ref(py), self.log_likelihood))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let shape: (usize, usize) = self.probabilities.bind(py).getattr("shape")?.extract()?;
        let (steps, states) = shape;
        Ok(format!(
            "<Smoothed: {steps} steps, {states} states, log-likelihood {}>",
            self.log_likelihood
        ))
    }
}

/// Path through the states.
///
/// Attributes
/// ----------
/// states : array of int, shape (steps,)
///     The state of each observation.
/// log_probability : float
///     Logarithm of the joint probability of the path and the observations.
#[pyclass(name = "Path", module = "wayfix", frozen)]
#[derive(Debug)]
pub(crate) struct PyPath {
    #[pyo3(get)]
    states: Py<PyArray1<i64>>,
    #[pyo3(get)]
    log_probability: f64,
}

/// Returns the states of a path in numpy's type of indices. An iterator of a vector collected into
/// one whose elements have the same size reuses its memory.
pub(crate) fn states_of(path: ViterbiPath) -> Vec<i64> {
    // The library's operators and decoders store states in 32 bits.
    let signed = |state| i64::try_from(state).expect("a state has an index of 32 bits");
    path.into_states().into_iter().map(signed).collect()
}

impl PyPath {
    pub(crate) fn of(py: Python<'_>, path: ViterbiPath) -> Self {
        let log_probability = path.log_probability();
        Self { states: PyArray1::from_vec(py, states_of(path)).unbind(), log_probability }
    }
}

#[pymethods]
impl PyPath {
    #[new]
    fn new(states: &Bound<'_, PyAny>, log_probability: f64) -> PyResult<Self> {
        let states = (*array::integers(states, "states")?).clone().unbind();
        Ok(Self { states, log_probability })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, (Py<PyArray1<i64>>, f64)) {
        (py.get_type::<Self>(), (self.states.clone_ref(py), self.log_probability))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let steps = self.states.bind(py).len()?;
        Ok(format!("<Path: {steps} steps, log-probability {}>", self.log_probability))
    }
}
