//! Linear regressions against the formula, other parameters and their own draws.

use proptest::collection::vec;
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};
use wayfix::ReorderStates;
use wayfix::inference::LearningOptions;
use wayfix::likelihood::LearnLikelihood;
use wayfix_learn::{EmissionError, GaussianPrior, LinearRegression, Rows};

use super::kit::*;
use crate::kit::{cases, rng, with_causes};

/// A family of n states with p inputs and d outputs from random numbers.
fn family(full: bool, [n, p, d]: [usize; 3], numbers: &[f64]) -> LinearRegression {
    let rows = |each: usize, from: usize| -> Vec<Vec<f64>> {
        (0..n).map(|i| numbers[from + i * each..][..each].to_vec()).collect()
    };
    let matrix = |i: usize| covariance(d, &numbers[i..][..d * d]);
    let (coefficients, intercepts) = (rows(d * p, 0), rows(d, 2));
    if full {
        let covariances: Vec<Vec<f64>> = (0..n).map(matrix).collect();
        LinearRegression::full(&coefficients, &intercepts, &covariances).unwrap()
    } else {
        let diagonal = |i: usize| matrix(i).into_iter().step_by(d + 1).collect();
        let variances: Vec<Vec<f64>> = (0..n).map(diagonal).collect();
        LinearRegression::diagonal(&coefficients, &intercepts, &variances).unwrap()
    }
}

fn numbers() -> impl Strategy<Value = Vec<f64>> {
    vec(-2.0..2.0, 80)
}

/// Parameters in the form of the constructors.
fn parameters(family: &LinearRegression) -> [Vec<Vec<f64>>; 3] {
    let states = 0..family.noise().covariances().len();
    [
        states.clone().map(|i| family.coefficients(i).unwrap()).collect(),
        states.map(|i| family.intercept(i).unwrap()).collect(),
        family.noise().covariances(),
    ]
}

fn with(family: &LinearRegression, [b, c, v]: &[Vec<Vec<f64>>; 3]) -> Option<LinearRegression> {
    let new = if v[0].len() == family.outputs() {
        LinearRegression::diagonal(b, c, v)
    } else {
        LinearRegression::full(b, c, v)
    };
    let new = new.ok()?.with_ridge(family.ridge()).unwrap();
    Some(match family.noise().prior() {
        Some(prior) => new.with_noise_prior(prior.clone()).unwrap(),
        None => new,
    })
}

