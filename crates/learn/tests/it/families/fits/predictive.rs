//! Forecasts of observations against likelihoods, their own tails, and draws.

use std::sync::Arc;

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{Belief, DenseTransition, Filter, Hmm, Prior, TableLikelihood};
use wayfix_learn::{Gamma, Gaussian, Independent, Poisson, Predictive, StudentT, ZeroInflated};

use super::{FURTHEST, counts, distance_from_uniform};
use crate::kit::{cases, cases_of, close, distribution, prior, rng, says, stochastic};

type Model = Hmm<DenseTransition, Independent<ZeroInflated<Gamma>>>;

/// Rain per day: none, or some.
fn rain() -> impl Strategy<Value = (Model, Vec<[f64; 1]>)> {
    (1..=3_usize, 0..=5_usize).prop_flat_map(|(n, steps)| {
        let part = (0.0..0.9_f64, 0.3..9.0_f64, 0.2..20.0_f64);
        let amount = prop_oneof![1 => Just([0.0]), 2 => (0.01..60.0_f64).prop_map(|y| [y])];
        let parts = (distribution(false, n), stochastic(false, n), any::<bool>(), vec(part, n));
        (parts, vec(amount, steps)).prop_map(move |((start, moves, at_first, parts), seen)| {
            let zeros: Vec<[f64; 1]> = parts.iter().map(|part| [part.0]).collect();
            let amounts = parts.iter().map(|part| [Gamma::new(part.1, part.2).unwrap()]);
            let amounts: Vec<[Gamma; 1]> = amounts.collect();
            let hmm = Hmm::new(
                prior(&start, at_first),
                DenseTransition::from_rows(&moves).unwrap(),
                ZeroInflated::family(&zeros, &amounts).unwrap(),
            );
            (hmm.unwrap(), seen)
        })
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn densities_are_ratios_of_likelihoods((hmm, seen) in rain(), y in 0.01..90.0_f64) {
        let mut filter = hmm.filter();
        let is_possible = seen.iter().all(|y| filter.step(y).is_ok());
        if is_possible {
            for y in [0.0, y] {
                let found = Predictive::ahead(&filter, 1, 0).unwrap().log_density(y);
                let before = hmm.log_likelihood(&seen).unwrap();
                if let Ok(after) = hmm.log_likelihood(&[&seen[..], &[[y]]].concat()) {
                    close(found, after - before, 1e-10, 1.0)?;
                } else {
                    prop_assert_eq!(found, f64::NEG_INFINITY);
                }
            }
        }
    }
}

proptest! {
    // 64 evaluations of the tails for each quantile.
    #![proptest_config(cases_of(200))]

    #[test]
    fn quantiles_invert_tails((hmm, seen) in rain(), p in 1e-9..1.0_f64) {
        let mut filter = hmm.filter();
        let is_possible = seen.iter().all(|y| filter.step(y).is_ok());
        for ahead in [0, 2] {
            let next = Predictive::ahead(&filter, ahead, 0).unwrap();
            prop_assert!(!is_possible || next.belief() == &filter.forecast(ahead).unwrap());
            for p in [p, 1.0 - p, 1e-12, 1.0 - 1e-12] {
                if p >= 1.0 {
                    continue;
                }
                let y = next.quantile(p).unwrap();
                let (tails, lower) = (next.tails(y), next.tails(y.next_down()));
                if p <= 0.5 {
                    prop_assert!(tails.up_to() >= p && lower.up_to() <= p, "{y}: {tails:?}");
                } else {
                    prop_assert!(tails.above <= 1.0 - p && lower.above >= 1.0 - p, "{y}: {tails:?}");
                }
                // Within the density, single numbers have no probability.
                if y > 0.0 {
                    close(tails.up_to(), p, 1e-9, 1e-14)?;
                }
            }
        }
    }
}

#[test]
fn draws_are_distributed_so() {
    let hmm = counts();
    let mut live = hmm.filter();
    live.step(&[4.0]).unwrap();
    let (next, mut random) = (Predictive::ahead(&live, 2, 0).unwrap(), rng(3));
    let draw = |_| {
        let y = next.sample(&mut random).unwrap();
        next.tails(y).randomized(&mut random).uniform()
    };
    let distance = distance_from_uniform((0..20_000).map(draw).collect());
    assert!(distance < FURTHEST, "{distance}");

    // For a filter that owns its model, and one of two components.
    let hmm = Arc::new(
        Hmm::new(
            Prior::AtFirstObservation(Belief::uniform(2).unwrap()),
            DenseTransition::from_rows(&[[0.9, 0.3], [0.1, 0.7]]).unwrap(),
            StudentT::new(
                &[3.0, 8.0],
                Gaussian::diagonal(&[[0.0, 5.0], [2.0, 9.0]], &[[1.0, 4.0], [9.0, 1.0]]).unwrap(),
            )
            .unwrap(),
        )
        .unwrap(),
    );
    let mut filter = Filter::new(hmm);
    filter.step(&[0.5, 6.0]).unwrap();
    for component in 0..2 {
        let (next, mut random) = (Predictive::ahead(&filter, 1, component).unwrap(), rng(4));
        let draws = (0..20_000).map(|_| next.tails(next.sample(&mut random).unwrap()).uniform());
        let distance = distance_from_uniform(draws.collect());
        assert!(distance < FURTHEST, "{distance}");
        // The density is the slope of the tails.
        for y in [-3.0, 0.7, 6.0, 11.0] {
            let slope = (next.tails(y + 1e-4).below - next.tails(y - 1e-4).below) / 2e-4;
            assert!((slope - next.log_density(y).exp()).abs() < 1e-8, "{y}");
        }
    }
}

#[test]
fn symbols() {
    let table = TableLikelihood::from_rows(&[[0.5, 0.0, 0.5], [0.25, 0.5, 0.25]]).unwrap();
    let next = Predictive::new(&table, Belief::uniform(2).unwrap(), 0).unwrap();
    let found: Vec<f64> = [0.0, 1.0, 2.0].map(|y| next.log_density(y).exp()).to_vec();
    assert_eq!(found, [0.375, 0.25, 0.375]);
    assert_eq!(next.log_density(0.5), f64::NEG_INFINITY);
    assert_eq!(
        [0.3, 0.375, 0.376, 0.625, 0.626].map(|p| next.quantile(p).unwrap()),
        [0.0, 0.0, 1.0, 1.0, 2.0]
    );
}

#[test]
fn hostile_numbers() {
    let hmm = counts();
    let filter = hmm.filter();
    let next = Predictive::ahead(&filter, 1, 0).unwrap();
    for p in [0.0, 1.0, -0.5, 1.5, f64::NAN, f64::INFINITY] {
        let found = next.quantile(p).unwrap_err().to_string();
        assert!(found.ends_with(", expected a value above 0 and below 1"), "{found}");
    }
    assert_eq!(next.quantile(5e-324).unwrap(), 0.0);
    assert!(next.quantile(1.0 - f64::EPSILON).unwrap() > 20.0);
    for y in [f64::NAN, f64::INFINITY] {
        assert_eq!(next.log_density(y), f64::NEG_INFINITY);
        let tails = next.tails(y);
        assert!((tails.below - 1.0).abs() < 1e-12 && tails.at == 0.0 && tails.above == 0.0);
    }
    assert_eq!(next.log_density(-1.0), f64::NEG_INFINITY);
    assert_eq!(next.tails(f64::NEG_INFINITY).below, 0.0);
    says(
        Predictive::ahead(&filter, 3, 1),
        "step 3 has no valid likelihood: the sensor failed: there is no component 1, observations have 1",
    );
    let error = Predictive::new(hmm.likelihood(), Belief::uniform(3).unwrap(), 0).unwrap_err();
    assert!(error.to_string().contains('3'), "{error}");
    let family: &Independent<Poisson> = hmm.likelihood();
    assert!(Predictive::new(&family, Belief::uniform(2).unwrap(), 0).is_ok());
}
