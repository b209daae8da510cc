//! Gaussians against the formula of the density, other parameters and their own draws.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::ReorderStates;
use wayfix::inference::LearningOptions;
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix_learn::Family as _;
use wayfix_learn::{CovarianceType, EmissionError, Gaussian, GaussianPrior, Rows};

use super::kit::*;
use crate::kit::{cases, rng};

const TYPES: [CovarianceType; 4] = [
    CovarianceType::Spherical,
    CovarianceType::Diagonal,
    CovarianceType::Full,
    CovarianceType::Tied,
];

fn types() -> impl Strategy<Value = CovarianceType> {
    (0..4_usize).prop_map(|kind| TYPES[kind])
}

/// A family from random numbers, with covariances made positive definite.
fn family(kind: CovarianceType, n: usize, d: usize, numbers: &[f64]) -> Gaussian {
    let means: Vec<Vec<f64>> = numbers.chunks(d).take(n).map(<[f64]>::to_vec).collect();
    let full = |i: usize| covariance(d, &numbers[i * d..][..d * d]);
    let covariances: Vec<Vec<f64>> = match kind {
        CovarianceType::Spherical => (0..n).map(|i| vec![full(i)[0]]).collect(),
        CovarianceType::Diagonal => {
            (0..n).map(|i| full(i).into_iter().step_by(d + 1).collect()).collect()
        }
        CovarianceType::Full => (0..n).map(full).collect(),
        CovarianceType::Tied => vec![full(0)],
    };
    Gaussian::new(kind, &means, &covariances).unwrap()
}

fn families() -> impl Strategy<Value = Gaussian> {
    (types(), 1..=11_usize, 1..=5_usize).prop_flat_map(|(kind, n, d)| {
        vec(-2.0..2.0, n * d + d * d).prop_map(move |numbers| family(kind, n, d, &numbers))
    })
}

fn priors(d: usize) -> impl Strategy<Value = Option<GaussianPrior>> {
    let some = (0.0..3.0, vec(-1.0..1.0, d), 0.0..3.0, vec(-1.0..1.0, d * d));
    let some = some.prop_map(move |(kappa, mean, nu, numbers)| {
        let prior = GaussianPrior::new(d).unwrap().with_mean(kappa, &mean).unwrap();
        Some(prior.with_covariance(nu, &covariance(d, &numbers)).unwrap())
    });
    prop_oneof![Just(None), some]
}

fn with_prior(family: Gaussian, prior: Option<GaussianPrior>) -> Gaussian {
    match prior {
        Some(prior) => family.with_prior(prior).unwrap(),
        None => family,
    }
}

/// A small family with rows, weights of states, and a prior. In some, means or covariances are
/// fixed.
fn problems(missing: bool) -> impl Strategy<Value = (Gaussian, Vec<Vec<f64>>, Vec<Vec<f64>>)> {
    (types(), 1..=2_usize, 1..=3_usize, 1..14_usize).prop_flat_map(move |(kind, n, d, count)| {
        let value = if missing {
            prop_oneof![1 => Just(f64::NAN), 3 => -3.0..3.0].boxed()
        } else {
            (-3.0..3.0).boxed()
        };
        let rows = vec(vec(value, d), count);
        let numbers = vec(-2.0..2.0, n * d + d * d);
        (numbers, rows, weights(n, count), priors(d), 0..4_u8).prop_map(
            move |(numbers, rows, weights, prior, fixed)| {
                let family = with_prior(family(kind, n, d, &numbers), prior);
                let family = match fixed {
                    1 => family.with_fixed_means(),
                    2 => family.with_fixed_covariances(),
                    _ => family,
                };
                (if missing { family.with_missing() } else { family }, rows, weights)
            },
        )
    })
}

