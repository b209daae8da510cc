//! Standard errors from the observed information: against closed forms, independent second
//! derivatives, and the spread of estimates; parameters at bounds or undetermined; free parameters.

mod closed_forms;
mod families;
mod faults;
mod hyper_dual;
mod operators;
mod simulated;
mod visible;

use wayfix::inference::LearningOptions;
use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};

/// Options that keep the prior.
fn kept() -> LearningOptions {
    LearningOptions::default().with_keep_prior(true)
}

fn uniform(states: usize) -> Prior {
    Prior::AtFirstObservation(Belief::uniform(states).unwrap())
}

/// A sensor that shows the state itself.
fn identity(states: usize) -> TableLikelihood {
    let row = |i: usize| (0..states).map(|j| f64::from(u8::from(i == j))).collect();
    TableLikelihood::from_rows(&(0..states).map(row).collect::<Vec<Vec<f64>>>()).unwrap()
}

type Discrete = Hmm<DenseTransition, TableLikelihood>;

/// Probabilities of a model, without its prior.
fn probabilities(hmm: &Discrete) -> Vec<f64> {
    [hmm.transition().to_rows().concat(), hmm.likelihood().to_rows().concat()].concat()
}

fn near(found: f64, expected: f64, relative: f64) {
    assert!((found - expected).abs() <= relative * expected.abs(), "{found}, expected {expected}");
}