fn with_priors(family: LinearRegression, ridge: f64, noise: bool) -> LinearRegression {
    let family = family.with_ridge(ridge).unwrap();
    let prior = GaussianPrior::new(2).unwrap().with_covariance(1.3, &[0.4, 0.2]).unwrap();
    let prior = prior.with_mean(2.0, &[1.0, -1.0]).unwrap(); // plays no part
    if noise { family.with_noise_prior(prior).unwrap() } else { family }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn density_is_the_formula(
        full: bool,
        n in 1..=9_usize,
        p in 1..=3_usize,
        d in 1..=3_usize,
        numbers in vec(-2.0..2.0, 120),
        input in vec(-3.0..3.0, 3),
        output in vec(prop_oneof![1 => Just(f64::NAN), 3 => -4.0..4.0], 3),
    ) {
        let family = family(full, [n, p, d], &numbers).with_missing();
        let (input, output) = (&input[..p], &output[..d]);
        let row = [input, output].concat();
        for state in 0..n {
            let mean = family.predict(state, input).unwrap();
            let by_hand: Vec<f64> = (0..d)
                .map(|c| {
                    let b = &family.coefficients(state).unwrap()[c * p..][..p];
                    let product: f64 = b.iter().zip(input).map(|(b, x)| b * x).sum();
                    family.intercept(state).unwrap()[c] + product
                })
                .collect();
            prop_assert!(mean.iter().zip(&by_hand).all(|(a, b)| (a - b).abs() < 1e-12));
            let [seen, mean, covariance] =
                marginal(output, &mean, &family.noise().covariance(state).unwrap());
            let x: Vec<f64> = seen.iter().zip(&mean).map(|(y, mean)| y - mean).collect();
            let (log, distance) = eliminated(&covariance, &x);
            let norm = x.len() as f64 * std::f64::consts::TAU.ln();
            let expected = -0.5 * (norm + log + distance);
            let found = log_density(&family, state, &row);
            prop_assert!((found - expected).abs() <= 1e-10 * expected.abs().max(1.0));
        }
    }

    #[test]
    fn reestimate_is_the_maximum(
        full: bool,
        n in 1..=2_usize,
        numbers in numbers(),
        rows in vec(vec(-3.0..3.0, 4), 12),
        weights in weights(2, 12),
        ridge in prop_oneof![Just(0.0), 0.1..5.0],
        noise: bool,
    ) {
        let start = with_priors(family(full, [n, 2, 2], &numbers), ridge, noise);
        let weights: Vec<Vec<f64>> = weights.iter().map(|w| w[..n].to_vec()).collect();
        if let Ok(best) = reestimated(&start, &rows, &weights, 0.0) {
            let highest = objective(&best, &rows, &weights, 0.0);
            let found = parameters(&best);
            for step in [-1e-3, 1e-3] {
                for kind in 0..3 {
                    for (state, at) in
                        (0..n).flat_map(|i| (0..found[kind][0].len()).map(move |k| (i, k)))
                    {
                        let mut other = found.clone();
                        let size = if kind == 2 { found[2][state][at].abs() } else { 1.0 };
                        other[kind][state][at] += step * size;
                        if kind == 2 && full && (at == 1 || at == 2) {
                            other[kind][state][3 - at] = other[kind][state][at];
                        }
                        if let Some(other) = with(&best, &other) {
                            let value = objective(&other, &rows, &weights, 0.0);
                            prop_assert!(value <= highest + 1e-9 * highest.abs());
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn reestimate_never_lowers_the_objective(
        full: bool,
        n in 1..=2_usize,
        numbers in numbers(),
        inputs in vec(vec(-3.0..3.0, 2), 14),
        outputs in vec(vec(prop_oneof![1 => Just(f64::NAN), 3 => -3.0..3.0], 2), 14),
        weights in weights(2, 14),
        ridge in prop_oneof![Just(0.0), 0.1..5.0],
        noise: bool,
    ) {
        let family = with_priors(family(full, [n, 2, 2], &numbers), ridge, noise).with_missing();
        let rows: Vec<Vec<f64>> =
            inputs.iter().zip(&outputs).map(|(x, y)| [&x[..], y].concat()).collect();
        let weights: Vec<Vec<f64>> = weights.iter().map(|w| w[..n].to_vec()).collect();
        assert_never_falls(&family, &rows, &weights, 0.0);
    }

    #[test]
    fn hostile_rows_give_numbers_or_errors(
        full: bool,
        missing: bool,
        numbers in numbers(),
        sequences in vec(hostile(3), 1..3),
    ) {
        let family = family(full, [2, 1, 2], &numbers);
        assert_learns(&if missing { family.with_missing() } else { family }, &sequences);
    }
}

#[test]
fn learning_finds_the_lines_back() {
    let truth =
        LinearRegression::diagonal(&[[1.0], [-0.5]], &[[0.0], [3.0]], &[[0.25], [1.0]]).unwrap();
    let mut beyond = 0;
    for seed in 0..8 {
        let mut rng = rng(seed);
        let mut values = Vec::new();
        let mut counts = [0.0; 2];
        for k in 0..3000 {
            let state = k / 25 % 2;
            let x: f64 = 2.0 * Distribution::<f64>::sample(&StandardNormal, &mut rng);
            values.extend([x, truth.sample(state, &[x], &mut rng).unwrap()[0]]);
            counts[state] += 1.0;
        }
        let start = LinearRegression::diagonal(&[[0.0]; 2], &[[-1.0], [4.0]], &[[2.0]; 2]).unwrap();
        let rows = Rows::new(&values, 2).unwrap();
        let learned = lasting(start).learn(&[rows], &LearningOptions::default()).unwrap();
        let found = learned.model().likelihood();
        for (state, count) in counts.into_iter().enumerate() {
            let variance = truth.noise().covariance(state).unwrap()[0] / count;
            let slope = found.coefficients(state).unwrap()[0];
            let off = slope - truth.coefficients(state).unwrap()[0];
            let shift = found.intercept(state).unwrap()[0] - truth.intercept(state).unwrap()[0];
            for (off, error) in [(off, (variance / 4.0).sqrt()), (shift, variance.sqrt())] {
                // Steps with an uncertain state make errors slightly larger.
                assert!(off.abs() < 6.0 * error);
                beyond += usize::from(off.abs() > 3.3 * error);
            }
        }
    }
    assert!(beyond <= 3, "{beyond} of 32");
}

#[test]
fn autoregression_on_lagged_rows() {
    // y_k = 0.6 y_{k-1} - 0.3 y_{k-2} + 1 + noise: oldest first.
    let truth = LinearRegression::diagonal(&[[-0.3, 0.6]], &[[1.0]], &[[0.04]]).unwrap();
    for seed in 0..4 {
        let mut rng = rng(seed);
        let mut values = vec![1.0, 1.0];
        for k in 2..4000 {
            let next = truth.sample(0, &values[k - 2..], &mut rng).unwrap();
            values.extend(next);
        }
        let start = LinearRegression::diagonal(&[[0.0, 0.0]], &[[0.0]], &[[1.0]]).unwrap();
        let rows = Rows::new(&values, 1).unwrap().lagged(2).unwrap();
        let learned = lasting(start).learn(&[rows], &LearningOptions::default()).unwrap();
        let found = learned.model().likelihood();
        let (b, c) = (found.coefficients(0).unwrap(), found.intercept(0).unwrap());
        // Standard error of a coefficient: about ((1 − 0.3²) / 4000)^½ = 0.015.
        assert!((b[0] + 0.3).abs() < 0.075 && (b[1] - 0.6).abs() < 0.075, "{b:?}");
        assert!((c[0] - 1.0).abs() < 0.15);
        assert!(
            (found.noise().covariance(0).unwrap()[0] - 0.04).abs() < 5.0 * 0.04 / 2000_f64.sqrt()
        );
    }
}

#[test]
fn outputs_far_from_zero_keep_their_variance() {
    // Noise of 1e-3 about a line at 1e6.
    let noise = noisy_rows(500, 2, 9);
    let row = |y: f64, x: f64, z: f64| vec![x, y + 1e3 * x + 1e-3 * z];
    let far: Vec<Vec<f64>> = noise.iter().map(|z| row(1e6, z[0], z[1])).collect();
    let weights = vec![vec![1.0]; far.len()];
    let mut family = LinearRegression::full(&[[0.0]], &[[0.0]], &[[1.0]]).unwrap();
    for _ in 0..3 {
        family = reestimated(&family, &far, &weights, 0.0).unwrap();
    }
    let near: Vec<Vec<f64>> = noise.iter().map(|z| vec![z[0], z[1]]).collect();
    let start = LinearRegression::full(&[[0.0]], &[[0.0]], &[[1.0]]).unwrap();
    let expected = reestimated(&start, &near, &weights, 0.0).unwrap();
    let (found, expected) =
        (family.noise().covariance(0).unwrap()[0], expected.noise().covariance(0).unwrap()[0]);
    assert!((found / 1e-6 / expected - 1.0).abs() < 1e-6, "{found} {expected}");
}

#[test]
fn reordered_states_and_counts() {
    let numbers: Vec<f64> = (0..80).map(|i| (f64::from(i) * 0.7).cos()).collect();
    for full in [false, true] {
        let family = family(full, [3, 2, 2], &numbers);
        let other = family.reordered(&[2, 0, 1]);
        for (new, old) in [2, 0, 1].into_iter().enumerate() {
            let row = [0.3, 1.0, -0.2, 0.4];
            let (a, b) = (log_density(&other, new, &row), log_density(&family, old, &row));
            assert_eq!(a, b);
            assert_eq!(other.coefficients(new), family.coefficients(old));
        }
        assert_eq!(family.free_parameters(), 3 * (4 + 2) + 3 * if full { 3 } else { 2 });
    }
}

#[test]
fn errors_name_the_place() {
    let text = |result: Result<LinearRegression, EmissionError>| result.unwrap_err().to_string();
    let make = |b: &[f64], c: &[f64], v: &[f64]| LinearRegression::diagonal(&[b], &[c], &[v]);
    assert!(text(make(&[], &[1.0], &[1.0])).contains("at least one"));
    assert!(
        text(make(&[1.0, 2.0, 3.0], &[1.0, 1.0], &[1.0, 1.0])).contains("3 values, expected 2")
    );
    assert_eq!(
        text(make(&[1.0], &[1.0], &[0.0])),
        "the variance of state 0, component 0, is 0, expected a finite value above 2.2e-308"
    );
    let family = make(&[1.0], &[0.0], &[1.0]).unwrap();
    assert!(text(family.clone().with_ridge(-1.0)).contains("ridge is -1"));
    assert!(family.predict(1, &[0.0]).is_err() && family.predict(0, &[f64::NAN]).is_err());
    let with_missing = family.clone().with_missing();
    assert!(refused(&with_missing, &[f64::NAN, 1.0]).contains("component 0"));
    assert!(refused(&family, &[0.0, f64::NAN]).contains("component 1"));
    assert!(refused(&family, &[0.0]).contains("1 components, expected 2"));
    // A constant input.
    let values = [1.0, 2.0, 1.0, 3.0, 1.0, 4.0];
    let rows = [Rows::new(&values, 2).unwrap()];
    let error = lasting(family.clone()).learn(&rows, &LearningOptions::default()).unwrap_err();
    assert!(with_causes(&error).contains("add a ridge"), "{}", with_causes(&error));
    let ridged = family.with_ridge(0.1).unwrap();
    assert!(lasting(ridged).learn(&rows, &LearningOptions::default()).is_ok());
}

#[cfg(feature = "serde")]
#[test]
fn stored_to_the_bit() {
    let numbers: Vec<f64> = (0..80).map(|i| (f64::from(i) * 0.7).cos()).collect();
    for full in [false, true] {
        let family = with_priors(family(full, [3, 2, 2], &numbers), 0.3, true).with_missing();
        let text = serde_json::to_string(&family).unwrap();
        let read: LinearRegression = serde_json::from_str(&text).unwrap();
        assert_eq!(format!("{read:?}"), format!("{family:?}"));
    }
}
