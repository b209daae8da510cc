//! The class `LearnedMatchModel`: the result of `Matcher.learn`.

use pyo3::prelude::*;
use wayfix_roads::matching::LearnedMatchModel;

use crate::options::to_python;

/// Result of `Matcher.learn`, for `matcher.with_model(**learned.model)`.
///
/// Attributes
/// ----------
/// model : dict
///     Parameters by name.
/// iterations : int
///     Number of iterations.
/// converged : bool
///     True if the last iteration changed no parameter by more than a hundredth.
/// log_likelihood : float
///     Log-likelihood of all points under the model before the last iteration.
/// points : int
///     Number of points.
/// held_out : float
///     Gain in log-likelihood when each half of the drives is scored under the model learned from
///     the other half; below 7, `model` is the one that learning started with.
/// median_interval : float
///     Median number of seconds between two points.
/// at_limits : list of str
///     Parameters that ended at a limit of their range: inspect the drives before using the model.
#[pyclass(name = "LearnedMatchModel", module = "wayfix.matching", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct PyLearnedMatchModel {
    model: Py<PyAny>,
    iterations: usize,
    converged: bool,
    log_likelihood: f64,
    points: usize,
    held_out: f64,
    median_interval: f64,
    at_limits: Vec<String>,
}

impl PyLearnedMatchModel {
    pub(super) fn new(py: Python<'_>, learned: LearnedMatchModel) -> PyResult<Self> {
        Ok(Self {
            model: to_python(py, &learned.model)?.unbind(),
            iterations: learned.iterations,
            converged: learned.converged,
            log_likelihood: learned.log_likelihood,
            points: learned.points,
            held_out: learned.held_out,
            median_interval: learned.median_interval,
            at_limits: learned.at_limits().iter().map(ToString::to_string).collect(),
        })
    }
}

#[pymethods]
impl PyLearnedMatchModel {
    /// Pickles all attributes.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let numbers = (self.log_likelihood, self.points, self.held_out, self.median_interval);
        let ended = (self.iterations, self.converged);
        let parts = (self.model.clone_ref(py), ended, numbers, self.at_limits.clone());
        let made = py.get_type::<Self>().getattr("_from_parts")?;
        Ok((made, parts.into_pyobject(py)?.into_any()))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parts(
        model: Py<PyAny>,
        ended: (usize, bool),
        numbers: (f64, usize, f64, f64),
        at_limits: Vec<String>,
    ) -> Self {
        let ((iterations, converged), (log_likelihood, points, held_out, median_interval)) =
            (ended, numbers);
        Self {
            model,
            iterations,
            converged,
            log_likelihood,
            points,
            held_out,
            median_interval,
            at_limits,
        }
    }

    fn __repr__(&self) -> String {
        let Self { iterations, points, held_out, .. } = self;
        format!("<LearnedMatchModel: {points} points, {iterations} iterations, gain {held_out:.1}>")
    }
}