/// Families near a given one: each parameter that is not fixed is changed in both directions.
fn neighbours(family: &Gaussian) -> Vec<Gaussian> {
    let (means, covariances) = (family.means(), family.covariances());
    let (kind, d) = (family.covariance_type(), family.components());
    let with = |means: &[Vec<f64>], covariances: &[Vec<f64>]| {
        let new = Gaussian::new(kind, means, covariances).ok()?;
        Some(with_prior(new, family.prior().cloned()))
    };
    let mut all = Vec::new();
    for step in [-1e-3, 1e-3] {
        let of_means = if family.has_fixed_means() { 0 } else { means.len() };
        for (state, c) in (0..of_means).flat_map(|i| (0..d).map(move |c| (i, c))) {
            let mut other = means.clone();
            other[state][c] += step;
            all.extend(with(&other, &covariances));
        }
        let of_covariances = if family.has_fixed_covariances() { 0 } else { covariances.len() };
        for (at, covariance) in covariances.iter().enumerate().take(of_covariances) {
            for entry in 0..covariance.len() {
                let mut other = covariances.clone();
                let step = step * covariance[entry].abs();
                other[at][entry] += step;
                let full = covariance.len() == d * d && d > 1;
                if full && entry / d != entry % d {
                    other[at][entry % d * d + entry / d] += step;
                }
                all.extend(with(&means, &other));
            }
        }
    }
    all
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn density_is_the_formula((family, y) in families().prop_flat_map(|family| {
        let d = family.components();
        (Just(family), vec(prop_oneof![1 => Just(f64::NAN), 3 => -4.0..4.0], d))
    })) {
        let family = family.with_missing();
        for state in 0..family.means().len() {
            let [seen, mean, covariance] =
                marginal(&y, family.mean(state).unwrap(), &family.covariance(state).unwrap());
            let x: Vec<f64> = seen.iter().zip(&mean).map(|(y, mean)| y - mean).collect();
            let (log, distance) = eliminated(&covariance, &x);
            let norm = x.len() as f64 * std::f64::consts::TAU.ln();
            let expected = -0.5 * (norm + log + distance);
            let found = log_density(&family, state, &y);
            prop_assert!((found - expected).abs() <= 1e-11 * expected.abs().max(1.0));
        }
    }

    #[test]
    fn reestimate_is_the_maximum((family, rows, weights) in problems(false)) {
        // States without weight keep their parameters, whatever the prior.
        let mut weights = weights;
        weights[0].iter_mut().for_each(|w| *w = w.max(0.01));
        if let Ok(best) = reestimated(&family, &rows, &weights, 0.0) {
            assert_maximum(&best, neighbours(&best), &rows, &weights);
            prop_assert!(!family.has_fixed_means() || best.means() == family.means());
            let kept = best.covariances() == family.covariances();
            prop_assert!(!family.has_fixed_covariances() || kept);
        }
    }

    #[test]
    fn reestimate_never_lowers_the_objective((family, rows, weights) in problems(true)) {
        assert_never_falls(&family, &rows, &weights, 0.0);
    }

    #[test]
    fn hostile_rows_give_numbers_or_errors(
        kind in types(),
        n in 1..=3_usize,
        missing: bool,
        numbers in vec(-2.0..2.0, 10),
        sequences in vec(hostile(2), 1..3),
    ) {
        let family = family(kind, n, 2, &numbers);
        assert_learns(&if missing { family.with_missing() } else { family }, &sequences);
    }
}

#[test]
fn wholly_missing_rows_say_nothing() {
    for kind in TYPES {
        let numbers: Vec<f64> = (0..10).map(|i| f64::from(i) * 0.37 - 1.0).collect();
        let family = family(kind, 3, 2, &numbers).with_missing();
        let rows = noisy_rows(20, 2, 1);
        let weights = vec![vec![0.2, 0.3, 0.5]; 21];
        let mut longer = rows.clone();
        longer.push(vec![f64::NAN; 2]);
        let [a, b] = [&rows, &longer].map(|rows| reestimated(&family, rows, &weights, 0.0));
        let (a, b) = (a.unwrap(), b.unwrap());
        assert_eq!((a.means(), a.covariances()), (b.means(), b.covariances()));
        assert_eq!(log_density(&family, 1, &[f64::NAN; 2]), 0.0);
    }
}

