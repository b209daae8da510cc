//! Mixtures of Gaussians against sums of their parts, other parameters and their own draws.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::ReorderStates;
use wayfix::inference::LearningOptions;
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix_learn::Family as _;
use wayfix_learn::{CovarianceType, EmissionError, Gaussian, GaussianMixture, GaussianPrior};

use super::kit::*;
use crate::kit::{cases, rng};

/// A family of n states with m parts from random numbers, with its parts as Gaussians of n m
/// states.
fn family(
    kind: CovarianceType,
    [n, m, d]: [usize; 3],
    numbers: &[f64],
) -> (GaussianMixture, Gaussian) {
    let means: Vec<Vec<f64>> = numbers.chunks(d).take(n * m).map(<[f64]>::to_vec).collect();
    let matrix = |i: usize| covariance(d, &numbers[i * d..][..d * d]);
    let covariances: Vec<Vec<f64>> = (0..n * m)
        .map(|i| match kind {
            CovarianceType::Spherical => vec![matrix(i)[0]],
            CovarianceType::Diagonal => matrix(i).into_iter().step_by(d + 1).collect(),
            CovarianceType::Full => matrix(i),
            CovarianceType::Tied => matrix(i / m),
        })
        .collect();
    let weights: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let raw: Vec<f64> = (0..m).map(|p| numbers[i * m + p].max(0.0) + 0.1).collect();
            let sum: f64 = raw.iter().sum();
            raw.iter().map(|w| w / sum).collect()
        })
        .collect();
    let by_state = |rows: &[Vec<f64>]| rows.chunks(m).map(<[_]>::to_vec).collect::<Vec<_>>();
    let (nested, parts) = (by_state(&means), by_state(&covariances));
    let first: Vec<Vec<f64>> = parts.iter().map(|parts| parts[0].clone()).collect();
    let variances: Vec<Vec<f64>> = parts.iter().map(|parts| parts.concat()).collect();
    let mixture = match kind {
        CovarianceType::Spherical => GaussianMixture::spherical(&weights, &nested, &variances),
        CovarianceType::Diagonal => GaussianMixture::diagonal(&weights, &nested, &parts),
        CovarianceType::Full => GaussianMixture::full(&weights, &nested, &parts),
        CovarianceType::Tied => GaussianMixture::tied(&weights, &nested, &first),
    };
    let of_parts = if kind == CovarianceType::Tied { CovarianceType::Full } else { kind };
    (mixture.unwrap(), Gaussian::new(of_parts, &means, &covariances).unwrap())
}

const KINDS: [CovarianceType; 4] = [
    CovarianceType::Spherical,
    CovarianceType::Diagonal,
    CovarianceType::Full,
    CovarianceType::Tied,
];

fn kinds() -> impl Strategy<Value = CovarianceType> {
    (0..4_usize).prop_map(|kind| KINDS[kind])
}

