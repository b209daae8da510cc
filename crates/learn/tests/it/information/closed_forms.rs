//! One state: standard errors from textbooks.

use wayfix::inference::{FreeParameters, LearningOptions};
use wayfix::likelihood::LearnLikelihood;
use wayfix::{DenseTransition, Hmm};
use wayfix_learn::StandardErrors;
use wayfix_learn::{
    Bernoulli, Exponential, Gaussian, Independent, LinearRegression, LogNormal, Multinomial,
    Poisson, Rows, VonMisesFisher,
};

use super::{near, uniform};

/// Learns a family from one sequence, and reads numbers.
fn learned<B>(
    family: B,
    rows: &[f64],
    width: usize,
    read: impl Fn(&B) -> Vec<f64> + Sync,
) -> StandardErrors
where
    B: LearnLikelihood<Observation = [f64], Statistics: Sync>
        + FreeParameters
        + Clone
        + Sync
        + Send,
{
    let one = DenseTransition::from_rows(&[[1.0]]).unwrap();
    let hmm = Hmm::new(uniform(1), one, family).unwrap();
    let rows = [Rows::new(rows, width).unwrap()];
    let options = LearningOptions::default();
    let learned = hmm.learn(&rows, &options).unwrap().into_model();
    StandardErrors::from_likelihood(&learned, &rows, &options, |hmm| read(hmm.likelihood()))
        .unwrap()
}

const PRECISION: f64 = 1e-7;

#[test]
fn of_distributions_with_one_parameter() {
    let counts = [3.0, 0.0, 5.0, 2.0, 2.0, 4.0, 1.0, 7.0];
    let found = learned(Poisson::family(&[[1.0]]).unwrap(), &counts, 1, |family| {
        vec![family.component(0, 0).unwrap().rate()]
    });
    near(found.values()[0], 3.0, 1e-12);
    near(found.errors()[0], (3.0_f64 / 8.0).sqrt(), PRECISION);
    assert_eq!(found.at_bound(), 0);

    let times = [0.2, 1.7, 0.4, 3.3, 0.9];
    let rate = 5.0 / times.iter().sum::<f64>();
    let found = learned(Exponential::family(&[[1.0]]).unwrap(), &times, 1, |family| {
        vec![family.component(0, 0).unwrap().rate()]
    });
    near(found.errors()[0], rate / 5.0_f64.sqrt(), PRECISION);

    let events = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let read = |family: &Independent<Bernoulli>| {
        let p = family.component(0, 0).unwrap().probability();
        vec![p, 1.0 - p, (p / (1.0 - p)).ln()]
    };
    let found = learned(Bernoulli::family(&[[0.5]]).unwrap(), &events, 1, read);
    let error = (0.3_f64 * 0.7 / 10.0).sqrt();
    near(found.errors()[0], error, PRECISION);
    near(found.errors()[1], error, PRECISION);
    near(found.covariance(0, 1).unwrap(), -error * error, PRECISION);
    near(found.errors()[2], error / 0.21, PRECISION);
    assert_eq!((found.covariance(0, 3), found.covariance(3, 0)), (None, None));
}

/// In any unit, and at any distance from 0.
#[test]
fn of_gaussians() {
    let values = [1.0, 2.5, -0.5, 0.3, 4.0, 1.1, 2.0];
    for (unit, offset) in [(1.0, 0.0), (1e-9, 0.0), (1e9, 3.0), (1.0, 1e5)] {
        let rows = values.map(|value| unit * (value + offset));
        let family = Gaussian::diagonal(&[[unit * offset]], &[[unit * unit]]).unwrap();
        let read =
            |family: &Gaussian| vec![family.mean(0).unwrap()[0], family.covariance(0).unwrap()[0]];
        let found = learned(family, &rows, 1, read);
        let variance = found.values()[1];
        // A mean of 1e5 deviations leaves eleven digits of a deviation.
        let precision = if offset == 1e5 { 1e-6 } else { PRECISION };
        near(found.errors()[0], (variance / 7.0).sqrt(), precision);
        near(found.errors()[1], variance * (2.0_f64 / 7.0).sqrt(), precision);
        let covariance = found.covariance(0, 1).unwrap();
        assert!(covariance.abs() < 1e-6 * found.errors()[0] * found.errors()[1]);
    }
}

/// The covariance of S_ij and S_kl is (σ_ik σ_jl + σ_il σ_jk) / n.
#[test]
fn of_a_full_covariance() {
    let rows = [
        [1.0, 2.0, 0.0],
        [0.5, 1.0, 1.5],
        [-1.0, -1.5, 0.2],
        [2.0, 3.0, -1.0],
        [0.3, 1.4, 0.8],
        [-0.7, 0.1, -0.4],
        [1.6, 1.5, 0.9],
        [0.0, -0.8, -1.2],
        [0.9, 0.2, 0.3],
    ];
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let family = Gaussian::full(&[[0.0; 3]], &[unit]).unwrap();
    let read = |family: &Gaussian| {
        [family.mean(0).unwrap().to_vec(), family.covariance(0).unwrap()].concat()
    };
    let found = learned(family, &rows.concat(), 3, read);
    let s = |i: usize, j: usize| found.values()[3 + 3 * i + j];
    for (at, other) in (0..9).flat_map(|at| (0..9).map(move |other| (at, other))) {
        let [i, j, k, l] = [at / 3, at % 3, other / 3, other % 3];
        let expected = (s(i, k) * s(j, l) + s(i, l) * s(j, k)) / 9.0;
        let size = found.errors()[3 + at] * found.errors()[3 + other];
        let covariance = found.covariance(3 + at, 3 + other).unwrap();
        assert!((covariance - expected).abs() < 1e-6 * size, "{covariance}, {expected}");
        if at < 3 && other < 3 {
            let covariance = found.covariance(at, other).unwrap();
            assert!((covariance - s(at, other) / 9.0).abs() < 1e-6 * size.max(1e-3));
        }
    }
}