#[test]
fn values_far_from_zero_keep_their_variance() {
    // Deviations of 1e-3 about 1e6, from a distant start.
    let rows: Vec<Vec<f64>> = noisy_rows(1000, 2, 3)
        .iter()
        .map(|row| row.iter().map(|z| 1e6 + 1e-3 * z).collect())
        .collect();
    let from: Vec<Vec<f64>> =
        rows.iter().map(|row| row.iter().map(|y| y - 1e6).collect()).collect();
    let weights = vec![vec![1.0]; rows.len()];
    for kind in TYPES {
        let numbers = [0.3, -0.4, 0.2, 0.9, 0.1, 0.2];
        let start = family(kind, 1, 2, &numbers);
        // The first iteration finds the means.
        let [far, near] = [&rows, &from].map(|rows| {
            let first = reestimated(&start, rows, &weights, 0.0).unwrap();
            reestimated(&first, rows, &weights, 0.0).unwrap()
        });
        for (far, near) in far.covariance(0).unwrap().iter().zip(near.covariance(0).unwrap()) {
            assert!((far - near).abs() <= 1e-9 * near.abs(), "{far} {near}");
        }
    }
}

#[test]
fn prior_of_hmmlearn() {
    // The sums that hmmlearn divides, written out for one state and two rows.
    let rows = [vec![1.0, 2.0], vec![3.0, -1.0]];
    let weights = [vec![0.5], vec![1.0]];
    let prior = GaussianPrior::new(2).unwrap().with_mean(2.0, &[1.0, 1.0]).unwrap();
    let prior = prior.with_covariance(1.0, &[0.1, 0.1, 0.1, 0.1]).unwrap();
    let start = Gaussian::full(&[[0.0; 2]], &[[1.0, 0.0, 0.0, 1.0]]).unwrap();
    let best = start.with_prior(prior).unwrap();
    let best = reestimated(&best, &rows, &weights, 0.0).unwrap();
    let mean = [(2.0 + 0.5 + 3.0) / 3.5, (2.0 + 1.0 - 1.0) / 3.5];
    let found = best.mean(0).unwrap();
    assert!(found.iter().zip(mean).all(|(a, b)| (a - b).abs() < 1e-15));
    for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let about = |row: &[f64]| (row[i] - mean[i]) * (row[j] - mean[j]);
        let sum = 0.1 + 2.0 * about(&[1.0, 1.0]) + 0.5 * about(&rows[0]) + about(&rows[1]);
        let found = best.covariance(0).unwrap()[2 * i + j];
        assert!((found - sum / 2.5).abs() < 1e-14);
    }
}

#[test]
fn draws_have_the_moments() {
    for (seed, kind) in (0..).zip(TYPES) {
        let numbers = [0.5, -1.0, 2.0, 0.3, 0.8, -0.7, 0.2, 1.1, -0.4];
        let family = family(kind, 1, 2, &numbers);
        let (mean, covariance) = (family.mean(0).unwrap(), family.covariance(0).unwrap());
        let mut rng = rng(seed);
        let count = 20_000;
        let draws: Vec<Vec<f64>> = (0..count).map(|_| family.sample(0, &mut rng)).collect();
        for i in 0..2 {
            let found = draws.iter().map(|y| y[i]).sum::<f64>() / f64::from(count);
            let error = (covariance[3 * i] / f64::from(count)).sqrt();
            assert!((found - mean[i]).abs() < 5.0 * error);
            for j in 0..2 {
                let products = draws.iter().map(|y| (y[i] - mean[i]) * (y[j] - mean[j]));
                let found = products.sum::<f64>() / f64::from(count);
                let [a, b, c] = [covariance[3 * i], covariance[3 * j], covariance[2 * i + j]];
                let error = ((a * b + c * c) / f64::from(count)).sqrt();
                assert!((found - c).abs() < 5.0 * error, "{kind:?}: {found} {c}");
            }
        }
    }
}

