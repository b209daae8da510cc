//! Sequences that autoregressive models draw.

use wayfix::error::At;
use wayfix::inference::{LearningOptions, Simulation};
use wayfix::{Belief, DenseTransition, Fixed, Hmm, HmmError, Prior};
use wayfix_learn::{LinearRegression, Rows};

use crate::kit::{rng, says, text};

const STEPS: usize = 20_000;
const FIRST: [f64; 4] = [1.0, 2.0, 3.0, 4.0];

/// Two states, outputs of two numbers, and an input of the two outputs before.
fn second_order() -> Hmm<DenseTransition, LinearRegression> {
    let family = LinearRegression::full(
        &[[-0.3, 0.1, 0.6, 0.0, 0.0, 0.2, 0.1, 0.4], [0.2, 0.0, -0.4, 0.1, 0.1, -0.3, 0.0, 0.3]],
        &[[1.0, 0.0], [-2.0, 0.5]],
        &[[0.5, 0.2, 0.2, 0.3], [2.0, -0.6, -0.6, 1.0]],
    );
    let transition = DenseTransition::from_rows(&[[0.9, 0.2], [0.1, 0.8]]).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(2).unwrap());
    Hmm::new(prior, transition, family.unwrap()).unwrap()
}

fn drawn(hmm: &Hmm<DenseTransition, LinearRegression>, seed: u64) -> Simulation<Vec<f64>> {
    hmm.simulate_after(&FIRST, STEPS, &mut rng(seed)).unwrap()
}

/// An observation has the earlier outputs and its own, as a lagged row of the whole series.
#[test]
fn rows_are_those_of_the_sequence() {
    let hmm = second_order();
    let found = drawn(&hmm, 3);
    assert_eq!((found.states().len(), found.observations().len()), (STEPS, STEPS));
    assert!(found.initial().is_some());
    let outputs = found.observations().iter().flat_map(|row| &row[4..]);
    let values: Vec<f64> = FIRST.iter().chain(outputs).copied().collect();
    let rows = Rows::new(&values, 2).unwrap().lagged(2).unwrap();
    assert!(rows.iter().eq(found.observations()));
    assert_eq!(drawn(&hmm, 3), found);
    assert_ne!(drawn(&hmm, 4), found);
    let none = hmm.simulate_after(&FIRST, 0, &mut rng(3)).unwrap();
    assert!(none.observations().is_empty());
}

/// The residuals of outputs from the line of the drawn state are noise: mean, covariance, and no
/// correlation from step to step, within five standard errors. So is the share of moves.
#[test]
fn residuals_are_the_noise() {
    let hmm = second_order();
    let family = hmm.likelihood();
    for seed in 0..5 {
        let found = drawn(&hmm, seed);
        let residual = |(row, state): (&Vec<f64>, &usize)| -> [f64; 2] {
            let line = family.predict(*state, &row[..4]).unwrap();
            [row[4] - line[0], row[5] - line[1]]
        };
        let residuals: Vec<[f64; 2]> =
            found.observations().iter().zip(found.states()).map(residual).collect();
        let within = |values: &[f64], expected: f64, variance: f64| {
            let count = values.len() as f64;
            let mean = values.iter().sum::<f64>() / count;
            let error = (variance / count).sqrt();
            assert!((mean - expected).abs() < 5.0 * error, "seed {seed}: {mean}, {expected}");
        };
        for state in 0..2 {
            let of = |value: &dyn Fn(&[f64; 2]) -> f64| -> Vec<f64> {
                let all = residuals.iter().zip(found.states());
                all.filter(|pair| *pair.1 == state).map(|pair| value(pair.0)).collect()
            };
            let covariance = family.noise().covariance(state).unwrap();
            let (a, b, both) = (covariance[0], covariance[3], covariance[1]);
            within(&of(&|r| r[0]), 0.0, a);
            within(&of(&|r| r[1]), 0.0, b);
            within(&of(&|r| r[0] * r[0]), a, 2.0 * a * a);
            within(&of(&|r| r[1] * r[1]), b, 2.0 * b * b);
            within(&of(&|r| r[0] * r[1]), both, a * b + both * both);
            let leaves = found.states().windows(2).filter(|pair| pair[0] == state);
            let stays: Vec<f64> =
                leaves.map(|pair| f64::from(u8::from(pair[1] == state))).collect();
            let stay = hmm.transition().get(state, state);
            within(&stays, stay, stay * (1.0 - stay));
        }
        // In units of the deviation in the state, since variances differ.
        let deviation =
            |step: usize| family.noise().covariance(found.states()[step]).unwrap()[0].sqrt();
        let unit: Vec<f64> = (0..STEPS).map(|step| residuals[step][0] / deviation(step)).collect();
        let next: Vec<f64> = unit.windows(2).map(|pair| pair[0] * pair[1]).collect();
        within(&next, 0.0, 1.0);
    }
}

