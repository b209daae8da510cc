//! What the tests of several topics need: random models and their answers by enumeration
//! of all paths, random matrices, comparisons, and [`assert_operator`], which tries an
//! operator on everything that there is to do with one.

mod cases;
mod check_enumeration;
mod check_evidence;
mod check_routines;
mod compare;
mod damage;
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
mod stored;

pub use cases::{cases, cases_of, rng};
pub use check_enumeration::check_enumeration;
pub use check_evidence::check_evidence;
pub use check_routines::{
    check_drawn, check_entropy, check_fixed_lag, check_frequencies, check_k_best, check_pairs,
    exact, possible, ranked,
};
pub use compare::{all_close, bits, close, close_logs, log_add, log_sum, same_results};
pub use damage::{Damage, damage};
pub use draw::{
    any_distribution, any_stochastic, distribution, normalized, rate, stochastic, transposed,
    weighted,
};
pub use enumerate::Answer;
pub use errors::{says, text, with_causes};
pub use exponential::exponential;
pub use matrices::{
    Matrix, dense, dwell, kronecker, matrix, off_map, power, restart, sparse, still, switched,
    window, window_transition,
};
pub use model::{Evidence, Model, Sensor, prior, sensor};
pub use noise::noise;
pub use operator::{Expected, assert_operator};
pub use own::{Own, OwnMeasured};
pub use random_models::{Kind, dyadic_models, measured_models, models};
pub use stored::{assert_stored_operator, check_columns, json, refuses, stored};

/// The logarithm of 0.
pub const NEVER: f64 = f64::NEG_INFINITY;

/// Runs all products of an operator, into memory of its own.
pub fn all_products<'a, A: wayfix::TransitionEntries>(
    a: &'a A,
    control: &'a A::Control,
) -> impl FnMut() + 'a {
    let n = a.states();
    let (x, mut out, mut from) = (vec![1.0 / n as f64; n], vec![0.0; n], vec![0; n]);
    move || {
        a.apply(control, &x, &mut out);
        a.apply_transpose(control, &x, &mut out);
        a.apply_log(control, &x, &mut out);
        a.apply_transpose_log(control, &x, &mut out);
        a.max_product(control, &x, &mut out, &mut from);
    }
}
