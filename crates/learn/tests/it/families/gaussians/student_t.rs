//! Student's t against integrals, other parameters and its own draws.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::ReorderStates;
use wayfix::inference::LearningOptions;
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix_learn::{CovarianceType, EmissionError, Gaussian, GaussianPrior, StudentT};

use super::kit::*;
use crate::kit::{cases, rng};

const TYPES: [CovarianceType; 4] = [
    CovarianceType::Spherical,
    CovarianceType::Diagonal,
    CovarianceType::Full,
    CovarianceType::Tied,
];

/// A family from random numbers, with settings of its means and scales.
fn family(
    kind: CovarianceType,
    [n, d]: [usize; 2],
    numbers: &[f64],
    settings: impl FnOnce(Gaussian) -> Gaussian,
) -> StudentT {
    let means: Vec<Vec<f64>> = numbers.chunks(d).take(n).map(<[f64]>::to_vec).collect();
    let full = |i: usize| covariance(d, &numbers[i * d..][..d * d]);
    let scales: Vec<Vec<f64>> = match kind {
        CovarianceType::Spherical => (0..n).map(|i| vec![full(i)[0]]).collect(),
        CovarianceType::Diagonal => {
            (0..n).map(|i| full(i).into_iter().step_by(d + 1).collect()).collect()
        }
        CovarianceType::Full => (0..n).map(full).collect(),
        CovarianceType::Tied => vec![full(0)],
    };
    let degrees: Vec<f64> = numbers[..n].iter().map(|x| 3.0 * x.exp()).collect();
    let gaussian = Gaussian::new(kind, &means, &scales).unwrap();
    StudentT::new(&degrees, settings(gaussian)).unwrap()
}

/// The density as a mean of Gaussian ones over precisions u, which have a gamma distribution:
/// ∫ u^(ν/2 − 1) exp(−ν u / 2) N(y; μ, Σ / u) du over the same without N, by trapezes in ln u.
fn mixed(family: &StudentT, state: usize, y: &[f64]) -> f64 {
    let (nu, gaussian) = (family.degrees()[state], family.gaussian());
    let [seen, mean, scale] =
        marginal(y, gaussian.mean(state).unwrap(), &gaussian.covariance(state).unwrap());
    let x: Vec<f64> = seen.iter().zip(&mean).map(|(y, mean)| y - mean).collect();
    let (log, distance) = eliminated(&scale, &x);
    let norm = -0.5 * (x.len() as f64 * std::f64::consts::TAU.ln() + log);
    let (mut above, mut below) = (0.0, 0.0);
    for k in -60_000..20_000 {
        let t = f64::from(k) * 1e-3;
        let u = t.exp();
        let prior = (0.5 * nu * (t - u + 1.0)).exp();
        below += prior;
        above += prior * (0.5 * (x.len() as f64 * t - u * distance)).exp();
    }
    norm + f64::ln(above / below)
}

