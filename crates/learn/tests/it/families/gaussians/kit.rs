//! Densities by other formulas, and properties that hold for every family.

use std::error::Error;
use std::fmt::Debug;

use proptest::collection::vec;
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};
use wayfix::inference::{LearnError, LearningOptions};
use wayfix::likelihood::LearnLikelihood;
use wayfix::{Belief, DenseTransition, Hmm, Likelihood, Prior};

use crate::kit::rng;

/// Family of vectors.
pub(super) trait Family:
    LearnLikelihood<Observation = [f64]> + Clone + Debug + Sync
{
}

impl<B: LearnLikelihood<Observation = [f64]> + Clone + Debug + Sync> Family for B {}

/// Log-density of an observation in a state.
pub(super) fn log_density<B: Family>(family: &B, state: usize, y: &[f64]) -> f64 {
    let n = family.states();
    let mut prior = vec![0.0; n];
    prior[state] = 1.0;
    let prior = Prior::AtFirstObservation(Belief::new(prior).unwrap());
    let hmm = Hmm::new(prior, still(n), family).unwrap();
    match hmm.log_likelihood(&[y.to_vec()]) {
        Ok(log) => log,
        Err(error) if error.to_string().contains("impossible") => f64::NEG_INFINITY,
        Err(error) => panic!("{error} for {y:?} in {family:?}"),
    }
}

fn still(n: usize) -> DenseTransition {
    let row = |i: usize| (0..n).map(|j| f64::from(u8::from(i == j))).collect::<Vec<_>>();
    DenseTransition::from_rows(&(0..n).map(row).collect::<Vec<_>>()).unwrap()
}

/// Error of an observation.
pub(super) fn refused<B: Family>(family: &B, y: &[f64]) -> String {
    let n = family.states();
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior, still(n), family).unwrap();
    hmm.log_likelihood(&[y.to_vec()]).unwrap_err().to_string()
}

/// Re-estimates a family from rows with the weights of their states.
pub(super) fn reestimated<B: Family>(
    family: &B,
    rows: &[Vec<f64>],
    weights: &[Vec<f64>],
    pseudo_count: f64,
) -> Result<B, Box<dyn Error + Send + Sync>> {
    // In two parts, as for two sequences.
    let mut statistics = [family.statistics(), family.statistics()];
    for (k, (y, weights)) in rows.iter().zip(weights).enumerate() {
        family.add(&mut statistics[k % 2], y, weights);
    }
    let [mut all, second] = statistics;
    family.merge(&mut all, &second);
    family.maximize(&all, pseudo_count)
}

/// Σ w ln p(y) over rows and states, and the prior.
pub(super) fn objective<B: Family>(
    family: &B,
    rows: &[Vec<f64>],
    weights: &[Vec<f64>],
    pseudo_count: f64,
) -> f64 {
    let mut sum = family.log_prior(pseudo_count);
    for (y, weights) in rows.iter().zip(weights) {
        for (state, w) in weights.iter().enumerate().filter(|w| *w.1 > 0.0) {
            sum += w * log_density(family, state, y);
        }
    }
    sum
}

/// Asserts that no other family has a higher objective than the re-estimated one.
pub(super) fn assert_maximum<B: Family>(
    best: &B,
    others: impl IntoIterator<Item = B>,
    rows: &[Vec<f64>],
    weights: &[Vec<f64>],
) {
    let highest = objective(best, rows, weights, 0.0);
    for other in others {
        let value = objective(&other, rows, weights, 0.0);
        assert!(value <= highest + 1e-9 * highest.abs(), "{value} > {highest}: {other:?}");
    }
}

/// Asserts that re-estimation does not lower the objective, whatever the weights.
pub(super) fn assert_never_falls<B: Family>(
    family: &B,
    rows: &[Vec<f64>],
    weights: &[Vec<f64>],
    pseudo_count: f64,
) {
    let mut last = objective(family, rows, weights, pseudo_count);
    let mut family = family.clone();
    for _ in 0..4 {
        match reestimated(&family, rows, weights, pseudo_count) {
            Ok(next) => {
                let value = objective(&next, rows, weights, pseudo_count);
                let bound = last - 1e-9 * last.abs().max(1.0);
                assert!(value >= bound, "{value} < {last}: {family:?} {next:?}");
                (family, last) = (next, value);
            }
            Err(error) => {
                assert!(error.to_string().contains("cannot be estimated"), "{error}");
                return;
            }
        }
    }
}

