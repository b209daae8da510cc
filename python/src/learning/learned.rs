//! The class `Learned`: the result of `learn`.

use numpy::{PyArray1, PyUntypedArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix::inference::LearnedModel;
use wayfix::{Likelihood, Prior, Transition};

use super::family::PyFamily;
use crate::model::PyHmm;

/// Result of `learn`.
///
/// Attributes
/// ----------
/// hmm : Hmm
///     The learned model. With a family, its observations are `family.log_likelihoods(rows)`.
/// family : Family or None
///     The learned family.
/// objectives : array
///     The objective before learning and after each iteration: the log-likelihood plus the
///     logarithm of the priors that the pseudo-counts stand for.
/// log_likelihood : float
///     Log-likelihood of all sequences but those left out.
/// converged : bool
///     True if the last iteration gained less than the tolerance.
/// stopped : bool
///     True if `progress` ended learning.
/// cause : str or None
///     Reason for an earlier end.
/// left_out : list of tuple
///     Sequences that the initial model rules out: index and reason of each.
/// aic, bic : float
///     Information criteria.
#[pyclass(name = "Learned", module = "wayfix.learning", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct PyLearned {
    hmm: Py<PyAny>,
    family: Option<Py<PyFamily>>,
    objectives: Py<PyArray1<f64>>,
    log_likelihood: f64,
    converged: bool,
    stopped: bool,
    cause: Option<String>,
    left_out: Vec<(usize, String)>,
    aic: f64,
    bic: f64,
}

#[pymethods]
impl PyLearned {
    /// Number of iterations.
    #[getter]
    fn iterations(&self, py: Python<'_>) -> usize {
        // The first objective is that of the given model, so there is always one.
        self.objectives.bind(py).len() - 1
    }

    /// Pickles all attributes.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let family = self.family.as_ref().map(|family| family.clone_ref(py));
        let (hmm, objectives) = (self.hmm.clone_ref(py), self.objectives.clone_ref(py));
        let ended = (self.log_likelihood, self.converged, self.stopped, self.cause.clone());
        let parts = (hmm, family, objectives, ended, self.left_out.clone(), (self.aic, self.bic));
        let made = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((made, parts.into_pyobject(py)?.into_any()))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parts(
        hmm: Py<PyAny>,
        family: Option<Py<PyFamily>>,
        objectives: Py<PyArray1<f64>>,
        ended: (f64, bool, bool, Option<String>),
        left_out: Vec<(usize, String)>,
        criteria: (f64, f64),
    ) -> Self {
        let ((log_likelihood, converged, stopped, cause), (aic, bic)) = (ended, criteria);
        Self {
            hmm,
            family,
            objectives,
            log_likelihood,
            converged,
            stopped,
            cause,
            left_out,
            aic,
            bic,
        }
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (iterations, log) = (self.iterations(py), self.log_likelihood);
        format!("<Learned: {iterations} iterations, log-likelihood {log}>")
    }
}

/// Returns the result with its model made anew from arrays, by the constructor that users call.
pub(super) fn learned<A: Transition, B: Likelihood>(
    py: Python<'_>,
    found: &LearnedModel<A, B>,
    moves: Bound<'_, PyAny>,
    table: Option<Bound<'_, PyAny>>,
    family: Option<PyFamily>,
) -> PyResult<PyLearned> {
    let prior = found.model().prior();
    // A family becomes log-likelihoods: Python's model takes these as observations.
    let named = PyDict::new(py);
    named.set_item("start_before_move", matches!(prior, Prior::BeforeFirstTransition(_)))?;
    named.set_item("logarithms", table.is_none())?;
    named.set_item("table", table)?;
    let start = prior.belief().as_slice().to_pyarray(py);
    let left_out = found.left_out().iter().map(|out| (out.sequence, out.source.to_string()));
    Ok(PyLearned {
        hmm: py.get_type::<PyHmm>().call((start, moves), Some(&named))?.unbind(),
        family: family.map(|family| Py::new(py, family)).transpose()?,
        objectives: found.objectives().to_pyarray(py).unbind(),
        log_likelihood: found.log_likelihood(),
        converged: found.converged(),
        stopped: found.stopped(),
        cause: found.cause().map(ToString::to_string),
        left_out: left_out.collect(),
        aic: found.criteria().aic(),
        bic: found.criteria().bic(),
    })
}
