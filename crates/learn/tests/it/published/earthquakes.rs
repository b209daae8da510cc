//! Numbers of major earthquakes (magnitude 7 or more) in each year from 1900 to 2006, as Zucchini,
//! MacDonald and Langrock (*Hidden Markov Models for Time Series*, 2nd edition 2016, chapters 1 to 4)
//! print them, and their fits of Poisson states.

use wayfix::inference::{LearnedModel, LearningOptions};
use wayfix::{DenseTransition, Hmm, Prior};
use wayfix_learn::{Poisson, starts};

use crate::kit::rng;

const COUNTS: [u8; 107] = [
    13, 14, 8, 10, 16, 26, 32, 27, 18, 32, 36, 24, 22, 23, 22, 18, 25, 21, 21, 14, 8, 11, 14, 23,
    18, 17, 19, 20, 22, 19, 13, 26, 13, 14, 22, 24, 21, 22, 26, 21, 23, 24, 27, 41, 31, 27, 35, 26,
    28, 36, 39, 21, 17, 22, 17, 19, 15, 34, 10, 15, 22, 18, 15, 20, 15, 22, 19, 16, 30, 27, 29, 23,
    20, 16, 21, 21, 25, 16, 18, 15, 18, 14, 10, 15, 8, 15, 6, 11, 8, 7, 18, 16, 13, 12, 13, 20, 15,
    16, 12, 18, 15, 16, 13, 15, 16, 11, 11,
];

type Quakes = Hmm<DenseTransition, wayfix_learn::Independent<Poisson>>;

fn learned(
    states: usize,
    count: usize,
    seed: u64,
    tolerance: f64,
    prior: impl Fn(&DenseTransition) -> Option<Prior>,
) -> LearnedModel<DenseTransition, wayfix_learn::Independent<Poisson>> {
    let years = COUNTS.map(|count| [f64::from(count)]);
    let family = Poisson::family(&vec![[1.0]; states]).unwrap();
    let starts = starts(&family, &[&years[..]], count, &mut rng(seed)).unwrap();
    let with_prior = |start: Quakes| {
        let (known, a, sensor) = start.into_parts();
        Hmm::new(prior(&a).unwrap_or(known), a, sensor).unwrap()
    };
    let starts: Vec<Quakes> = starts.into_iter().map(with_prior).collect();
    let learning = LearningOptions::default().with_iterations(2000).with_tolerance(tolerance);
    Hmm::learn_best(&starts, &[&years[..]], &learning, |_, _| ()).unwrap()
}

/// The states by their rates: rates, starting probabilities and moves \[from\]\[to\].
fn sorted(hmm: &Quakes) -> (Vec<f64>, Vec<f64>, Vec<Vec<f64>>) {
    let rates: Vec<f64> = hmm.likelihood().parameters(Poisson::rate).concat();
    let mut order: Vec<usize> = (0..rates.len()).collect();
    order.sort_by(|i, j| rates[*i].total_cmp(&rates[*j]));
    let p = hmm.prior().belief().as_slice();
    let row = |from: &usize| order.iter().map(|to| hmm.transition().get(*to, *from)).collect();
    (
        order.iter().map(|i| rates[*i]).collect(),
        order.iter().map(|i| p[*i]).collect(),
        order.iter().map(row).collect(),
    )
}

/// Equal to a printed number, up to half a unit of its last digit and the tolerance of learning.
fn near(found: &[f64], printed: &[f64], digit: f64) {
    for (found, printed) in found.iter().zip(printed) {
        assert!((found - printed).abs() < 0.6 * digit, "{found}, printed {printed}");
    }
}

#[test]
fn fits_with_a_free_start() {
    for (states, printed, count) in [(2, -341.8787, 5), (3, -328.5275, 5), (4, -326.6749, 15)] {
        for seed in 0..2 {
            let found = learned(states, count, seed, 1e-7, |_| None).objective();
            assert!(found > printed - 1e-3, "{states} states, seed {seed}: {found}");
        }
    }
}

#[test]
fn fits_with_a_stationary_start() {
    for (states, printed, count) in [(2, -342.3183, 5), (3, -329.4603, 5), (4, -327.8316, 15)] {
        for seed in 0..2 {
            let best = learned(states, count, seed, 1e-7, |a| Some(Prior::stationary(a).unwrap()));
            let found = best.objective();
            assert!((found - printed).abs() < 1e-4, "{states} states, seed {seed}: {found}");
            let free = states * (states - 1) + states;
            assert_eq!(best.criteria().parameters, free);
        }
    }
}

#[test]
fn parameters_with_a_stationary_start() {
    let best = learned(2, 5, 1, 1e-10, |a| Some(Prior::stationary(a).unwrap()));
    let (rates, _, moves) = sorted(best.model());
    near(&rates, &[15.472, 26.125], 1e-3);
    near(&[moves[0][1], moves[1][0]], &[0.0660, 0.1285], 1e-4);

    let best = learned(3, 5, 1, 1e-10, |a| Some(Prior::stationary(a).unwrap()));
    let (rates, start, moves) = sorted(best.model());
    near(&rates, &[13.146, 19.721, 29.714], 1e-3);
    near(&start, &[0.4436, 0.4045, 0.1519], 1e-4);
    near(&moves[0], &[0.955, 0.024, 0.021], 1e-3);
    near(&moves[1], &[0.050, 0.899, 0.051], 1e-3);
    near(&moves[2], &[0.000, 0.197, 0.803], 1e-3);
}