proptest! {
    #![proptest_config(crate::kit::cases_of(200))]

    #[test]
    fn density_is_a_mixture_over_precisions(
        kind in (0..4_usize).prop_map(|kind| TYPES[kind]),
        numbers in vec(-1.5..1.5, 30),
        y in vec(prop_oneof![1 => Just(f64::NAN), 3 => -6.0..6.0], 3),
    ) {
        let family = family(kind, [2, 3], &numbers, Gaussian::with_missing);
        for state in 0..2 {
            let (found, expected) = (log_density(&family, state, &y), mixed(&family, state, &y));
            prop_assert!((found - expected).abs() <= 1e-9 * expected.abs().max(1.0));
        }
    }
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn reestimate_never_lowers_the_objective(
        kind in (0..4_usize).prop_map(|kind| TYPES[kind]),
        n in 1..=2_usize,
        numbers in vec(-1.5..1.5, 30),
        rows in vec(vec(prop_oneof![1 => Just(f64::NAN), 4 => -3.0..3.0, 1 => -60.0..60.0], 2), 20),
        weights in weights(2, 20),
        fixed in 0..5_u8,
        with_prior: bool,
    ) {
        let weights: Vec<Vec<f64>> = weights.iter().map(|w| w[..n].to_vec()).collect();
        let prior = GaussianPrior::new(2).unwrap().with_mean(0.5, &[0.1, -0.2]).unwrap();
        let prior = prior.with_covariance(0.7, &[0.3, 0.2]).unwrap();
        let settings = |family: Gaussian| {
            let family = family.with_missing();
            let family = if with_prior { family.with_prior(prior).unwrap() } else { family };
            match fixed {
                1 => family.with_fixed_means(),
                2 => family.with_fixed_covariances(),
                _ => family,
            }
        };
        let family = family(kind, [n, 2], &numbers, settings);
        let family = if fixed == 3 { family.with_fixed_degrees() } else { family };
        assert_never_falls(&family, &rows, &weights, 0.0);
    }

    #[test]
    fn hostile_rows_give_numbers_or_errors(
        kind in (0..4_usize).prop_map(|kind| TYPES[kind]),
        missing: bool,
        numbers in vec(-1.5..1.5, 10),
        sequences in vec(hostile(2), 1..3),
    ) {
        let settings = |family: Gaussian| if missing { family.with_missing() } else { family };
        assert_learns(&family(kind, [2, 2], &numbers, settings), &sequences);
    }
}

#[test]
fn a_step_is_the_maximum_of_what_is_expected() {
    // One dimension, written out: Σ w (E[ln u] − E[u] ((y − μ)² / s + ν) + ν …) for each parameter.
    let (nu, mean, scale) = (4.0, 0.5, 2.0);
    let start = StudentT::new(&[nu], Gaussian::full(&[[mean]], &[[scale]]).unwrap()).unwrap();
    let rows: Vec<Vec<f64>> = noisy_rows(40, 1, 6);
    let weights: Vec<Vec<f64>> = (0..40).map(|k| vec![0.2 + 0.02 * f64::from(k)]).collect();
    let best = reestimated(&start, &rows, &weights, 0.0).unwrap();
    // E[u] and, by the integral over ln u, E[ln u].
    let expected: Vec<[f64; 2]> = rows
        .iter()
        .map(|y| {
            let (a, b) = (0.5 * (nu + 1.0), 0.5 * (nu + (y[0] - mean).powi(2) / scale));
            let (mut mass, mut logs) = (0.0, 0.0);
            for k in -30_000..10_000 {
                let t = f64::from(k) * 1e-3;
                let p = (a * t - b * t.exp()).exp();
                (mass, logs) = (mass + p, logs + p * t);
            }
            [a / b, logs / mass]
        })
        .collect();
    // ln Γ by the integral that defines it.
    let ln_gamma = |a: f64| {
        let sum: f64 =
            (-60_000..10_000).map(|k| f64::from(k) * 1e-3).map(|t| (a * t - t.exp()).exp()).sum();
        (sum * 1e-3).ln()
    };
    let objective = |nu: f64, mean: f64, scale: f64| {
        let half = 0.5 * nu;
        let norm = half * half.ln() - ln_gamma(half) - 0.5 * scale.ln();
        let rows = rows.iter().zip(&weights).zip(&expected);
        rows.map(|((y, w), [u, ln_u])| {
            let distance = (y[0] - mean).powi(2) / scale;
            w[0] * (norm + half * (ln_u - u) - 0.5 * u * distance)
        })
        .sum::<f64>()
    };
    let (nu, mean, scale) =
        (best.degrees()[0], best.gaussian().means()[0][0], best.gaussian().covariances()[0][0]);
    let highest = objective(nu, mean, scale);
    for step in [-1e-3, 1e-3] {
        assert!(objective(nu * (1.0 + step), mean, scale) < highest);
        assert!(objective(nu, mean + step, scale) < highest);
        assert!(objective(nu, mean, scale * (1.0 + step)) < highest);
    }
}

