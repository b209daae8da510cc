//! Moments of drawn observations.

use rand_chacha::ChaCha8Rng;
use wayfix::likelihood::SampleObservation;
use wayfix_learn::{
    Bernoulli, Beta, Binomial, Exponential, Gamma, LogNormal, Multinomial, NegativeBinomial,
    Poisson, VonMises, VonMisesFisher, Weibull, WrappedCauchy,
};

use crate::kit::rng;

const DRAWS: usize = 20_000;

/// The mean of a function of drawn observations is within five standard errors of its expectation,
/// for several seeds.
#[track_caller]
fn assert_mean<B: SampleObservation<Sample = Vec<f64>>>(
    family: &B,
    expected: f64,
    value: impl Fn(&[f64]) -> f64,
) {
    for seed in 0..4 {
        let mut rng: ChaCha8Rng = rng(seed);
        let values: Vec<f64> = (0..DRAWS).map(|_| value(&family.sample(0, &mut rng))).collect();
        let mean = values.iter().sum::<f64>() / DRAWS as f64;
        let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / DRAWS as f64;
        let error = (square / DRAWS as f64).sqrt();
        let distance = (mean - expected).abs();
        assert!(
            distance <= 5.0 * error + 1e-12 * expected.abs(),
            "{mean} ± {error}, expected {expected}"
        );
    }
}

/// Second moment around a value.
fn around(middle: f64) -> impl Fn(&[f64]) -> f64 {
    move |y| (y[0] - middle).powi(2)
}

#[test]
fn moments_are_those_of_the_distribution() {
    let first = |y: &[f64]| y[0];
    assert_mean(&Bernoulli::family(&[[0.3]]).unwrap(), 0.3, first);
    assert_mean(&Bernoulli::family(&[[1.0]]).unwrap(), 1.0, first);
    for rate in [0.0, 0.4, 7.0, 5e4] {
        let family = Poisson::family(&[[rate]]).unwrap();
        assert_mean(&family, rate, first);
        assert_mean(&family, rate, around(rate));
    }
    for (shape, scale) in [(0.3_f64, 2.0_f64), (1.0, 1.0), (400.0, 1e-3)] {
        let family = Gamma::family(&[[shape]], &[[scale]]).unwrap();
        assert_mean(&family, shape * scale, first);
        assert_mean(&family, shape * scale * scale, around(shape * scale));
    }
    let family = Exponential::family(&[[0.25]]).unwrap();
    assert_mean(&family, 4.0, first);
    assert_mean(&family, 16.0, around(4.0));
    for (trials, p) in [(1, 0.0), (7, 0.4), (u32::MAX, 0.7), (u32::MAX, 1e-9)] {
        let family = Binomial::family(&[trials], &[[p]]).unwrap();
        let mean = p * f64::from(trials);
        assert_mean(&family, mean, first);
        assert_mean(&family, mean * (1.0 - p), around(mean));
    }
    for (mean, dispersion) in [(0.0, 2.0), (0.4, 0.0), (7.0, 3.0), (5e4, 0.2), (3.0, 1e-320)] {
        let family = NegativeBinomial::family(&[[mean]], &[[dispersion]]).unwrap();
        assert_mean(&family, mean, first);
        assert_mean(&family, mean + dispersion * mean * mean, around(mean));
    }
    // Γ(1.5) and Γ(2).
    let family = Weibull::family(&[[2.0]], &[[3.0]]).unwrap();
    assert_mean(&family, 1.5 * std::f64::consts::PI.sqrt(), first);
    assert_mean(&family, 9.0, |y| y[0] * y[0]);
    for (a, b) in [(0.5, 0.2), (2.0, 6.0), (1e6, 3e6)] {
        let (family, mean) = (Beta::family(&[[a]], &[[b]]).unwrap(), a / (a + b));
        assert_mean(&family, mean, first);
        assert_mean(&family, mean * (1.0 - mean) / (a + b + 1.0), around(mean));
    }
    let family = LogNormal::family(&[[1.0]], &[[0.5]]).unwrap();
    assert_mean(&family, 1.0, |y| y[0].ln());
    assert_mean(&family, 0.25, |y| (y[0].ln() - 1.0).powi(2));
}

#[test]
fn multinomial_moments_are_those_of_the_distribution() {
    let family = Multinomial::new(&[[0.2, 0.0, 0.5, 0.3]]).unwrap().with_trials(10);
    assert_mean(&family, 10.0, |y| y.iter().sum());
    for (outcome, mean) in [2.0, 0.0, 5.0, 3.0].into_iter().enumerate() {
        assert_mean(&family, mean, |y| y[outcome]);
        let variance = mean * (1.0 - mean / 10.0);
        assert_mean(&family, variance, |y| (y[outcome] - mean).powi(2));
    }
    assert_mean(&family, -10.0 * 0.2 * 0.5, |y| (y[0] - 2.0) * (y[2] - 5.0));
}

/// I_1 / I_0 and I_{3/2} / I_{1/2} = coth κ − 1 / κ.
#[test]
fn mean_vectors_are_those_of_the_distribution() {
    let known = [
        (0.0, 0.0),
        (0.5, 0.242_499_612_645_019_3),
        (5.0, 0.893_383_137_035_666_8),
        (1e9, 1.0 - 5e-10),
    ];
    for (concentration, length) in known {
        let family = VonMises::family(&[[3.0]], &[[concentration]]).unwrap();
        assert_mean(&family, length, |y| (y[0] - 3.0).cos());
        assert_mean(&family, 0.0, |y| (y[0] - 3.0).sin());
        assert_mean(&family, 1.0, |y| f64::from(u8::from(y[0].abs() <= std::f64::consts::PI)));
    }
    for length in [0.0, 0.5, 0.95] {
        let family = WrappedCauchy::family(&[[3.0]], &[[length]]).unwrap();
        assert_mean(&family, length, |y| (y[0] - 3.0).cos());
        assert_mean(&family, 0.0, |y| (y[0] - 3.0).sin());
        assert_mean(&family, length * length, |y| (2.0 * (y[0] - 3.0)).cos());
        assert_mean(&family, 1.0, |y| f64::from(u8::from(y[0].abs() <= std::f64::consts::PI)));
    }
    for concentration in [0.1_f64, 1.0, 30.0, 1e12] {
        let family = VonMisesFisher::new(&[[0.48, 0.64, 0.6]], &[concentration]).unwrap();
        let length = concentration.tanh().recip() - concentration.recip();
        assert_mean(&family, 1.0, |y| y.iter().map(|y| y * y).sum());
        assert_mean(&family, length, |y| 0.48 * y[0] + 0.64 * y[1] + 0.6 * y[2]);
        assert_mean(&family, 0.0, |y| 0.8 * y[0] - 0.6 * y[1]);
        assert_mean(&family, 0.6 * length, |y| y[2]);
    }
    // All directions in 40 dimensions are equally likely.
    let mut mean = vec![0.0; 40];
    mean[7] = 1.0;
    let family = VonMisesFisher::new(&[mean], &[0.0]).unwrap();
    assert_mean(&family, 0.0, |y| y[7]);
    assert_mean(&family, 1.0 / 40.0, |y| y[7] * y[7]);
    assert_mean(&family, 1.0 / 40.0, |y| y[0] * y[0]);
}
