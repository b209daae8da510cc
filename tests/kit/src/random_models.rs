//! Random small models.

use proptest::collection::vec;
use proptest::prelude::*;

use super::{Evidence, Model, NEVER, transposed, weighted};

/// Range of the numbers of a random model.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    /// Zeros among ordinary weights.
    Plain,
    /// The same, with log-likelihoods shifted by −400, −1e5 or 700 at some
    /// steps.
    Shifted,
    /// Also weights of 1e-300, and log-likelihoods hundreds apart.
    Extreme,
}

fn weight(kind: Kind) -> BoxedStrategy<f64> {
    match kind {
        Kind::Plain | Kind::Shifted => prop_oneof![2 => Just(0.0), 5 => 0.01..1.0].boxed(),
        Kind::Extreme => prop_oneof![
            2 => Just(0.0), 4 => 0.01..1.0, 2 => Just(1e-300), 1 => Just(1e-150)
        ]
        .boxed(),
    }
}

fn log_likelihood(kind: Kind) -> BoxedStrategy<f64> {
    let ordinary = prop_oneof![1 => Just(NEVER), 5 => (0.001..1.0).prop_map(f64::ln)];
    match kind {
        Kind::Plain | Kind::Shifted => ordinary.boxed(),
        Kind::Extreme => prop_oneof![4 => ordinary, 1 => -2000.0..2000.0].boxed(),
    }
}

/// Random models of up to 5 states and 6 steps, in both conventions, with zeros, a matrix for each
/// step, and missing observations.
pub fn models(kind: Kind) -> impl Strategy<Value = Model> {
    (1..=5_usize, 0..=6_usize, any::<bool>()).prop_flat_map(move |(n, steps, at_first)| {
        let weights = move || weighted(weight(kind), n);
        let shift = match kind {
            Kind::Plain => Just(0.0).boxed(),
            Kind::Shifted | Kind::Extreme => {
                prop_oneof![4 => Just(0.0), 1 => Just(-400.0), 1 => Just(-1e5), 1 => Just(700.0)]
                    .boxed()
            }
        };
        let logs = (vec(log_likelihood(kind), n), shift)
            .prop_map(|(logs, shift)| logs.iter().map(|log| log + shift).collect::<Vec<f64>>());
        let observed = prop_oneof![1 => Just(None), 5 => logs.prop_map(Some)];
        let matrices = vec(vec(weights(), n), steps);
        (weights(), matrices, vec(observed, steps)).prop_map(move |(prior, matrices, logs)| Model {
            states: n,
            at_first,
            prior,
            matrices: matrices.iter().map(transposed).collect(),
            evidence: Vec::new(),
            logs,
        })
    })
}

/// Random models with evidence on moves, with zeros, log factors and shifts; `wide` ones have
/// likelihoods from 1e-200 to 1e200 at one step, and log factors far from the largest.
pub fn measured_models(kind: Kind, wide: bool) -> impl Strategy<Value = Model> {
    models(kind).prop_flat_map(move |model| {
        let ordinary = prop_oneof![1 => Just(NEVER), 5 => (0.001..1.0).prop_map(f64::ln)];
        let log = if wide {
            prop_oneof![2 => ordinary, 1 => -460.0..460.0].boxed()
        } else {
            ordinary.boxed()
        };
        let shift =
            prop_oneof![3 => Just(0.0), 1 => Just(-400.0), 1 => Just(-1e5), 1 => Just(700.0)];
        let off =
            if wide { prop_oneof![Just(0.0), -400.0..800.0].boxed() } else { (-3.0..5.0).boxed() };
        let n = model.states;
        let evidence = (vec(vec(log, n), n), shift, off).prop_map(|(mut logs, shift, off)| {
            logs.iter_mut().flatten().for_each(|log| *log += shift);
            Evidence { logs, log_factor: shift + off }
        });
        let evidence = vec(evidence, model.matrices.len());
        evidence.prop_map(move |evidence| Model { evidence, ..model.clone() })
    })
}

/// Models whose numbers are all powers of two, so that products of doubles are
/// exact and many paths tie.
pub fn dyadic_models() -> impl Strategy<Value = Model> {
    const COLUMNS: [&[f64]; 4] = [&[1.0], &[0.5, 0.5], &[0.5, 0.25, 0.25], &[0.25; 4]];
    (1..=5_usize, 0..=5_usize, any::<bool>()).prop_flat_map(|(n, steps, at_first)| {
        // The shares of a distribution go to consecutive states, from a start and around.
        let column = move || {
            (0..4_usize, 0..n).prop_map(move |(which, start)| {
                let shares = COLUMNS[which.min(n - 1)];
                let mut column = vec![0.0; n];
                shares.iter().enumerate().for_each(|(d, p)| column[(start + d) % n] += p);
                column
            })
        };
        let likelihood = prop_oneof![1 => Just(NEVER), 4 => Just(0.0), 2 => Just(0.5_f64.ln())];
        let observed = prop_oneof![1 => Just(None), 5 => vec(likelihood, n).prop_map(Some)];
        (column(), vec(vec(column(), n), steps), vec(observed, steps)).prop_map(
            move |(prior, columns, logs)| {
                let matrices = columns.iter().map(transposed).collect();
                Model { states: n, at_first, prior, matrices, evidence: Vec::new(), logs }
            },
        )
    })
}