#[test]
fn learning_finds_the_means_back() {
    // Of 2 × 2 means for each seed, few may lie beyond three standard errors, with missing values.
    let truth =
        Gaussian::full(&[[0.0, 0.0], [3.0, -3.0]], &[[1.0, 0.6, 0.6, 1.0], [2.0, -0.5, -0.5, 0.5]]);
    let truth = truth.unwrap().with_missing();
    let mut beyond = 0;
    for seed in 0..8 {
        let mut rng = rng(seed);
        let simulated = lasting(truth.clone()).simulate(2000, &mut rng);
        let mut rows: Vec<Vec<f64>> = simulated.observations().to_vec();
        rows.iter_mut().step_by(5).for_each(|row| row[1] = f64::NAN);
        let start = Gaussian::full(&[[-1.0, 1.0], [1.0, -1.0]], &[[4.0, 0.0, 0.0, 4.0]; 2]);
        let learned =
            lasting(start.unwrap().with_missing()).learn(&[rows], &LearningOptions::default());
        let learned = learned.unwrap();
        let found = learned.model().likelihood();
        for state in 0..2 {
            let count = simulated.states().iter().filter(|s| **s == state).count() as f64;
            for (c, seen) in [1.0, 0.8].into_iter().enumerate() {
                let variance = truth.covariance(state).unwrap()[3 * c];
                let error = (variance / (seen * count)).sqrt();
                let off = found.mean(state).unwrap()[c] - truth.mean(state).unwrap()[c];
                assert!(off.abs() < 6.0 * error);
                beyond += usize::from(off.abs() > 3.0 * error);
            }
        }
    }
    assert!(beyond <= 3, "{beyond} of 32");
}

#[test]
fn states_without_weight_keep_their_parameters() {
    for kind in TYPES {
        let numbers: Vec<f64> = (0..8).map(|i| (f64::from(i) * 1.7).sin()).collect();
        let family = family(kind, 2, 2, &numbers);
        let rows = noisy_rows(9, 2, 5);
        let learned = reestimated(&family, &rows, &vec![vec![1.0, 0.0]; 9], 0.0).unwrap();
        assert_eq!(learned.mean(1), family.mean(1));
        if kind != CovarianceType::Tied {
            assert_eq!(learned.covariance(1), family.covariance(1));
        }
        assert_ne!(learned.mean(0), family.mean(0));
    }
}

#[test]
fn free_parameters() {
    let numbers = [0.1; 20];
    let count = TYPES.map(|kind| family(kind, 3, 2, &numbers).free_parameters());
    assert_eq!(count, [6 + 3, 6 + 6, 6 + 9, 6 + 3]);
    let fixed = TYPES.map(|kind| family(kind, 3, 2, &numbers).with_fixed_covariances());
    assert_eq!(fixed.map(|family| family.free_parameters()), [6; 4]);
    let fixed = TYPES.map(|kind| family(kind, 3, 2, &numbers).with_fixed_means());
    assert_eq!(fixed.clone().map(|family| family.free_parameters()), [3, 6, 9, 3]);
    let both = fixed.map(Gaussian::with_fixed_covariances);
    assert_eq!(both.map(|family| family.free_parameters()), [0; 4]);
}

#[test]
fn fixed_covariances_need_no_spread() {
    // Equal rows: without the covariance, the mean still has an estimate.
    let rows = vec![vec![7.0, 1.0]; 5];
    let weights = vec![vec![1.0]; 5];
    for kind in TYPES {
        let family = family(kind, 1, 2, &[0.3, 0.1, 0.8, -0.2, 0.5, 0.4]);
        let error = reestimated(&family, &rows, &weights, 0.0).unwrap_err();
        assert!(error.to_string().contains("cannot be estimated"), "{error}");
        let fixed = family.clone().with_fixed_covariances();
        let learned = reestimated(&fixed, &rows, &weights, 0.0).unwrap();
        assert_eq!(learned.mean(0), Some(&[7.0, 1.0][..]));
        assert_eq!(learned.covariances(), family.covariances());
    }
}

