//! Helpers for tests of several topics: random models and their answers by enumeration of all
//! paths, random matrices, comparisons, and [`assert_operator`], which checks everything that an
//! operator does.

mod cases;
mod compare;
mod draw;
mod enumerate;
mod errors;
mod exponential;
mod matrices;
mod model;
mod noise;
mod operator;
mod own;
mod random_models;
#[cfg(feature = "rayon")]
mod threads;

pub(crate) use cases::{cases, cases_of, rng};
pub(crate) use compare::{
    all_close, bits, close, close_logs, log_add, log_sum, same_results, visited,
};
pub(crate) use draw::{
    any_distribution, any_stochastic, distribution, normalized, rate, stochastic, transposed,
    weighted,
};
pub(crate) use enumerate::Answer;
pub(crate) use errors::{says, text, with_causes};
pub(crate) use exponential::exponential;
pub(crate) use matrices::{
    Matrix, dense, dwell, kronecker, matrix, off_map, power, restart, sparse, still, switched,
    window,
};
pub(crate) use model::{Evidence, Model, Sensor, prior, sensor};
pub(crate) use noise::noise;
pub(crate) use operator::{Expected, assert_operator};
pub(crate) use own::{Own, OwnMeasured};
pub(crate) use random_models::{Kind, dyadic_models, measured_models, models};
#[cfg(feature = "rayon")]
pub(crate) use threads::with_threads;

/// The logarithm of 0.
pub(crate) const NEVER: f64 = f64::NEG_INFINITY;
