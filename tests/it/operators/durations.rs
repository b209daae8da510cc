//! Durations with parameters, and learning of dwell times.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::inference::{LabelledSequence, LearningOptions};
use wayfix::likelihood::{GroupedLikelihood, LikelihoodVector};
use wayfix::transition::{
    Durations, DwellTransition, LearnTransition, RestartTransition, TransitionEntries,
};
use wayfix::{Belief, Fixed, Hmm, Prior, SparseTransition, TableLikelihood, TransitionError};

use crate::kit::{cases, rng};

/// ln Γ(x) by a product and Stirling's series, to 1e-13.
fn ln_gamma(mut x: f64) -> f64 {
    let mut below = 0.0;
    while x < 20.0 {
        below += x.ln();
        x += 1.0;
    }
    let series = 1.0 / 12.0 / x - 1.0 / 360.0 / x.powi(3) + 1.0 / 1260.0 / x.powi(5);
    (x - 0.5) * x.ln() - x + 0.5 * std::f64::consts::TAU.ln() + series - below
}

/// ln p(d) by the definition, without the constant of the gamma shape.
fn log_probability(durations: Durations, d: f64) -> f64 {
    match durations {
        Durations::Geometric { mean } => (d - 1.0) * (-mean.recip()).ln_1p() - mean.ln(),
        Durations::ShiftedPoisson { mean } => {
            (d - 1.0) * (mean - 1.0).ln() - (mean - 1.0) - ln_gamma(d)
        }
        Durations::NegativeBinomial { mean, size } => {
            let q = (mean - 1.0) / (mean - 1.0 + size);
            ln_gamma(size + d - 1.0) - ln_gamma(size) - ln_gamma(d)
                + (d - 1.0) * q.ln()
                + size * (-q).ln_1p()
        }
        Durations::Gamma { shape, scale } => (shape - 1.0) * d.ln() - d / scale,
        _ => unreachable!("no other"),
    }
}

fn durations() -> impl Strategy<Value = Durations> {
    let mean = 1.01..30.0;
    prop_oneof![
        mean.clone().prop_map(|mean| Durations::Geometric { mean }),
        mean.clone().prop_map(|mean| Durations::ShiftedPoisson { mean }),
        (mean, 0.1..20.0).prop_map(|(mean, size)| Durations::NegativeBinomial { mean, size }),
        (0.2..10.0, 0.2..5.0).prop_map(|(shape, scale)| Durations::Gamma { shape, scale }),
    ]
}

fn around(n: usize) -> SparseTransition {
    let moves = (0..n).flat_map(|from| {
        let others = (1..n).map(move |k| ((from + k) % n, from, ((n - 1) as f64).recip()));
        others.chain((n == 1).then_some((0, 0, 1.0)))
    });
    SparseTransition::from_triplets(n, moves).unwrap()
}

/// Places with these durations, up to an age beyond which hazards are constant. A gamma
/// distribution has a maximum, which must be before that age.
fn lasting() -> impl Strategy<Value = (Vec<Durations>, usize)> {
    let valid = |(all, longest): &(Vec<Durations>, usize)| {
        DwellTransition::from_durations(around(all.len()), all, *longest).is_ok()
    };
    (vec(durations(), 1..4), 1..40_usize).prop_filter("a mode beyond the oldest age", valid)
}

