//! Families of observations, by their names and the parameters that the library stores.

use std::error::Error;

use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use wayfix::Likelihood;
use wayfix::emission::{
    Bernoulli, Beta, Binomial, Exponential, Family, Gamma, Gaussian, GaussianMixture, Hurdle,
    Independent, LinearRegression, LogNormal, Multinomial, NegativeBinomial, Poisson, SkewedT,
    StudentT, VonMises, VonMisesFisher, Weibull, WrappedCauchy, ZeroInflated,
};
use wayfix::error::LikelihoodError;
use wayfix::likelihood::{Diagonal, LearnLikelihood, Scratch};

use crate::array;
use crate::densities::log_densities;
use crate::error::invalid;
use crate::options::{from_python, merge, to_python};

/// Fields that may be left out, of families of single numbers.
const USUAL: &str = r#"{"missing": false, "prior": null}"#;
/// The same, where the others are those of a family of single numbers.
const BESIDE_ZEROS: &str =
    r#"{"missing": false, "prior": null, "inner": {"missing": false, "prior": null}}"#;
const GAUSSIAN: &str =
    r#"{"missing": false, "prior": null, "fixed_means": false, "fixed_covariances": false}"#;
const STUDENT: &str = r#"{"missing": false, "prior": null, "fixed_means": false,
    "fixed_covariances": false, "fixed_degrees": false}"#;
const REGRESSION: &str = r#"{"missing": false, "ridge": 0, "noise_prior": null, "full": false}"#;
const MULTINOMIAL: &str = r#"{"missing": false, "trials": 1}"#;

/// One type for all families, so that learning is compiled once for each kind of moves.
macro_rules! families {
    ($($name:ident, $word:literal, $type:ty, $defaults:expr;)*) => {
        #[derive(Debug, Clone)]
        pub(crate) enum AnyFamily {
            $($name(Box<$type>),)*
        }

        pub(crate) enum Statistics {
            $($name(<$type as LearnLikelihood>::Statistics),)*
        }

        const KINDS: &[&str] = &[$($word),*];

        impl AnyFamily {
            fn from_parameters(kind: &str, given: Value) -> PyResult<Self> {
                match kind {
                    $($word => read(given, $defaults).map(|family| Self::$name(Box::new(family))),)*
                    _ => Err(invalid(format!(
                        "the kind of a family is {kind:?}, expected {}", KINDS.join(", ")
                    ))),
                }
            }

            fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                match self {
                    $(Self::$name(family) => to_python(py, family.as_ref()),)*
                }
            }

            fn kind(&self) -> &'static str {
                match self {
                    $(Self::$name(_) => $word,)*
                }
            }

            fn components(&self) -> usize {
                match self {
                    $(Self::$name(family) => family.components(),)*
                }
            }
        }

        impl Likelihood for AnyFamily {
            type Observation = [f64];

            fn states(&self) -> usize {
                match self {
                    $(Self::$name(family) => family.states(),)*
                }
            }

            fn diagonal<'a>(
                &'a self,
                observation: &'a [f64],
                scratch: &'a mut Scratch,
            ) -> Result<Diagonal<'a>, LikelihoodError> {
                match self {
                    $(Self::$name(family) => family.diagonal(observation, scratch),)*
                }
            }
        }

        impl LearnLikelihood for AnyFamily {
            type Statistics = Statistics;

            fn statistics(&self) -> Statistics {
                match self {
                    $(Self::$name(family) => Statistics::$name(family.statistics()),)*
                }
            }

            fn add(&self, statistics: &mut Statistics, observation: &[f64], posterior: &[f64]) {
                match (self, statistics) {
                    $((Self::$name(family), Statistics::$name(sum)) => {
                        family.add(sum, observation, posterior);
                    })*
                    // Statistics are those that this family made.
                    _ => {}
                }
            }

            fn merge(&self, statistics: &mut Statistics, other: &Statistics) {
                match (self, statistics, other) {
                    $((Self::$name(family), Statistics::$name(sum), Statistics::$name(more)) => {
                        family.merge(sum, more);
                    })*
                    _ => {}
                }
            }

            fn maximize(
                &self,
                statistics: &Statistics,
                pseudo_count: f64,
            ) -> Result<Self, Box<dyn Error + Send + Sync>> {
                match (self, statistics) {
                    $((Self::$name(family), Statistics::$name(sum)) => {
                        Ok(Self::$name(Box::new(family.maximize(sum, pseudo_count)?)))
                    })*
                    _ => Err("statistics of another family".into()),
                }
            }

            fn log_prior(&self, pseudo_count: f64) -> f64 {
                match self {
                    $(Self::$name(family) => family.log_prior(pseudo_count),)*
                }
            }

            fn free_parameters(&self) -> usize {
                match self {
                    $(Self::$name(family) => family.free_parameters(),)*
                }
            }
        }
    };
}