#[test]
fn of_other_families() {
    // Logarithms have a normal distribution.
    let values = [1.0, 2.5, 0.5, 0.3, 4.0, 1.1];
    let read = |family: &Independent<LogNormal>| {
        let part = family.component(0, 0).unwrap();
        vec![part.mean(), part.deviation()]
    };
    let found = learned(LogNormal::family(&[[0.0]], &[[1.0]]).unwrap(), &values, 1, read);
    let deviation = found.values()[1];
    near(found.errors()[0], deviation / 6.0_f64.sqrt(), PRECISION);
    near(found.errors()[1], deviation / 12.0_f64.sqrt(), PRECISION);

    // Counts of several kinds, of 20 in all; one kind is never seen, and known.
    let rows = [[3.0, 2.0, 0.0], [4.0, 1.0, 0.0], [8.0, 2.0, 0.0]];
    let family = Multinomial::new(&[[0.3, 0.3, 0.4]]).unwrap();
    let found = learned(family, &rows.concat(), 3, |family| family.probabilities().concat());
    near(found.errors()[0], (0.75_f64 * 0.25 / 20.0).sqrt(), PRECISION);
    near(found.covariance(0, 1).unwrap(), -0.75 * 0.25 / 20.0, PRECISION);
    assert_eq!((found.errors()[2], found.at_bound()), (0.0, 1));

    // Least squares: σ² (X'X)⁻¹, of inputs whose sum is 0.
    let rows = [[-2.0, -3.1], [-1.0, -0.7], [0.0, 0.9], [1.0, 2.8], [2.0, 5.6]];
    let family = LinearRegression::diagonal(&[[1.0]], &[[0.0]], &[[1.0]]).unwrap();
    let read = |family: &LinearRegression| {
        let slope = family.coefficients(0).unwrap()[0];
        vec![slope, family.intercept(0).unwrap()[0], family.noise().covariance(0).unwrap()[0]]
    };
    let found = learned(family, &rows.concat(), 2, read);
    let variance = found.values()[2];
    near(found.errors()[0], (variance / 10.0).sqrt(), PRECISION);
    near(found.errors()[1], (variance / 5.0).sqrt(), PRECISION);
    near(found.errors()[2], variance * (2.0_f64 / 5.0).sqrt(), PRECISION);

    // In three dimensions the mean length of a resultant is coth κ − 1/κ = R, with R the length of
    // the sum over n: the information of κ is n (1 − R² − 2 R / κ), and that of either angle n κ R.
    let unit = |a: f64, b: f64| [a.cos() * b.cos(), a.sin() * b.cos(), b.sin()];
    let rows = [unit(0.1, 0.2), unit(-0.3, 0.1), unit(0.2, -0.4), unit(0.5, 0.3), unit(-0.2, -0.1)];
    let family = VonMisesFisher::new(&[[1.0, 0.0, 0.0]], &[5.0]).unwrap();
    let read = |family: &VonMisesFisher| {
        [family.means()[0].clone(), vec![family.concentrations()[0]]].concat()
    };
    let found = learned(family, &rows.concat(), 3, read);
    let kappa = found.values()[3];
    let length = 1.0 / kappa.tanh() - 1.0 / kappa;
    let information = 5.0 * (1.0 - length * length - 2.0 * length / kappa);
    near(found.errors()[3], information.sqrt().recip(), PRECISION);
    // Only along the sphere: the covariance of the direction is (I − μ μ') / (n κ R).
    for i in 0..3 {
        let expected = (1.0 - found.values()[i].powi(2)) / (5.0 * kappa * length);
        near(found.errors()[i], expected.sqrt(), 1e-6);
    }
}

/// Shares of 250 kinds: (p [the same] − p q) / n, to 2e-5, as rounding of 60,000 differences adds up.
#[test]
fn of_many_parameters() {
    let counts: Vec<f64> = (0..250).map(|k| f64::from(3 + k % 17)).collect();
    let n: f64 = counts.iter().sum();
    let family = Multinomial::new(&[vec![1.0 / 250.0; 250]]).unwrap();
    let found = learned(family, &counts, 250, |family| family.probabilities().concat());
    let p = found.values();
    for (i, j) in [(0, 0), (249, 249), (16, 16), (0, 249), (16, 33), (100, 7)] {
        let expected = (if i == j { p[i] } else { 0.0 } - p[i] * p[j]) / n;
        near(found.covariance(i, j).unwrap(), expected, 1e-4);
    }
}