fn families() -> impl Strategy<Value = (GaussianMixture, Gaussian)> {
    (kinds(), 1..=4_usize, 1..=4_usize, 1..=3_usize).prop_flat_map(|(kind, n, m, d)| {
        vec(-2.0..2.0, n * m * d + d * d + n * m)
            .prop_map(move |numbers| family(kind, [n, m, d], &numbers))
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn density_is_the_sum_over_parts(((mixture, parts), y) in families().prop_flat_map(|family| {
        let d = family.0.components();
        (Just(family), vec(prop_oneof![1 => Just(f64::NAN), 3 => -4.0..4.0], d))
    })) {
        let (mixture, parts) = (mixture.with_missing(), parts.with_missing());
        for state in 0..mixture.means().len() {
            let weights = mixture.weights(state).unwrap().iter().enumerate();
            let at = |part: usize| state * mixture.parts() + part;
            let sum: f64 = weights.map(|(p, w)| w * log_density(&parts, at(p), &y).exp()).sum();
            let found = log_density(&mixture, state, &y);
            prop_assert!((found - sum.ln()).abs() <= 1e-11 * found.abs().max(1.0));
        }
    }

    #[test]
    fn reestimate_never_lowers_the_objective(
        kind in kinds(),
        n in 1..=2_usize,
        numbers in vec(-2.0..2.0, 30),
        rows in vec(vec(prop_oneof![1 => Just(f64::NAN), 4 => -3.0..3.0], 2), 20),
        weights in weights(2, 20),
        pseudo_count in prop_oneof![Just(0.0), 0.1..2.0],
        with_prior: bool,
        fixed in 0..4_u8,
    ) {
        let (mixture, _) = family(kind, [n, 2, 2], &numbers);
        let mixture = match fixed {
            1 => mixture.with_fixed_means(),
            2 => mixture.with_fixed_covariances(),
            _ => mixture,
        };
        let mixture = mixture.with_missing();
        let weights: Vec<Vec<f64>> = weights.iter().map(|w| w[..n].to_vec()).collect();
        let prior = GaussianPrior::new(2).unwrap().with_mean(0.5, &[0.1, -0.2]).unwrap();
        let prior = prior.with_covariance(0.7, &[0.3, 0.2]).unwrap();
        let mixture = if with_prior { mixture.with_prior(prior).unwrap() } else { mixture };
        assert_never_falls(&mixture, &rows, &weights, pseudo_count);
    }

    #[test]
    fn hostile_rows_give_numbers_or_errors(
        kind in kinds(),
        missing: bool,
        numbers in vec(-2.0..2.0, 20),
        sequences in vec(hostile(2), 1..3),
    ) {
        let (mixture, _) = family(kind, [2, 2, 2], &numbers);
        assert_learns(&if missing { mixture.with_missing() } else { mixture }, &sequences);
    }
}

#[test]
fn reestimate_is_the_closed_form() {
    // Responsibilities and moments written out, for one state of two parts in one dimension.
    let start = GaussianMixture::full(&[[0.3, 0.7]], &[[[0.0], [2.0]]], &[[[1.0], [0.5]]]).unwrap();
    let rows = noisy_rows(30, 1, 4);
    let weights: Vec<Vec<f64>> = (0..30).map(|k| vec![0.5 + 0.01 * f64::from(k)]).collect();
    let best = reestimated(&start, &rows, &weights, 1.5).unwrap();
    let density = |y: f64, mean: f64, v: f64| (-0.5 * (y - mean).powi(2) / v).exp() / v.sqrt();
    let mut sums = [[0.0; 3]; 2];
    for (row, w) in rows.iter().zip(&weights) {
        let y = row[0];
        let parts = [0.3 * density(y, 0.0, 1.0), 0.7 * density(y, 2.0, 0.5)];
        for (sum, part) in sums.iter_mut().zip(parts) {
            let share = w[0] * part / (parts[0] + parts[1]);
            (sum[0], sum[1], sum[2]) = (sum[0] + share, sum[1] + share * y, sum[2] + share * y * y);
        }
    }
    let total = sums[0][0] + sums[1][0] + 3.0;
    for (part, [count, sum, squares]) in sums.into_iter().enumerate() {
        let mean = sum / count;
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        close(best.weights(0).unwrap()[part], (count + 1.5) / total);
        close(best.mean(0, part).unwrap()[0], mean);
        close(best.covariance(0, part).unwrap()[0], squares / count - mean * mean);
    }
}

/// The covariances that one step learns are weighted means of those of all parts: over the
/// components if they are spherical, over the parts of a state if they are tied.
#[test]
fn shared_variances_are_averages_of_those_that_are_not() {
    let numbers: Vec<f64> = (0..40).map(|i| (f64::from(i) * 0.7).cos()).collect();
    let (tied, _) = family(CovarianceType::Tied, [2, 3, 2], &numbers);
    let covariances = tied.covariances();
    let repeated: Vec<Vec<Vec<f64>>> =
        covariances.iter().map(|own| vec![own[0].clone(); 3]).collect();
    let weights: Vec<Vec<f64>> =
        (0..2).map(|state| tied.weights(state).unwrap().to_vec()).collect();
    let full = GaussianMixture::full(&weights, &tied.means(), &repeated).unwrap();
    let variances = [[0.5, 1.0, 2.0], [1.5, 0.7, 1.0]];
    let spherical = GaussianMixture::spherical(&weights, &tied.means(), &variances).unwrap();
    let repeated = variances.map(|row| row.map(|v| [v; 2]));
    let diagonal = GaussianMixture::diagonal(&weights, &tied.means(), &repeated).unwrap();
    let rows = noisy_rows(60, 2, 7);
    let posterior: Vec<Vec<f64>> = (0..60).map(|k| vec![0.2 + 0.01 * f64::from(k), 0.5]).collect();
    let [tied, full, spherical, diagonal] = [tied, full, spherical, diagonal]
        .map(|start| reestimated(&start, &rows, &posterior, 0.0).unwrap());
    let close = |a: f64, b: f64| assert!((a - b).abs() <= 1e-12 * b.abs().max(1.0), "{a} {b}");
    for state in 0..2 {
        let shares = full.weights(state).unwrap();
        for entry in 0..4 {
            let each =
                (0..3).map(|part| shares[part] * full.covariance(state, part).unwrap()[entry]);
            close(tied.covariance(state, 1).unwrap()[entry], each.sum());
        }
        for part in 0..3 {
            let each = diagonal.covariance(state, part).unwrap();
            close(spherical.covariance(state, part).unwrap()[0], 0.5 * (each[0] + each[3]));
            assert_eq!(tied.mean(state, part), full.mean(state, part));
        }
    }
}

#[test]
fn learning_finds_the_parts_back() {
    let weights = [[0.3, 0.7], [0.5, 0.5]];
    let means = [[[-4.0], [0.0]], [[6.0], [10.0]]];
    let truth = GaussianMixture::diagonal(&weights, &means, &[[[1.0], [0.5]]; 2]).unwrap();
    let mut beyond = 0;
    for seed in 0..8 {
        let simulated = lasting(truth.clone()).simulate(2000, &mut rng(seed));
        let near = [[[-3.0], [1.0]], [[5.0], [11.0]]];
        let start = GaussianMixture::diagonal(&[[0.5; 2]; 2], &near, &[[[2.0]; 2]; 2]).unwrap();
        let learned =
            lasting(start).learn(&[simulated.observations()], &LearningOptions::default()).unwrap();
        let found = learned.model().likelihood();
        for state in 0..2 {
            let count = simulated.states().iter().filter(|s| **s == state).count() as f64;
            for part in 0..2 {
                let weight = weights[state][part];
                let variance = truth.covariance(state, part).unwrap()[0];
                // The overlap of the parts makes errors slightly larger than these.
                let error = 1.1 * (variance / (weight * count)).sqrt();
                let off = found.mean(state, part).unwrap()[0] - means[state][part][0];
                assert!(off.abs() < 6.0 * error);
                beyond += usize::from(off.abs() > 3.0 * error);
            }
            let error = 1.1 * (weights[state][0] * weights[state][1] / count).sqrt();
            let off = found.weights(state).unwrap()[0] - weights[state][0];
            beyond += usize::from(off.abs() > 3.0 * error);
        }
    }
    assert!(beyond <= 4, "{beyond} of 48");
}

#[test]
fn draws_come_from_all_parts() {
    let mixture = GaussianMixture::full(&[[0.25, 0.75]], &[[[-10.0], [10.0]]], &[[[1.0], [4.0]]]);
    let mixture = mixture.unwrap();
    for seed in 0..4 {
        let mut rng = rng(seed);
        let draws: Vec<f64> = (0..10_000).map(|_| mixture.sample(0, &mut rng)[0]).collect();
        let low = draws.iter().filter(|y| **y < 0.0).count() as f64;
        assert!((low - 2500.0).abs() < 5.0 * (1e4_f64 * 0.25 * 0.75).sqrt());
        let high: Vec<f64> = draws.into_iter().filter(|y| *y > 0.0).collect();
        let mean = high.iter().sum::<f64>() / high.len() as f64;
        assert!((mean - 10.0).abs() < 5.0 * 2.0 / (high.len() as f64).sqrt());
    }
}

#[test]
fn weights_of_zero_stay() {
    let start =
        GaussianMixture::diagonal(&[[0.0, 1.0]], &[[[7.0], [0.0]]], &[[[3.0], [1.0]]]).unwrap();
    assert_eq!(start.free_parameters(), 4);
    let rows = noisy_rows(10, 1, 2);
    let best = reestimated(&start, &rows, &vec![vec![1.0]; 10], 2.0).unwrap();
    assert_eq!(best.weights(0).unwrap(), [0.0, 1.0]);
    assert_eq!(
        (best.mean(0, 0), best.covariance(0, 0)),
        (start.mean(0, 0), start.covariance(0, 0))
    );
}

#[test]
fn reordered_states() {
    let numbers: Vec<f64> = (0..40).map(|i| (f64::from(i) * 0.7).cos()).collect();
    for (kind, free) in KINDS.into_iter().zip([6, 6 * 2, 6 * 3, 3 * 3]) {
        let (mixture, _) = family(kind, [3, 2, 2], &numbers);
        let other = mixture.reordered(&[1, 2, 0]);
        for (new, old) in [1, 2, 0].into_iter().enumerate() {
            let y = [0.3, -0.2];
            assert_eq!(log_density(&other, new, &y), log_density(&mixture, old, &y));
            assert_eq!(other.weights(new), mixture.weights(old));
            assert_eq!(other.mean(new, 1), mixture.mean(old, 1));
            assert_eq!(other.covariance(new, 1), mixture.covariance(old, 1));
        }
        assert_eq!(mixture.free_parameters(), 3 + 6 * 2 + free);
    }
}

#[test]
fn errors_name_state_and_part() {
    let text = |result: Result<GaussianMixture, EmissionError>| result.unwrap_err().to_string();
    let means = [[[0.0, 0.0], [1.0, 1.0]]; 2];
    let unit = [1.0, 0.0, 0.0, 1.0];
    let full = |weights: &[[f64; 2]], bad: [f64; 4]| {
        GaussianMixture::full(weights, &means, &[[unit, unit], [unit, bad]])
    };
    let halves = [[0.5, 0.5]; 2];
    assert_eq!(
        text(full(&halves, [1.0, 2.0, 2.0, 1.0])),
        "part 1 of a mixture: the covariance of state 1 is not positive definite, at component 1"
    );
    assert_eq!(
        text(full(&[[0.5, 0.5], [0.5, 0.6]], unit)),
        "the sum of the weights of state 1 is 1.1, expected 1"
    );
    assert_eq!(
        text(full(&[[-0.5, 1.5], [0.5, 0.5]], unit)),
        "the weight of state 0, component 0, is -0.5, expected a value of at least 0"
    );
    let infinite = GaussianMixture::diagonal(&halves, &means, &[[[1.0, f64::INFINITY]; 2]; 2]);
    assert!(
        text(infinite).starts_with("part 0 of a mixture: the covariance of state 0, component 1")
    );
    let tied = |bad: &[f64]| GaussianMixture::tied(&halves, &means, &[&unit[..], bad]);
    assert_eq!(
        text(tied(&[1.0, 2.0, 2.0, 1.0])),
        "the covariance of state 1 is not positive definite, at component 1"
    );
    assert!(text(tied(&[1.0, 0.5, 0.4, 1.0])).starts_with("the covariance of state 1, component"));
    assert_eq!(text(tied(&[1.0])), "the covariance of state 1 has 1 values, expected 4");
    let none: [[[f64; 1]; 0]; 1] = [[]];
    assert!(text(GaussianMixture::diagonal(&[[0.0; 0]], &none, &none)).contains("at least one"));
    let short = GaussianMixture::full(&halves, &means[..1], &[[unit, unit]; 2]);
    assert_eq!(text(short), "the list of means has 1 values, expected 2");

    let start = GaussianMixture::diagonal(&[[0.5, 0.5]], &[[[0.0], [1.0]]], &[[[1.0], [1.0]]]);
    let same = reestimated(&start.unwrap(), &vec![vec![1.0]; 9], &vec![vec![1.0]; 9], 0.0);
    let same = same.unwrap_err().to_string();
    assert!(same.starts_with("part 0 of a mixture: the variance of state 0 cannot be"), "{same}");
    let start = GaussianMixture::tied(&halves, &[[[0.0], [1.0]]; 2], &[[1.0], [1.0]]).unwrap();
    let rows: Vec<Vec<f64>> = (0..9).map(|k| vec![f64::from(k % 4)]).chain([vec![1.0]]).collect();
    let weights: Vec<Vec<f64>> =
        (0..10).map(|k| if k < 9 { vec![1.0, 0.0] } else { vec![0.0, 1.0] }).collect();
    let same = reestimated(&start, &rows, &weights, 0.0).unwrap_err().to_string();
    assert!(same.starts_with("the covariance of state 1 cannot be estimated from 1 "), "{same}");
}

#[cfg(feature = "serde")]
#[test]
fn stored_to_the_bit() {
    let numbers: Vec<f64> = (0..40).map(|i| (f64::from(i) * 0.7).cos()).collect();
    for kind in KINDS {
        let (mixture, _) = family(kind, [3, 2, 2], &numbers);
        let prior = GaussianPrior::new(2).unwrap().with_mean(0.1, &[0.2, 0.3]).unwrap();
        let mixture = mixture.with_missing().with_prior(prior).unwrap();
        let text = serde_json::to_string(&mixture).unwrap();
        let read: GaussianMixture = serde_json::from_str(&text).unwrap();
        assert_eq!(format!("{read:?}"), format!("{mixture:?}"));
    }
}

/// A part that shrinks to one observation is an error of its state before the mean, which moves
/// by much more than the deviation, is rounded.
#[test]
fn a_part_of_one_observation_ends_learning() {
    let start = GaussianMixture::diagonal(
        &[[0.06, 0.94], [0.09, 0.91]],
        &[[[-0.71, 1.51], [-0.47, 0.95]], [[-1.22, 1.2], [0.95, 0.0]]],
        &[[[3.28, 1.62], [1.62, 3.45]], [[3.45, 1.4], [1.4, 5.46]]],
    )
    .unwrap();
    let rows = vec![vec![0.0, 0.0], vec![-2.306, 0.0], vec![1.33, -2.57], vec![-0.774, 2.826]];
    let learned = lasting(start).learn(&[rows], &LearningOptions::default()).unwrap();
    assert!(learned.failed());
    let cause = learned.cause().unwrap().to_string();
    assert!(cause.contains("cannot be estimated"), "{cause}");
    assert!(learned.objectives().windows(2).all(|pair| pair[0] <= pair[1]));
}
