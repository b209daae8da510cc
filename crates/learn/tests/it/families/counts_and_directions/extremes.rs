//! Large and hostile numbers, and observations that determine no parameters.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use wayfix::inference::{LearnError, LearningOptions};
use wayfix::{Belief, DenseTransition, Hmm, Prior};
use wayfix_learn::{
    Bernoulli, Beta, Binomial, EmissionError, Exponential, Gamma, LogNormal, Multinomial,
    NegativeBinomial, Poisson, VonMises, VonMisesFisher, Weibull, WrappedCauchy,
};

use super::kit::{Family, fit, for_all_families, try_density};
use crate::kit::{cases_of, rng};

for_all_families! { nothing_panics_and_nothing_is_nan }

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::NEG_INFINITY),
        Just(-1.0),
        Just(-0.0),
        Just(0.0),
        Just(1.0),
        Just(1.0),
        Just(2.0),
        Just(0.6),
        Just(0.8),
        Just(f64::from_bits(1)),
        Just(f64::MAX),
        Just(1e150),
        Just(1e-150),
        Just(9_007_199_254_740_992.0),
        -3.0..3.0,
        (0..5_u8).prop_map(f64::from),
    ]
}

/// Families of any kind with hostile parameters, and observations of any size.
fn nothing_panics_and_nothing_is_nan<B: Family>() {
    let rows = vec(vec(number(), 3), 1..6);
    let input = (rows, vec(vec(0.0..1.0, 3), 1..3), any::<bool>(), any::<bool>(), 0.0..1.0);
    TestRunner::new(cases_of(2000))
        .run(&input, |(mut rows, states, missing, alike, prior)| {
            let n = states.len();
            let starts: Vec<_> = states.iter().map(|state| B::parameters(state)).collect();
            let mut family = B::build(&starts);
            let width = family.sample(0, &mut rng(0)).len();
            rows.iter_mut().for_each(|row| row.truncate(width));
            if missing {
                family = family.missing();
            }
            if prior < 0.3 {
                family = family.and_prior(&B::parameters(&[0.5; 3]), 0.1 + prior);
            }
            if alike {
                let first = family.sample(0, &mut rng(1));
                rows.iter_mut().for_each(|row| row.clone_from(&first));
            }
            let mut valid = Vec::new();
            for row in rows {
                if let Ok(log) = try_density(&family, n - 1, &row) {
                    prop_assert!(!log.is_nan());
                    valid.push(row);
                }
            }
            let row = vec![1.0 / n as f64; n];
            let transition = DenseTransition::from_rows(&vec![row; n]).unwrap();
            let start = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
            let hmm = Hmm::new(start, transition, family).unwrap();
            if let Ok(learned) = hmm.learn(&[valid.clone()], &LearningOptions::default()) {
                prop_assert!(learned.objectives().iter().all(|objective| !objective.is_nan()));
                let parameters = learned.model().likelihood().read();
                prop_assert!(parameters.iter().all(|p| p.is_finite()), "{parameters:?}");
                for state in 0..n {
                    let drawn = learned.model().likelihood().sample(state, &mut rng(2));
                    prop_assert!(drawn.iter().all(|y| y.is_finite()));
                    // Learning may end at a distribution narrower than the spacing of doubles,
                    // where its own draw has a density that no diagonal holds: the error that says
                    // so.
                    let density = try_density(learned.model().likelihood(), state, &drawn);
                    let is_right = match &density {
                        Ok(_) => true,
                        Err(error) => format!("{error:?}").contains("-1e301"),
                    };
                    prop_assert!(is_right, "{drawn:?}: {density:?}");
                }
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn hostile_parameters_are_errors_or_valid() {
    TestRunner::new(cases_of(4000))
        .run(&(number(), number(), number()), |(a, b, y)| {
            let check = |log: Result<f64, _>| -> Result<(), TestCaseError> {
                if let Ok(log) = log {
                    prop_assert!(!f64::is_nan(log));
                }
                Ok(())
            };
            if let Ok(family) = Bernoulli::family(&[[a]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = Poisson::family(&[[a]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            for trials in [1, 5, u32::MAX] {
                if let Ok(family) = Binomial::family(&[trials], &[[a]]) {
                    check(try_density(&family, 0, &[y]))?;
                }
            }
            if let Ok(family) = Exponential::family(&[[a]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = NegativeBinomial::family(&[[a]], &[[b]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = Gamma::family(&[[a]], &[[b]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = Weibull::family(&[[a]], &[[b]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = Beta::family(&[[a]], &[[b]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = WrappedCauchy::family(&[[a]], &[[b]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = LogNormal::family(&[[a]], &[[b]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = VonMises::family(&[[a]], &[[b]]) {
                check(try_density(&family, 0, &[y]))?;
            }
            if let Ok(family) = VonMisesFisher::new(&[[0.6, 0.8]], &[b]) {
                check(try_density(&family, 0, &[a, y]))?;
                check(try_density(&family, 0, &[-0.6, 0.8]))?;
            }
            if let Ok(family) = Multinomial::new(&[[a, 1.0 - a]]) {
                check(try_density(&family, 0, &[b, y]))?;
            }
            Ok(())
        })
        .unwrap();
}

/// Observations far from 0, whose spread is a billionth of their size.
#[test]
fn small_spreads_at_large_values_are_found() {
    let offsets = [-1.5, -0.5, 0.25, 1.75];
    let square: f64 = offsets.iter().map(|x| x * x).sum::<f64>() / 4.0;
    let seen: Vec<_> = offsets.iter().map(|x| (vec![1e6 + 1e-3 * x], 1.0)).collect();
    let learned = fit(&Gamma::family(&[[1e12]], &[[1e-6]]).unwrap(), &seen, 0.0);
    let gamma = learned.component(0, 0).unwrap();
    let variance = gamma.shape() * gamma.scale().powi(2);
    assert!((variance / (1e-6 * square) - 1.0).abs() < 1e-5, "{variance}");
    let learned = fit(&LogNormal::family(&[[1e6_f64.ln()]], &[[1e-9]]).unwrap(), &seen, 0.0);
    let variance = learned.component(0, 0).unwrap().deviation().powi(2);
    assert!((variance / (1e-18 * square) - 1.0).abs() < 1e-5, "{variance}");

    // A variance σ² of angles is a concentration of 1 / σ².
    let seen: Vec<_> = offsets.iter().map(|x| (vec![1.0 + 1e-6 * x], 1.0)).collect();
    let learned = fit(&VonMises::family(&[[1.0]], &[[1e12]]).unwrap(), &seen, 0.0);
    let variance = learned.component(0, 0).unwrap().concentration().recip();
    assert!((variance / (1e-12 * square) - 1.0).abs() < 1e-5, "{variance}");
    let vector = |x: &f64| (vec![f64::sin(1e-6 * x), f64::cos(1e-6 * x)], 1.0);
    let seen: Vec<_> = offsets.iter().map(vector).collect();
    let learned = fit(&VonMisesFisher::new(&[[0.0, 1.0]], &[1e12]).unwrap(), &seen, 0.0);
    let variance = learned.concentrations()[0].recip();
    assert!((variance / (1e-12 * square) - 1.0).abs() < 1e-5, "{variance}");
}

/// The concentration solves its equation in many dimensions, against closed forms: in three
/// dimensions the mean length is coth κ − 1 / κ.
#[test]
fn concentrations_solve_their_equation() {
    for concentration in [1e-3_f64, 0.4, 7.0, 100.0, 1e6] {
        // Two directions whose mean vector has the length that is expected.
        let rest = if concentration < 0.01 {
            1.0 - concentration / 3.0 + concentration.powi(3) / 45.0
        } else {
            1.0 - concentration.tanh().recip() + concentration.recip()
        };
        let (cos, sin) = (1.0 - rest, (rest * (2.0 - rest)).sqrt());
        let seen = [(vec![sin, 0.0, cos], 1.0), (vec![-sin, 0.0, cos], 1.0)];
        let start = VonMisesFisher::new(&[[0.0, 0.0, 1.0]], &[1.0]).unwrap();
        let found = fit(&start, &seen, 0.0).concentrations()[0];
        assert!((found / concentration - 1.0).abs() < 1e-9, "{found} for {concentration}");
    }
    // In d dimensions it is about (d − 1) / 2 (1 − length) for large ones.
    for dimensions in [2_usize, 10, 500, 20_000] {
        let angle = 1e-5_f64;
        let side = |sign: f64| {
            let mut y = vec![0.0; dimensions];
            (y[0], y[1]) = (sign * angle.sin(), angle.cos());
            (y, 1.0)
        };
        let mut mean = vec![0.0; dimensions];
        mean[1] = 1.0;
        let start = VonMisesFisher::new(&[mean], &[1.0]).unwrap();
        let found = fit(&start, &[side(1.0), side(-1.0)], 0.0).concentrations()[0];
        let expected = (dimensions as f64 - 1.0) / (angle * angle);
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} in {dimensions}");
    }
}

/// The error names the state, and a prior helps.
#[test]
fn a_spread_that_is_not_determined_is_an_error() {
    fn assert_too_few<B: Family>(
        start: B,
        y: &[f64],
        component: Option<usize>,
        what: &'static str,
    ) {
        let mut sums = start.statistics();
        start.add(&mut sums, y, &[0.0, 0.75]);
        start.add(&mut sums, y, &[0.0, 0.25]);
        let error = start.maximize(&sums, 0.0).unwrap_err();
        let text = error.to_string();
        let at = component.map_or(String::new(), |c| format!(", component {c},"));
        let reason = "they are all alike, which leaves the spread undetermined; give a prior";
        let expected =
            EmissionError::TooFew { state: Some(1), component, what, weight: 1.0, reason };
        assert_eq!(*error.downcast::<EmissionError>().unwrap(), expected);
        assert_eq!(
            text,
            format!(
                "the {what} of state 1{at} cannot be estimated from 1 expected observations: {reason}"
            )
        );
        let start = start.and_prior(&B::parameters(&[0.5; 3]), 0.1);
        assert!(start.maximize(&sums, 0.0).is_ok());
    }
    let gamma = Gamma::family(&[[2.0], [3.0]], &[[1.0], [1.0]]).unwrap();
    assert_too_few(gamma, &[0.7], Some(0), "shape");
    let log_normal = LogNormal::family(&[[2.0], [3.0]], &[[1.0], [1.0]]).unwrap();
    assert_too_few(log_normal, &[0.7], Some(0), "standard deviation of logarithms");
    let weibull = Weibull::family(&[[2.0], [3.0]], &[[1.0], [1.0]]).unwrap();
    assert_too_few(weibull, &[0.7], Some(0), "shape");
    let beta = Beta::family(&[[2.0], [3.0]], &[[1.0], [1.0]]).unwrap();
    assert_too_few(beta, &[0.7], Some(0), "shapes");
    let turns = WrappedCauchy::family(&[[2.0], [3.0]], &[[0.5], [0.2]]).unwrap();
    assert_too_few(turns, &[0.7], Some(0), "concentration");
    let angles = VonMises::family(&[[2.0], [3.0]], &[[1.0], [1.0]]).unwrap();
    assert_too_few(angles, &[0.7], Some(0), "concentration");
    let vectors = VonMisesFisher::new(&[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], &[1.0, 2.0]).unwrap();
    assert_too_few(vectors, &[0.0, 0.6, 0.8], None, "concentration");
}

/// Two equally unlikely moves, among counts of 1e15: their logarithms have no digit left after the
/// decimal point, but the moves still sum to one.
#[test]
fn counts_of_1e15_beside_small_ones_leave_moves_that_sum_to_one() {
    let rows = [[0.875, 1.0, 1.0], [3e-5, 0.0, 0.0], [0.12497, 0.0, 0.0]];
    let mut checked = 0;
    for rate in (0..40).map(|k| 7.5e14 + 0.125 * f64::from(k)) {
        let hmm = Hmm::new(
            Prior::AtFirstObservation(Belief::uniform(3).unwrap()),
            DenseTransition::from_rows(&rows).unwrap(),
            Poisson::family(&[[rate], [2.5e-29], [1e-29]]).unwrap(),
        )
        .unwrap();
        for second in [0.0, 1.0, 3.0] {
            let seen = [[2.0], [second], [1e15], [0.0], [1.0]];
            let (expected, failed) = hmm.expectations(&[&seen[..2], &seen[..], &seen[3..]]);
            assert!(failed.is_empty(), "{rate}, {second}: {}", failed[0]);
            let moves: f64 = expected.moves().moves().map(|m| m.weight).sum();
            assert!((moves - 6.0).abs() < 1e-9, "{rate}, {second}: {moves}");
            checked += 1;
        }
    }
    assert_eq!(checked, 120);
}

/// A prior with so little weight that a probability of 0 is learned, which the prior rules out.
#[test]
fn priors_that_are_lost_in_rounding_are_an_error() {
    let prior = Bernoulli::family(&[[0.5]]).unwrap();
    let family = Bernoulli::family(&[[0.3], [0.6]]).unwrap().with_prior(prior, 5e-324).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let transition = DenseTransition::from_rows(&[[0.8, 0.3], [0.2, 0.7]]).unwrap();
    let hmm = Hmm::new(prior, transition, family).unwrap();
    let error = hmm.learn(&[vec![vec![0.0]; 9]], &LearningOptions::default()).unwrap_err();
    assert!(matches!(error, LearnError::LogPrior { iteration: 1, .. }), "{error}");
}