/// Learning from a drawn sequence with its states finds the model that drew it.
#[test]
fn learning_finds_the_model_that_drew() {
    let hmm = second_order();
    for seed in 0..3 {
        let found = drawn(&hmm, seed);
        let learned = hmm.fit(&[found.labelled()], &LearningOptions::default()).unwrap();
        for state in 0..2 {
            let of = |hmm: &Hmm<DenseTransition, LinearRegression>| {
                hmm.likelihood().coefficients(state).unwrap()
            };
            // Standard errors are at most (2 / (0.5 · 6000))^½ = 0.026.
            let pairs = of(&learned).into_iter().zip(of(&hmm));
            pairs.for_each(|(a, b)| assert!((a - b).abs() < 0.13, "seed {seed}: {a}, {b}"));
        }
    }
}

/// A filter continues after the last row of a series.
#[test]
fn a_future_follows_the_last_row() {
    let hmm = second_order();
    let past = hmm.simulate_after(&FIRST, 50, &mut rng(5)).unwrap();
    let mut filter = hmm.filter();
    past.observations().iter().for_each(|row| _ = filter.step(row).unwrap());
    let last = past.observations().last().unwrap();
    let future = filter.simulate_after(last, 9, &mut rng(6)).unwrap();
    assert_eq!(future.observations().len(), 9);
    assert!(future.initial().is_some_and(|state| filter.belief().as_slice()[state] > 0.0));
    assert_eq!(future.observations()[0][..4], last[2..]);
    assert_eq!(filter.simulate_after(&last[2..], 9, &mut rng(6)).unwrap(), future);
    let error = filter.simulate_after(&[f64::NAN; 4], 9, &mut rng(6)).unwrap_err();
    assert!(matches!(error, HmmError::Likelihood(At { number: 51, .. })), "{error}");
}

#[test]
fn what_cannot_be_drawn_is_an_error() {
    let hmm = second_order();
    let draw = |first: &[f64]| hmm.simulate_after(first, 10, &mut rng(1));
    let step = |step| format!("step {step} has no valid likelihood: the sensor failed: ");
    let components = "the observation has 2 components, expected 4";
    says(draw(&[1.0, 2.0]), &format!("{}{components}", step(1)));
    assert!(text(draw(&[0.0; 5])).contains("5 components, expected 4"));
    let finite = "component 2 of the observation is NaN, expected a finite value";
    let error = text(draw(&[1.0, 2.0, f64::NAN, 4.0]));
    assert!(error.starts_with(&format!("{}{finite}", step(1))), "{error}");

    let still = |family: LinearRegression| {
        let prior = Prior::AtFirstObservation(Belief::uniform(1).unwrap());
        Hmm::new(prior, DenseTransition::from_rows(&[[1.0]]).unwrap(), Fixed(family)).unwrap()
    };
    let grows = LinearRegression::diagonal(&[[10.0]], &[[0.0]], &[[1e-6]]).unwrap();
    // 1.5 · 10^308 is within the range of doubles, 1.5 · 10^309 is not.
    let diverges =
        "component 1 of the observation is inf, expected a finite value, but the model diverges";
    says(
        still(grows.clone()).simulate_after(&[1.5], 400, &mut rng(1)),
        &format!("{}{diverges}", step(309)),
    );
    assert!(still(grows).simulate_after(&[1.5], 308, &mut rng(1)).is_ok());
    // Three inputs cannot be earlier outputs if an output has two numbers.
    let other = LinearRegression::diagonal(&[[1.0; 6]], &[[0.0; 2]], &[[1.0; 2]]).unwrap();
    let multiple =
        "the number of components of the input is 3, expected a multiple of that of the output";
    says(
        still(other).simulate_after(&[1.0; 3], 10, &mut rng(1)),
        &format!("{}{multiple}", step(1)),
    );
}