proptest! {
    #![proptest_config(cases())]

    /// Hazards are p(d) / P(D ≥ d), with a geometric tail beyond the oldest age.
    #[test]
    fn hazards_are_those_of_the_distribution(durations in durations(), longest in 1..60_usize) {
        let log = |d: usize| log_probability(durations, d as f64);
        let ratio = log(longest + 1) - log(longest);
        let a = DwellTransition::from_durations(around(1), &[durations], longest);
        let Ok(a) = a else {
            prop_assert!(ratio > -1e-9, "{ratio}");
            return Ok(());
        };
        prop_assume!(ratio < -1e-9);
        for d in 1..=longest {
            let within: f64 = (d..longest).map(|later| (log(later) - log(d)).exp()).sum();
            let rest = within + (log(longest) - log(d)).exp() / -ratio.exp_m1();
            let found = a.leaving(0, d).unwrap();
            prop_assert!((found * rest - 1.0).abs() < 1e-11 / ratio.exp_m1().abs(), "{durations:?} {d}: {found}, {}", 1.0 / rest);
        }
        prop_assert_eq!(a.leaving(0, longest + 9), a.leaving(0, longest));
    }

    /// Statistics without listed moves equal those of the moves between states.
    #[test]
    fn statistics_are_sums_over_moves_between_states(
        (parameters, longest) in lasting(),
        ys in vec(vec(0.1..1.0_f64, 3), 1..7), again: bool, keep in 0.3..1.0_f64,
    ) {
        let n = parameters.len();
        let moves = if again { // a place may follow itself
            SparseTransition::from_triplets(n, (0..n * n).map(|k| (k / n, k % n, 1.0 / n as f64))).unwrap()
        } else {
            around(n)
        };
        // A vehicle that leaves may turn up anywhere; these moves are not learned.
        let moves = RestartTransition::new(moves, 1.0 - keep, Belief::uniform(n).unwrap()).unwrap();
        let a = DwellTransition::from_durations(moves, &parameters, longest).unwrap();
        let sensor = GroupedLikelihood::new(LikelihoodVector::linear(n).owned(), a.groups().clone()).unwrap();
        let prior = Prior::BeforeFirstTransition(Belief::uniform(n * longest).unwrap());
        let hmm = Hmm::new(prior, a, Fixed(sensor)).unwrap();
        let ys: Vec<Vec<f64>> = ys.iter().map(|y| y[..n].to_vec()).collect();
        let (found, _) = hmm.expectations(std::slice::from_ref(&ys));
        let a = hmm.transition();
        let mut listed = a.statistics();
        listed.2 = hmm.expected_moves(&ys).unwrap();
        let mut without = a.statistics();
        a.merge(&mut without, found.moves());
        prop_assert!(without.2.moves().len() == 0);
        let options = [0.0, 0.3];
        for pseudo_count in options {
            let one = a.maximize(&without, pseudo_count).unwrap();
            let other = a.maximize(&listed, pseudo_count).unwrap();
            for from in 0..a.groups().as_slice().len() {
                for (entry, expected) in one.outgoing(&(), from).zip(other.outgoing(&(), from)) {
                    prop_assert_eq!(entry.0, expected.0);
                    prop_assert!((entry.1 - expected.1).abs() < 1e-6, "{entry:?} {expected:?}");
                }
            }
        }
    }

    /// No iteration lowers the objective, with durations and with free hazards.
    #[test]
    fn learning_never_falls(parameters in vec(durations(), 2..4), seed: u64, free: bool, c in 0.0..1.0_f64) {
        let n = parameters.len();
        let a = DwellTransition::from_durations(around(n), &parameters, 60).unwrap();
        let a = if free {
            let leaving = |place| (1..=60).map(|d| a.leaving(place, d).unwrap()).collect::<Vec<f64>>();
            let leaving: Vec<_> = (0..n).map(leaving).collect();
            DwellTransition::from_leaving(around(n), &leaving).unwrap()
        } else {
            a
        };
        let rows: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|y| if i == y { 0.7 } else { 0.3 / (n - 1) as f64 }).collect()).collect();
        let table = TableLikelihood::from_rows(&rows).unwrap();
        let sensor = GroupedLikelihood::new(table, a.groups().clone()).unwrap();
        let prior = Prior::AtFirstObservation(a.arriving(&Belief::uniform(n).unwrap()).unwrap());
        let hmm = Hmm::new(prior, a, sensor).unwrap();
        let mut rng = rng(seed);
        let drives: Vec<Vec<usize>> = (0..3).map(|_| hmm.simulate(40, &mut rng).observations().to_vec()).collect();
        let learning = LearningOptions::default().with_iterations(8).with_tolerance(0.0).with_transition_pseudo_count(c);
        let learned = hmm.learn(&drives, &learning).unwrap();
        prop_assert!(learned.cause().is_none(), "{:?}", learned.cause());
        prop_assert!(learned.objectives().windows(2).all(|pair| pair[1] >= pair[0] - 1e-9 * pair[0].abs().max(1.0)));
    }
}

/// From labelled stays of 3 and 5 steps, and one of at least 2 that the end truncates.
#[test]
fn durations_are_fitted_to_labels() {
    let places = [0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 1, 0, 0];
    let fit = |durations: Durations| {
        let a = DwellTransition::from_durations(around(2), &[durations; 2], 9).unwrap();
        let states = a.path(&places).unwrap();
        let sensor =
            GroupedLikelihood::new(LikelihoodVector::linear(2).owned(), a.groups().clone());
        let prior = Prior::AtFirstObservation(a.arriving(&Belief::uniform(2).unwrap()).unwrap());
        let hmm = Hmm::new(prior, a, Fixed(sensor.unwrap())).unwrap();
        let seen = vec![vec![1.0; 2]; places.len()];
        let drive = LabelledSequence { initial: None, states: &states, sequence: &seen };
        hmm.fit(&[drive], &LearningOptions::default()).unwrap().transition().durations(0).unwrap()
    };
    // Two stays ended, and seven times a stay continued.
    let Durations::Geometric { mean } = fit(Durations::Geometric { mean: 3.0 }) else { panic!() };
    assert!((mean - 4.5).abs() < 1e-12, "{mean}");
    // The likelihood of 3, 5 and at least 2 steps, by a grid.
    let log = |mean: f64| {
        let log = |d: f64| log_probability(Durations::ShiftedPoisson { mean }, d);
        log(3.0) + log(5.0) + (-log(1.0).exp()).ln_1p()
    };
    let grid = (1001..20_000).map(|k| f64::from(k) / 1000.0);
    let best = grid.max_by(|a, b| log(*a).total_cmp(&log(*b))).unwrap();
    let found = fit(Durations::ShiftedPoisson { mean: 9.0 });
    let Durations::ShiftedPoisson { mean } = found else { panic!() };
    assert!((mean - best).abs() < 2e-3, "{mean}, expected {best}");
}