/// A model of a family, with persistent states.
pub(super) fn lasting<B: Likelihood>(family: B) -> Hmm<DenseTransition, B> {
    let n = family.states();
    let stay = 0.9;
    let leave = if n > 1 { (1.0 - stay) / (n - 1) as f64 } else { 0.0 };
    let stay = if n > 1 { stay } else { 1.0 };
    let entry = |i, j| if i == j { stay } else { leave };
    let row = |i| (0..n).map(|j| entry(i, j)).collect::<Vec<_>>();
    let transition = DenseTransition::from_rows(&(0..n).map(row).collect::<Vec<_>>()).unwrap();
    Hmm::new(Prior::AtFirstObservation(Belief::uniform(n).unwrap()), transition, family).unwrap()
}

/// Asserts that learning ends with a model or an error, without a panic or a NaN. With values of
/// ordinary size, the objective does not fall, either.
pub(super) fn assert_learns<B: Family>(family: &B, sequences: &[Vec<Vec<f64>>]) {
    let options = LearningOptions::default().with_iterations(8);
    let ordinary = sequences.iter().flatten().flatten().all(|y| y.is_nan() || y.abs() <= 1e3);
    match lasting(family.clone()).learn(sequences, &options) {
        Ok(learned) => {
            assert!(learned.objectives().iter().all(|value| !value.is_nan()));
            assert!(!format!("{:?}", learned.model().likelihood()).contains("NaN"));
        }
        Err(LearnError::Fell { iteration, before, after }) if ordinary => {
            panic!("fell in {iteration} from {before} to {after}: {family:?} {sequences:?}")
        }
        Err(error) => assert!(!error.to_string().contains("likelihood NaN"), "{error}"),
    }
}

/// Rows with what may go wrong: constants, duplicates, huge and tiny values.
pub(super) fn hostile(d: usize) -> impl Strategy<Value = Vec<Vec<f64>>> {
    let value = prop_oneof![
        8 => -3.0..3.0,
        2 => Just(1.0),
        1 => Just(0.0),
        1 => prop_oneof![Just(1e150), Just(-1e150), Just(1e-150), Just(1e300), Just(1e6)],
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY)],
    ];
    vec(vec(value, d), 1..12)
}

/// Weights of states for rows, some of them 0.
pub(super) fn weights(n: usize, rows: usize) -> impl Strategy<Value = Vec<Vec<f64>>> {
    let weight = prop_oneof![1 => Just(0.0), 4 => 0.01..1.0];
    vec(vec(weight, n), rows)
}

/// Rows of standard normal numbers, correlated.
pub(super) fn noisy_rows(count: usize, d: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = rng(seed);
    (0..count)
        .map(|_| {
            let mut row: Vec<f64> = StandardNormal.sample_iter(&mut rng).take(d).collect();
            (1..d).for_each(|c| row[c] += 0.5 * row[c - 1]);
            row
        })
        .collect()
}

/// A well-conditioned covariance from d² numbers: ½ 1 + B B'.
pub(super) fn covariance(d: usize, numbers: &[f64]) -> Vec<f64> {
    let entry = |i: usize, j: usize| {
        let products = (0..d).map(|k| numbers[i * d + k] * numbers[j * d + k]);
        products.sum::<f64>() + if i == j { 0.5 } else { 0.0 }
    };
    (0..d * d).map(|at| entry(at / d, at % d)).collect()
}

/// ln det of a covariance and x' Σ⁻¹ x, by Gaussian elimination.
pub(super) fn eliminated(covariance: &[f64], x: &[f64]) -> (f64, f64) {
    let d = x.len();
    let mut a: Vec<Vec<f64>> = covariance.chunks(d.max(1)).map(<[f64]>::to_vec).collect();
    let mut b = x.to_vec();
    let mut log = 0.0;
    for k in 0..d {
        log += a[k][k].ln();
        for i in k + 1..d {
            let factor = a[i][k] / a[k][k];
            let (above, below) = a.split_at_mut(i);
            below[0].iter_mut().zip(&above[k]).skip(k).for_each(|(a, b)| *a -= factor * b);
            b[i] -= factor * b[k];
        }
    }
    for k in (0..d).rev() {
        let known: f64 = (k + 1..d).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    (log, x.iter().zip(&b).map(|(x, b)| x * b).sum())
}

/// Components of a mean, and of a covariance, that are present in a row.
pub(super) fn marginal(y: &[f64], mean: &[f64], covariance: &[f64]) -> [Vec<f64>; 3] {
    let d = y.len();
    let seen: Vec<usize> = (0..d).filter(|c| !y[*c].is_nan()).collect();
    let pick = |values: &[f64]| seen.iter().map(|c| values[*c]).collect::<Vec<f64>>();
    let part = seen.iter().flat_map(|i| seen.iter().map(move |j| covariance[i * d + j]));
    [pick(y), pick(mean), part.collect()]
}
