//! The class `Family`: a family of observations of any kind, with its parameters as a dictionary.

use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use wayfix::Likelihood;

use super::kinds::AnyFamily;
use super::matrices::{pack, unpack};
use crate::array;
use crate::densities::log_densities;
use crate::options::{from_python, to_python};

/// Family of observations for `learn`, with parameters for each state.
///
/// Parameters
/// ----------
/// kind : str
///     "bernoulli", "beta", "binomial", "exponential", "gamma", "gaussian", "gaussian_mixture",
///     "linear_regression", "log_normal", "multinomial", "negative_binomial", "poisson",
///     "student_t", "von_mises", "von_mises_fisher", "weibull" or "wrapped_cauchy"; or
///     "zero_inflated_" before "binomial", "gamma", "log_normal", "negative_binomial", "poisson" or
///     "weibull"; or "hurdle_" before "binomial", "negative_binomial" or "poisson".
///     The last two take `probabilities` and, in a dictionary `inner`, the parameters of the family
///     whose name follows.
/// **parameters
///     Parameters by name, as below. `missing=True` takes NaN for a missing number.
///
/// Notes
/// -----
/// Parameters for n states and rows of d numbers. Their shape is (n, d) unless another is given.
///
/// =================== ============================================================================
/// kind                parameters
/// =================== ============================================================================
/// bernoulli           probabilities
/// beta                alphas, betas
/// binomial            trials, probabilities
/// exponential         rates
/// gamma               shapes, scales
/// gaussian            covariance_type, means, covariances (see below)
/// gaussian_mixture    covariance_type, weights (n, m), means (n, m, d), covariances (see below)
/// linear_regression   coefficients (n, d q), the q of the first number first; the q inputs precede
///                     the d numbers in a row; intercepts; covariances: variances, or (n, d, d)
///                     with full=True
/// log_normal          means, deviations, of the logarithms
/// multinomial         probabilities; trials, a number (1)
/// negative_binomial   means, dispersions
/// poisson             rates
/// student_t           scale_type, degrees (n,), means, scales (as covariances, see below)
/// von_mises           means, concentrations
/// von_mises_fisher    means, concentrations (n,)
/// weibull             shapes, scales
/// wrapped_cauchy      means, concentrations
/// zero_inflated_…     probabilities of an extra 0; inner, a dictionary
/// hurdle_…            probabilities of 0; inner, a dictionary
/// =================== ============================================================================
///
/// Covariances have these shapes by type; those of a mixture of m parts are in the last column:
///
/// =================== ================= ==================
/// covariance_type
/// =================== ================= ==================
/// "spherical"         (n,)              (n, m)
/// "diagonal", "diag"  (n, d)            (n, m, d)
/// "full"              (n, d, d)         (n, m, d, d)
/// "tied"              (d, d)            (n, d, d)
/// =================== ================= ==================
///
/// Examples
/// --------
/// >>> from wayfix.learning import Family
/// >>> family = Family("poisson", rates=[[2.0], [9.0]])
/// >>> family.log_likelihoods([[3.0], [8.0]]).round(3)
/// array([[-1.712, -4.2  ],
///        [-7.059, -2.027]])
/// >>> family.parameters["rates"]
/// [[2.0], [9.0]]
#[pyclass(name = "Family", module = "wayfix.learning", frozen)]
#[derive(Debug)]
pub(crate) struct PyFamily(pub(super) AnyFamily);

#[pymethods]
impl PyFamily {
    #[new]
    #[pyo3(signature = (kind, /, **parameters))]
    fn new(kind: &str, parameters: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut given = parameters.map_or(Ok(Value::Null), from_python)?;
        pack(kind, &mut given)?;
        AnyFamily::from_parameters(kind, given).map(Self)
    }

    /// Name of the family.
    #[getter]
    fn kind(&self) -> &'static str {
        self.0.kind()
    }

    /// All parameters: a dictionary.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mut stored = self.0.parameters()?;
        unpack(self.kind(), &mut stored)?;
        to_python(py, &stored)
    }

    /// Number of states.
    #[getter]
    fn states(&self) -> usize {
        self.0.states()
    }

    /// Returns the log-likelihoods of rows in all states: observations for an `Hmm` with
    /// `logarithms=True`.
    fn log_likelihoods<'py>(
        &self,
        py: Python<'py>,
        rows: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = array::rows(rows, "observations")?;
        log_densities(py, &self.0, &rows, self.0.components())
    }

    /// Pickles the parameters.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (&'static str, Bound<'py, PyAny>))> {
        // Not the constructor: it takes the parameters by keyword, which `__reduce__` cannot pass.
        let made = py.get_type::<Self>().getattr("_from_parameters")?;
        Ok((made, (self.kind(), self.parameters(py)?)))
    }

    /// Restores a pickle.
    #[staticmethod]
    fn _from_parameters(kind: &str, parameters: &Bound<'_, PyDict>) -> PyResult<Self> {
        Self::new(kind, Some(parameters))
    }

    fn __repr__(&self) -> String {
        format!("<Family: {}, {} states>", self.kind(), self.states())
    }
}