/// Parameters of simulated stays of each kind are recovered, within four standard errors for 40,000
/// steps.
#[test]
fn durations_of_simulated_drives_are_found() {
    let truth = [
        Durations::Gamma { shape: 6.0, scale: 2.0 },
        Durations::ShiftedPoisson { mean: 8.0 },
        Durations::NegativeBinomial { mean: 7.0, size: 1.5 },
    ];
    let start = [
        Durations::Gamma { shape: 1.0, scale: 5.0 },
        Durations::ShiftedPoisson { mean: 3.0 },
        Durations::NegativeBinomial { mean: 3.0, size: 5.0 },
    ];
    let rows: Vec<Vec<f64>> =
        (0..3).map(|i| (0..3).map(|y| if i == y { 0.9 } else { 0.05 }).collect()).collect();
    let model = |durations: &[Durations]| {
        let a = DwellTransition::from_durations(around(3), durations, 60).unwrap();
        let table = TableLikelihood::from_rows(&rows).unwrap();
        let sensor = GroupedLikelihood::new(table, a.groups().clone()).unwrap();
        let prior = Prior::AtFirstObservation(a.arriving(&Belief::uniform(3).unwrap()).unwrap());
        Hmm::new(prior, a, Fixed(sensor)).unwrap()
    };
    let drive = model(&truth).simulate(40_000, &mut rng(7)).observations().to_vec();
    let learning = LearningOptions::default().with_keep_prior(true);
    let learned = model(&start).learn(&[drive], &learning).unwrap();
    let found = |place: usize| learned.model().transition().durations(place).unwrap();
    let Durations::Gamma { shape, scale } = found(0) else { panic!() };
    // Some 1,500 stays in each place.
    assert!(
        (shape / 6.0).ln().abs() < 0.2 && (shape * scale / 12.0).ln().abs() < 0.05,
        "{:?}",
        found(0)
    );
    let Durations::ShiftedPoisson { mean } = found(1) else { panic!() };
    assert!((mean - 8.0).abs() < 0.35, "{mean}");
    let Durations::NegativeBinomial { mean, size } = found(2) else { panic!() };
    assert!((mean - 7.0).abs() < 0.7 && (size / 1.5).ln().abs() < 0.4, "{mean} {size}");
}

#[test]
fn what_is_no_duration_is_an_error() {
    let error = |durations: Durations, longest| -> TransitionError {
        DwellTransition::from_durations(around(1), &[durations], longest).unwrap_err()
    };
    let says = |durations, expected: &str| {
        assert_eq!(error(durations, 4).to_string(), expected);
    };
    says(
        Durations::Geometric { mean: 0.5 },
        "the mean of the durations in place 0 is 0.5, expected a finite value of at least 1",
    );
    says(
        Durations::NegativeBinomial { mean: 2.0, size: 0.0 },
        "the size of the durations in place 0 is 0, expected a finite value above 0",
    );
    says(
        Durations::Gamma { shape: f64::NAN, scale: 1.0 },
        "the shape of the durations in place 0 is NaN, expected a finite value above 0",
    );
    says(
        Durations::ShiftedPoisson { mean: 9.0 },
        "the ratio p(5) / p(4) of durations in place 0 is 2, expected a value below 1: more ages than the likeliest stay",
    );
    let none = error(Durations::Geometric { mean: 2.0 }, 0).to_string();
    assert_eq!(none, "the number of ages in each place is 0, expected at least 1");
    // Means of 1, and means so long that a double cannot tell them from infinity.
    let a = |mean| DwellTransition::from_durations(around(1), &[Durations::Geometric { mean }], 2);
    assert_eq!(a(1.0).unwrap().leaving(0, 1), Some(1.0));
    assert_eq!(a(1e300).unwrap().leaving(0, 2), Some(1e-300));
    let a = a(2.0).unwrap();
    assert_eq!(a.path(&[0, 0, 0, 0]).unwrap(), [0, 1, 1, 1]);
    let error = a.path(&[0, 1]).unwrap_err().to_string();
    assert_eq!(error, "the place at step 2 is 1, expected a place of the operator");
}
