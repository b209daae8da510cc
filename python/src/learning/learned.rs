//! Learned models, as Python sees them.

use numpy::{PyArray1, PyUntypedArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use wayfix::inference::LearnedModel;
use wayfix::{Likelihood, Prior, Transition};

use super::family::PyFamily;
use crate::model::PyHmm;

/// Model that `learn` learned.
///
/// Attributes
/// ----------
/// hmm : Hmm
///     The model. With a family, its observations are those of `family.log_likelihoods(rows)`.
/// family : Family or None
///     The family with what was learned of it.
/// objectives : array
///     The objective before learning and after each iteration: the log-likelihood, and the
///     logarithm of the priors that pseudo-counts stand for.
/// log_likelihood : float
///     Log-likelihood of all sequences that were not left out.
/// converged, stopped : bool
///     True if the last iteration gained less than the tolerance, or `progress` ended learning.
/// cause : str or None
///     Reason for an end before that.
/// left_out : list of tuple
///     Sequences that the first model rules out: their indices, and why.
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
        self.objectives.bind(py).len() - 1
    }

    /// What a pickle keeps: all attributes.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let family = self.family.as_ref().map(|family| family.clone_ref(py));
        let (hmm, objectives) = (self.hmm.clone_ref(py), self.objectives.clone_ref(py));
        let ended = (self.log_likelihood, self.converged, self.stopped, self.cause.clone());
        let parts = (hmm, family, objectives, ended, self.left_out.clone(), (self.aic, self.bic));
        let made = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((made, parts.into_pyobject(py)?.into_any()))
    }

    /// Makes what a pickle kept.
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

/// Returns the learned model with its moves as arrays.
pub(super) fn learned<A: Transition, B: Likelihood>(
    py: Python<'_>,
    found: &LearnedModel<A, B>,
    moves: Bound<'_, PyAny>,
    table: Option<Bound<'_, PyAny>>,
    family: Option<PyFamily>,
) -> PyResult<PyLearned> {
    let prior = found.model().prior();
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