#[test]
fn reordered_states() {
    for kind in TYPES {
        let numbers: Vec<f64> = (0..13).map(|i| (f64::from(i) * 0.7).cos()).collect();
        let family = family(kind, 3, 2, &numbers);
        let other = family.reordered(&[2, 0, 1]);
        for (new, old) in [2, 0, 1].into_iter().enumerate() {
            assert_eq!(other.mean(new), family.mean(old));
            assert_eq!(other.covariance(new), family.covariance(old));
            let y = [0.3, -0.2];
            assert_eq!(log_density(&other, new, &y), log_density(&family, old, &y));
        }
    }
}

#[test]
fn errors_name_the_place() {
    let text = |result: Result<Gaussian, EmissionError>| result.unwrap_err().to_string();
    let none: [[f64; 2]; 0] = [];
    assert!(text(Gaussian::spherical(&none, &[])).contains("0 states"));
    assert_eq!(
        text(Gaussian::spherical(&[[0.0], [1.0]], &[1.0, 0.0])),
        "the variance of state 1 is 0, expected a finite value above 2.2e-308"
    );
    assert_eq!(
        text(Gaussian::diagonal(&[[0.0, 1.0]], &[[1.0, -2.0]])),
        "the variance of state 0, component 1, is -2, expected a finite value above 2.2e-308"
    );
    assert_eq!(
        text(Gaussian::full(&[[0.0, 0.0], [f64::NAN, 0.0]], &[[1.0, 0.0, 0.0, 1.0]; 2])),
        "the mean of state 1, component 0, is NaN, expected a finite value"
    );
    assert_eq!(
        text(Gaussian::full(&[[0.0, 0.0]; 2], &[[1.0, 0.0, 0.0, 1.0], [1.0, 2.0, 2.0, 1.0]])),
        "the covariance of state 1 is not positive definite, at component 1"
    );
    assert_eq!(
        text(Gaussian::full(&[[0.0, 0.0]], &[[1.0, 0.5, 0.4, 1.0]])),
        "the covariance of state 0, component 0, is 0.5, expected a symmetric matrix"
    );
    assert_eq!(
        text(Gaussian::tied(&[[0.0, 0.0]; 3], &[1.0, 1.0, 1.0, 1.0])),
        "the covariance is not positive definite, at component 1"
    );
    assert!(text(Gaussian::full(&[[0.0, 0.0]], &[[1.0; 3]])).contains("has 3 values, expected 4"));
    let family = Gaussian::spherical(&[[0.0, 0.0]], &[1.0]).unwrap();
    assert!(refused(&family, &[0.0]).contains("1 components, expected 2"));
    assert!(refused(&family, &[0.0, f64::NAN]).contains("component 1 of the observation is NaN"));
    let infinite = refused(&family.clone().with_missing(), &[f64::INFINITY, f64::NAN]);
    assert!(infinite.contains("component 0 of the observation is inf"));
    let prior = GaussianPrior::new(3).unwrap();
    assert!(text(family.clone().with_prior(prior)).contains("3 values, expected 2"));
    let indefinite = GaussianPrior::new(2).unwrap().with_covariance(0.0, &[1.0, 2.0, 2.0, 1.0]);
    assert!(indefinite.unwrap_err().to_string().contains("not positive definite"));

    let values = [1.0; 12];
    let error =
        lasting(family).learn(&[Rows::new(&values, 2).unwrap()], &LearningOptions::default());
    let error = crate::kit::with_causes(&error.unwrap_err());
    assert!(error.contains("variance of state 0") && error.contains("give a prior"), "{error}");
}

#[cfg(feature = "serde")]
#[test]
fn stored_to_the_bit() {
    for kind in TYPES {
        let numbers: Vec<f64> = (0..13).map(|i| (f64::from(i) * 0.7).cos()).collect();
        let prior = GaussianPrior::new(2).unwrap().with_mean(0.1, &[0.2, 0.3]).unwrap();
        let prior = prior.with_covariance(0.1, &[0.2, 0.3]).unwrap();
        let family = family(kind, 3, 2, &numbers).with_missing().with_prior(prior).unwrap();
        let family = if kind == CovarianceType::Full {
            family.with_fixed_means()
        } else {
            family.with_fixed_covariances()
        };
        let text = serde_json::to_string(&family).unwrap();
        let read: Gaussian = serde_json::from_str(&text).unwrap();
        assert_eq!(format!("{read:?}"), format!("{family:?}"));
        let broken =
            text.replace("\"version\":1,\"covariance_type\"", "\"version\":2,\"covariance_type\"");
        assert!(serde_json::from_str::<Gaussian>(&broken).is_err());
    }
}