#[test]
fn with_many_degrees_it_is_gaussian() {
    let covariance = [2.0, 0.3, 0.3, 1.0];
    let gaussian = Gaussian::full(&[[0.5, -1.0]], &[covariance]).unwrap();
    for (degrees, error) in [(1e6, 1e-4), (1e9, 1e-7), (1e15, 1e-12), (1e300, 1e-12)] {
        let family =
            StudentT::new(&[degrees], Gaussian::full(&[[0.5, -1.0]], &[covariance]).unwrap())
                .unwrap();
        for y in [[0.0, 0.0], [3.0, 2.0], [-2.0, 4.0]] {
            let (a, b) = (log_density(&family, 0, &y), log_density(&gaussian, 0, &y));
            assert!((a - b).abs() < error * b.abs(), "{degrees}: {a} {b}");
        }
    }
}

#[test]
fn draws_have_the_moments() {
    for seed in 0..4 {
        let family =
            StudentT::new(&[12.0], Gaussian::full(&[[1.0, 2.0]], &[[2.0, 0.6, 0.6, 1.0]]).unwrap())
                .unwrap();
        let mut rng = rng(seed);
        let count = 20_000;
        let draws: Vec<Vec<f64>> = (0..count).map(|_| family.sample(0, &mut rng)).collect();
        // Kurtosis 3 (ν − 2) / (ν − 4) = 3.75.
        for (i, j, scale) in [(0, 0, 2.0), (0, 1, 0.6), (1, 1, 1.0)] {
            let expected = scale * 12.0 / 10.0;
            let products = draws.iter().map(|y| (y[i] - 1.0 - i as f64) * (y[j] - 1.0 - j as f64));
            let found = products.sum::<f64>() / f64::from(count);
            assert!((found - expected).abs() < 5.0 * 2.4 * 1.7 / f64::from(count).sqrt());
        }
        // A quarter of a t with 3 degrees lies above 0.7649.
        let family = StudentT::new(&[3.0], Gaussian::spherical(&[[0.0]], &[1.0]).unwrap()).unwrap();
        let above = (0..count).filter(|_| family.sample(0, &mut rng)[0] > 0.764_892).count();
        let off = above as f64 - 0.25 * f64::from(count);
        assert!(off.abs() < 5.0 * (0.1875 * f64::from(count)).sqrt());
    }
}

#[test]
fn learning_finds_means_and_degrees_back() {
    let truth =
        StudentT::new(&[4.0, 4.0], Gaussian::spherical(&[[0.0], [8.0]], &[1.0, 1.0]).unwrap())
            .unwrap();
    let mut beyond = 0;
    for seed in 0..6 {
        let simulated = lasting(truth.clone()).simulate(3000, &mut rng(seed));
        let start = StudentT::new(
            &[10.0, 10.0],
            Gaussian::spherical(&[[1.0], [6.0]], &[2.0, 2.0]).unwrap(),
        )
        .unwrap();
        let options = LearningOptions::default().with_iterations(300).with_tolerance(1e-4);
        let learned = lasting(start).learn(&[simulated.observations()], &options).unwrap();
        let found = learned.model().likelihood();
        for state in 0..2 {
            let count = simulated.states().iter().filter(|s| **s == state).count() as f64;
            // Information of a t about its mean: (ν + 1) / ((ν + 3) s).
            let error = (7.0 / 5.0 / count).sqrt();
            let off = found.gaussian().means()[state][0] - truth.gaussian().means()[state][0];
            assert!(off.abs() < 6.0 * error);
            beyond += usize::from(off.abs() > 3.0 * error);
            assert!((2.5..8.0).contains(&found.degrees()[state]), "{:?}", found.degrees());
        }
    }
    assert!(beyond <= 2, "{beyond} of 12");
}

#[test]
fn fixed_degrees_and_counts() {
    let family = StudentT::new(
        &[3.0, 5.0],
        Gaussian::full(&[[0.0, 0.0]; 2], &[[1.0, 0.0, 0.0, 1.0]; 2]).unwrap(),
    )
    .unwrap();
    assert_eq!(family.free_parameters(), 4 + 6 + 2);
    let fixed = family.clone().with_fixed_degrees();
    assert_eq!(fixed.free_parameters(), 4 + 6);
    let (rows, weights) = (noisy_rows(20, 2, 1), vec![vec![0.5, 0.5]; 20]);
    assert_eq!(reestimated(&fixed, &rows, &weights, 0.0).unwrap().degrees(), [3.0, 5.0]);
    let learned = reestimated(&family, &rows, &weights, 0.0).unwrap();
    assert_ne!(learned.degrees(), [3.0, 5.0]);
    let none = reestimated(&family, &rows, &vec![vec![1.0, 0.0]; 20], 0.0).unwrap();
    assert_eq!((none.degrees()[1], none.gaussian().mean(1)), (5.0, family.gaussian().mean(1)));
    let other = learned.reordered(&[1, 0]);
    let y = [0.4, -2.0];
    assert_eq!(log_density(&other, 0, &y), log_density(&learned, 1, &y));
}

