//! Families of all kinds as one type, read from a name and parameters in the library's stored form.
//!
//! The stored form has fields that a user should not have to know (a version, priors, flags). They
//! are filled in from [`USUAL`] and the like before the library's own checks read all of them.

use std::error::Error;

use pyo3::prelude::*;
use serde_json::Value;
use wayfix::Likelihood;
use wayfix::error::LikelihoodError;
use wayfix::likelihood::{Diagonal, LearnLikelihood, Scratch};
use wayfix_learn::{
    Bernoulli, Beta, Binomial, Exponential, Family, Gamma, Gaussian, GaussianMixture, Hurdle,
    Independent, LinearRegression, LogNormal, Multinomial, NegativeBinomial, Poisson, StudentT,
    VonMises, VonMisesFisher, Weibull, WrappedCauchy, ZeroInflated,
};

use crate::error::invalid;
use crate::options::merge;

/// Fields that may be left out, in families of single numbers.
const USUAL: &str = r#"{"missing": false, "prior": null}"#;
/// Fields that may be left out, in families with more zeros around a family of single numbers.
const BESIDE_ZEROS: &str =
    r#"{"missing": false, "prior": null, "inner": {"missing": false, "prior": null}}"#;
const GAUSSIAN: &str =
    r#"{"missing": false, "prior": null, "fixed_means": false, "fixed_covariances": false}"#;
const STUDENT: &str = r#"{"missing": false, "prior": null, "fixed_means": false,
    "fixed_covariances": false, "fixed_degrees": false}"#;
const REGRESSION: &str = r#"{"missing": false, "ridge": 0, "noise_prior": null, "full": false}"#;
const MULTINOMIAL: &str = r#"{"missing": false, "trials": 1}"#;

/// Defines one type for all families, so that learning is compiled once for each kind of moves
/// rather than for each family. Its cost is one match for each observation.
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
            pub(super) fn from_parameters(kind: &str, given: Value) -> PyResult<Self> {
                match kind {
                    $($word => read(given, $defaults).map(|family| Self::$name(Box::new(family))),)*
                    _ => Err(invalid(format!(
                        "the kind of a family is {kind:?}, expected {}", KINDS.join(", ")
                    ))),
                }
            }

            pub(super) fn parameters(&self) -> PyResult<Value> {
                match self {
                    $(Self::$name(family) => serde_json::to_value(family.as_ref()).map_err(invalid),)*
                }
            }

            pub(super) fn kind(&self) -> &'static str {
                match self {
                    $(Self::$name(_) => $word,)*
                }
            }

            pub(super) fn components(&self) -> usize {
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
                    // Not reached: `statistics` made the sums, and a model keeps its kind of
                    // family.
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

/// Reads a family from its fields, over the defaults.
fn read<F: serde::de::DeserializeOwned>(given: Value, defaults: &str) -> PyResult<F> {
    let failed = |error: serde_json::Error| invalid(format!("parameters of a family: {error}"));
    let mut all: Value = serde_json::from_str(defaults).map_err(failed)?;
    // Without parameters `given` is null; the error is then that of the first missing field.
    if given.is_object() {
        merge(&mut all, given);
    }
    number(&mut all);
    serde_json::from_value(all).map_err(failed)
}

/// Gives each object, at any depth, the version of the present format.
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