families! {
    Bernoulli, "bernoulli", Independent<Bernoulli>, USUAL;
    Beta, "beta", Independent<Beta>, USUAL;
    Binomial, "binomial", Independent<Binomial>, USUAL;
    Exponential, "exponential", Independent<Exponential>, USUAL;
    Gamma, "gamma", Independent<Gamma>, USUAL;
    Gaussian, "gaussian", Gaussian, GAUSSIAN;
    GaussianMixture, "gaussian_mixture", GaussianMixture, GAUSSIAN;
    HurdleBinomial, "hurdle_binomial", Independent<Hurdle<Binomial>>, BESIDE_ZEROS;
    HurdleNegativeBinomial, "hurdle_negative_binomial", Independent<Hurdle<NegativeBinomial>>,
        BESIDE_ZEROS;
    HurdlePoisson, "hurdle_poisson", Independent<Hurdle<Poisson>>, BESIDE_ZEROS;
    LinearRegression, "linear_regression", LinearRegression, REGRESSION;
    LogNormal, "log_normal", Independent<LogNormal>, USUAL;
    Multinomial, "multinomial", Multinomial, MULTINOMIAL;
    NegativeBinomial, "negative_binomial", Independent<NegativeBinomial>, USUAL;
    Poisson, "poisson", Independent<Poisson>, USUAL;
    SkewedT, "skewed_t", Independent<SkewedT>, USUAL;
    StudentT, "student_t", StudentT, STUDENT;
    VonMises, "von_mises", Independent<VonMises>, USUAL;
    VonMisesFisher, "von_mises_fisher", VonMisesFisher, USUAL;
    Weibull, "weibull", Independent<Weibull>, USUAL;
    WrappedCauchy, "wrapped_cauchy", Independent<WrappedCauchy>, USUAL;
    ZeroInflatedBinomial, "zero_inflated_binomial", Independent<ZeroInflated<Binomial>>,
        BESIDE_ZEROS;
    ZeroInflatedGamma, "zero_inflated_gamma", Independent<ZeroInflated<Gamma>>, BESIDE_ZEROS;
    ZeroInflatedLogNormal, "zero_inflated_log_normal", Independent<ZeroInflated<LogNormal>>,
        BESIDE_ZEROS;
    ZeroInflatedNegativeBinomial, "zero_inflated_negative_binomial",
        Independent<ZeroInflated<NegativeBinomial>>, BESIDE_ZEROS;
    ZeroInflatedPoisson, "zero_inflated_poisson", Independent<ZeroInflated<Poisson>>, BESIDE_ZEROS;
    ZeroInflatedWeibull, "zero_inflated_weibull", Independent<ZeroInflated<Weibull>>, BESIDE_ZEROS;
}

/// Reads a family from its fields.
fn read<F: serde::de::DeserializeOwned>(given: Value, defaults: &str) -> PyResult<F> {
    let failed = |error: serde_json::Error| invalid(format!("parameters of a family: {error}"));
    let mut all: Value = serde_json::from_str(defaults).map_err(failed)?;
    if given.is_object() {
        merge(&mut all, given);
    }
    number(&mut all);
    serde_json::from_value(all).map_err(failed)
}

/// Gives each part the number of the present format.
fn number(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            fields.values_mut().for_each(number);
            fields.entry("version").or_insert(Value::from(1));
        }
        Value::Array(values) => values.iter_mut().for_each(number),
        _ => {}
    }
}

/// Family of observations, with parameters for each state, for `learn`.
///
/// Parameters
/// ----------
/// kind : str
///     "bernoulli", "beta", "binomial", "exponential", "gamma", "gaussian", "gaussian_mixture",
///     "linear_regression", "log_normal", "multinomial", "negative_binomial", "poisson",
///     "skewed_t", "student_t", "von_mises", "von_mises_fisher", "weibull" or "wrapped_cauchy";
///     "zero_inflated_" before "binomial", "gamma", "log_normal", "negative_binomial", "poisson" or
///     "weibull", and "hurdle_" before one of those that count, with `probabilities` of 0 and the
///     parameters of the others in a dictionary, `inner`.
/// **parameters
///     The library's parameters by name, with a row for each state: `rates` of a Poisson family,
///     `shapes` and `scales` of a gamma, `covariance_type` ("spherical", "diagonal", "full" or
///     "tied"), `means` and `covariances` of a Gaussian, and so on; an error names those that are
///     missing. `missing=True` takes NaN for a missing number.
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
        let given = parameters.map_or(Ok(Value::Null), from_python)?;
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
        self.0.parameters(py)
    }

    /// Number of states.
    #[getter]
    fn states(&self) -> usize {
        self.0.states()
    }

    /// Returns the log-likelihoods of rows in all states, which are observations of an `Hmm` with
    /// `logarithms=True`.
    fn log_likelihoods<'py>(
        &self,
        py: Python<'py>,
        rows: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = array::rows(rows, "observations")?;
        log_densities(py, &self.0, &rows, self.0.components())
    }

    /// What a pickle keeps: the parameters.
    #[expect(clippy::type_complexity, reason = "what Python expects")]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (&'static str, Bound<'py, PyAny>))> {
        let made = py.get_type::<Self>().getattr("_from_parameters")?;
        Ok((made, (self.kind(), self.parameters(py)?)))
    }

    /// Makes what a pickle kept.
    #[staticmethod]
    fn _from_parameters(kind: &str, parameters: &Bound<'_, PyDict>) -> PyResult<Self> {
        Self::new(kind, Some(parameters))
    }

    fn __repr__(&self) -> String {
        format!("<Family: {}, {} states>", self.kind(), self.states())
    }
}