#[test]
fn errors_name_the_place() {
    let text = |result: Result<StudentT, EmissionError>| result.unwrap_err().to_string();
    assert_eq!(
        text(StudentT::new(
            &[1.0, 0.0],
            Gaussian::spherical(&[[0.0], [1.0]], &[1.0, 1.0]).unwrap()
        )),
        "the degrees of freedom of state 1 is 0, expected a finite value of at least 0.01"
    );
    assert_eq!(
        text(StudentT::new(&[1.0], Gaussian::spherical(&[[0.0], [1.0]], &[1.0, 1.0]).unwrap())),
        "the list of degrees of freedom has 1 values, expected 2"
    );
    let family = StudentT::new(&[1.0], Gaussian::spherical(&[[0.0]], &[1.0]).unwrap()).unwrap();
    assert!(refused(&family, &[f64::NAN]).contains("with_missing"));
    let same = reestimated(&family, &[vec![1.0]], &[vec![1.0]], 0.0).unwrap_err().to_string();
    assert!(same.contains("the variance of state 0 cannot be estimated"), "{same}");
}

#[cfg(feature = "serde")]
#[test]
fn stored_to_the_bit() {
    let numbers: Vec<f64> = (0..40).map(|i| (f64::from(i) * 0.7).cos()).collect();
    for kind in TYPES {
        let prior = GaussianPrior::new(2).unwrap().with_mean(0.1, &[0.2, 0.3]).unwrap();
        let settings = |family: Gaussian| family.with_missing().with_prior(prior).unwrap();
        let family = family(kind, [3, 2], &numbers, settings).with_fixed_degrees();
        let text = serde_json::to_string(&family).unwrap();
        let read: StudentT = serde_json::from_str(&text).unwrap();
        assert_eq!(format!("{read:?}"), format!("{family:?}"));
    }
}

/// Outliers with almost no weight, but squares that make up for it.
#[test]
fn outliers_of_any_size_count_once() {
    let (nu, near) = (0.5, [0.5, -0.25, 1.5, 0.125]);
    for far in [1e6, 1e12, -1e100, 1e150] {
        for kind in TYPES {
            for place in 0..5 {
                let mut rows: Vec<Vec<f64>> = near.iter().map(|y| vec![*y]).collect();
                rows.insert(place, vec![far]);
                let start = Gaussian::new(kind, &[[0.0]], &[[1.0]]).unwrap();
                let start = StudentT::new(&[nu], start).unwrap().with_fixed_degrees();
                let learned = reestimated(&start, &rows, &vec![vec![1.0]; 5], 0.0).unwrap();

                let weight = |y: f64| (nu + 1.0) / (nu + y * y);
                let total: f64 = near.iter().map(|y| weight(*y)).sum();
                let mean = (near.iter().map(|y| weight(*y) * y).sum::<f64>() + weight(far) * far)
                    / (total + weight(far));
                let squares = near.iter().map(|y| weight(*y) * (y - mean).powi(2));
                let scale = (squares.sum::<f64>() + weight(far) * (far - mean).powi(2)) / 5.0;
                let learned = learned.gaussian();
                let found = (learned.means()[0][0], learned.covariances()[0][0]);
                let text = format!("{far} at {place}, {kind:?}: {found:?}, not {mean} and {scale}");
                assert!((found.0 - mean).abs() < 1e-12, "{text}");
                assert!((found.1 / scale - 1.0).abs() < 1e-12, "{text}");
            }
        }
    }
}