/// An observation far away with a weight far below 1e-16 still counts by its square.
#[test]
fn observations_of_little_weight_count() {
    let near = [1.0, -1.0, 3.0, 2.0];
    for (far, little) in [(1e12, 1e-20), (1e20, 1e-30), (1e100, 1e-190)] {
        for kind in TYPES {
            for place in 0..5 {
                let mut seen: Vec<(f64, f64)> = near.iter().map(|y| (*y, 1.0)).collect();
                seen.insert(place, (far, little));
                let rows: Vec<Vec<f64>> = seen.iter().map(|(y, _)| vec![*y]).collect();
                let weights: Vec<Vec<f64>> = seen.iter().map(|(_, w)| vec![*w]).collect();
                let start = Gaussian::new(kind, &[[0.0]], &[[1.0]]).unwrap();
                let learned = reestimated(&start, &rows, &weights, 0.0).unwrap();
                let (mean, sum) = (1.25 + far * little / 4.0, 8.75 + little * far * far);
                let found = (learned.mean(0).unwrap()[0], learned.covariance(0).unwrap()[0]);
                let text = format!("{far} at {place}, {kind:?}: {found:?}");
                assert!((found.0 - mean).abs() < 1e-7 * far * little + 1e-12, "{text}");
                assert!((found.1 / (sum / 4.0) - 1.0).abs() < 1e-7, "{text}, not {}", sum / 4.0);
            }
        }
    }
}

/// The mean is rounded to a double, which may differ from that of the observations; the covariance
/// is about the rounded mean.
#[test]
fn covariances_are_about_the_means_that_are_kept() {
    let unit = 16384.0; // the distance of doubles at 1e20
    let rows: Vec<Vec<f64>> =
        [0.0, 7.0, 7.0, -7.0, 14.0].iter().map(|k| vec![1e20 + unit * k, k * k]).collect();
    let weights = vec![vec![1.0]; 5];
    let start = Gaussian::full(&[[1e20, 0.0]], &[[unit * unit, 0.0, 0.0, 1.0]]).unwrap();
    let learned = reestimated(&start, &rows, &weights, 0.0).unwrap();
    let mean = learned.mean(0).unwrap().to_vec();
    assert_eq!(mean[0], 1e20 + 4.0 * unit); // rounded from 4.2 units
    let entry = |i: usize, j: usize| {
        rows.iter().map(|y| (y[i] - mean[i]) * (y[j] - mean[j])).sum::<f64>() / 5.0
    };
    let found = learned.covariance(0).unwrap();
    for (k, value) in found.iter().enumerate() {
        let expected = entry(k / 2, k % 2);
        assert!((value - expected).abs() <= 1e-12 * expected.abs(), "{k}: {value}, not {expected}");
    }
}

/// Inverses of the smallest covariances, whose products are beyond the range of doubles.
#[test]
fn priors_of_tiny_covariances_are_no_nan() {
    let (variance, share) = (1e-307, 1.0 - 1e-11);
    let covariance = [1.0, share, share, 1.0].map(|x| x * variance);
    let prior = GaussianPrior::new(2).unwrap().with_covariance(1.0, &[0.0, variance]).unwrap();
    let family = Gaussian::full(&[[0.0, 0.0]], &[covariance]).unwrap().with_prior(prior).unwrap();
    // ln det Σ and the second entry of Σ⁻¹, times the variance.
    let least = (1.0 - share) * (1.0 + share);
    let expected = -0.5 * (2.0 * variance.ln() + least.ln() + 1.0 / least);
    let found = family.log_prior(0.0);
    assert!((found / expected - 1.0).abs() < 1e-4, "{found}, not {expected}");
}
