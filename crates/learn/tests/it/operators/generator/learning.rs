//! Rates from observations at irregular times.

use proptest::collection::vec;
use proptest::prelude::*;
use rand::RngExt;
use wayfix::inference::{LabelledSequence, LearnError, LearningOptions};
use wayfix::transition::{LearnTransition, RestartTransition};
use wayfix::{Belief, Controlled, Fixed, Hmm, LikelihoodVector, Prior, TableLikelihood};
use wayfix_learn::GeneratorTransition;

use super::{generator, rates};
use crate::kit::{cases_of, rng};

proptest! {
    #![proptest_config(cases_of(500))]

    #[test]
    fn the_objective_never_falls(
        rates in rates(4, 0.7),
        drives in vec(vec(((-3.0..3.0_f64).prop_map(|x| 10_f64.powf(x)), 0..2_usize), 1..8), 1..4),
        pseudo_count in prop_oneof![Just(0.0), 0.1..2.0],
        seen in vec(0.1..0.9, 4),
    ) {
        let n = rates.len();
        let rows: Vec<[f64; 2]> = seen[..n].iter().map(|p: &f64| [*p, 1.0 - p]).collect();
        let prior = Prior::BeforeFirstTransition(Belief::uniform(n).unwrap());
        let sensor = TableLikelihood::from_rows(&rows).unwrap();
        let hmm = Hmm::new(prior, generator(&rates), sensor).unwrap();
        let drives: Vec<(Vec<f64>, Vec<usize>)> = drives.into_iter().map(|d| d.into_iter().unzip()).collect();
        let drives: Vec<_> = drives.iter().map(|(times, ys)| Controlled::new(times, ys).unwrap()).collect();
        let options = LearningOptions::default().with_iterations(12).with_tolerance(0.0).with_transition_pseudo_count(pseudo_count);
        match hmm.learn(&drives, &options) {
            Ok(learned) => {
                let objectives = learned.objectives();
                let size = objectives[0].abs().max(1.0);
                prop_assert!(objectives.windows(2).all(|o| o[1] - o[0] >= -1e-9 * size), "{objectives:?}");
                let legal = |a: &GeneratorTransition| a.triplets().count();
                prop_assert!(legal(learned.model().transition()) <= legal(hmm.transition()));
            }
            // A pseudo-count without a matching time.
            Err(error) => prop_assert!(pseudo_count > 0.0 && !matches!(error, LearnError::Nothing { .. }), "{error}"),
        }
    }
}

/// A drive with its true states, observed at irregular times, with gaps.
fn drive(a: &GeneratorTransition, n: usize, steps: usize, seed: u64) -> (Vec<f64>, Vec<usize>) {
    let rng = &mut rng(seed);
    let mut exponential = |rate: f64| -(1.0 - rng.random::<f64>()).ln() / rate;
    let (mut state, mut left) = (0, exponential(a.exit_rate(0)));
    let mut choose = self::rng(seed + 1000);
    let (mut times, mut states) = (Vec::new(), Vec::new());
    for step in 0..steps {
        let time = exponential(if step % 50 == 49 { 0.05 } else { 2.0 });
        let mut to_go = time;
        while left <= to_go {
            to_go -= left;
            let mut u = choose.random::<f64>() * a.exit_rate(state);
            let moves = (0..n).map(|to| (to, a.rate(to, state))).filter(|m| m.1 > 0.0);
            let moves: Vec<_> = moves.collect();
            let next = moves.iter().find(|m| {
                u -= m.1;
                u < 0.0
            });
            state = next.unwrap_or(moves.last().unwrap()).0;
            left = exponential(a.exit_rate(state));
        }
        left -= to_go;
        times.push(time);
        states.push(state);
    }
    (times, states)
}

const TRUTH: [(usize, usize, f64); 6] =
    [(1, 0, 0.8), (2, 0, 0.2), (0, 1, 0.3), (2, 1, 0.6), (0, 2, 1.0), (1, 2, 0.4)];

/// Each rate is within four of its standard errors, which are about rate / √(moves).
fn assert_near(found: &GeneratorTransition, steps: usize) {
    for (to, from, rate) in TRUTH {
        let error = (found.rate(to, from) - rate).abs();
        // About 0.6 time units a step, a third of them in each state.
        let moves = rate * 0.2 * steps as f64;
        assert!(
            error < 6.0 * rate / moves.sqrt(),
            "{from} to {to}: {} for {rate}",
            found.rate(to, from)
        );
    }
}

#[test]
fn rates_are_found_from_hidden_states() {
    let truth = GeneratorTransition::from_triplets(3, TRUTH).unwrap();
    let (times, states) = drive(&truth, 3, 6000, 1);
    let mut noise = rng(2);
    let seen: Vec<usize> = states
        .iter()
        .map(|state| if noise.random_bool(0.1) { (state + 1) % 3 } else { *state })
        .collect();
    let sensor = [[0.9, 0.1, 0.0], [0.0, 0.9, 0.1], [0.1, 0.0, 0.9]];
    let start = GeneratorTransition::from_triplets(3, TRUTH.map(|(i, j, _)| (i, j, 0.1))).unwrap();
    let hmm = Hmm::new(
        Prior::BeforeFirstTransition(Belief::certain(3, 0).unwrap()),
        start,
        Fixed(TableLikelihood::from_rows(&sensor).unwrap()),
    )
    .unwrap();
    let options = LearningOptions::default().with_keep_prior(true).with_iterations(200);
    let learned = hmm.learn(&[Controlled::new(&times, &seen).unwrap()], &options).unwrap();
    assert_near(learned.model().transition(), 6000);
    assert_eq!(learned.model().transition().free_parameters(), 6);
}

/// With labels, the moves between observations remain hidden: `fit` iterates, as learning does.
#[test]
fn rates_are_found_from_labels() {
    let truth = GeneratorTransition::from_triplets(3, TRUTH).unwrap();
    let (times, states) = drive(&truth, 3, 4000, 3);
    let start = GeneratorTransition::from_triplets(3, TRUTH.map(|(i, j, _)| (i, j, 0.5))).unwrap();
    let sensor = TableLikelihood::from_rows(&[[0.9, 0.1], [0.5, 0.5], [0.1, 0.9]]).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::certain(3, 0).unwrap());
    let mut hmm = Hmm::new(prior, start, Fixed(sensor)).unwrap();
    let seen = vec![0; states.len()];
    let sequence = Controlled::new(&times, &seen).unwrap();
    let labelled = LabelledSequence { initial: Some(0), states: &states, sequence: &sequence };
    for _ in 0..30 {
        hmm = hmm.fit(&[labelled], &LearningOptions::default()).unwrap();
    }
    assert_near(hmm.transition(), 4000);
}

/// Within another operator, and in steps in logarithms, moves are listed and counted: the rates are
/// the same as without a list.
#[test]
fn listed_moves_give_the_same_rates() {
    let truth = GeneratorTransition::from_triplets(3, TRUTH).unwrap();
    let times = [0.3, 1.7, 0.3, 40.0, 0.02, 2.5];
    let options = LearningOptions::default().with_iterations(1);
    let prior = || Prior::BeforeFirstTransition(Belief::uniform(3).unwrap());
    let within = RestartTransition::new(truth.clone(), 0.0, Belief::uniform(3).unwrap()).unwrap();
    // The second belief is out of the range of doubles in all but one state.
    for far in [-2.0, -3000.0] {
        let seen = [1.0, far, 0.5, 1.0, 1.0, 2.0].into_iter().zip(1..);
        let seen: Vec<Vec<f64>> =
            seen.map(|(log, k)| vec![log, f64::from(k % 2) * log, 0.0]).collect();
        let drive = Controlled::new(&times, &seen).unwrap();
        let sensor = || Fixed(LikelihoodVector::log(3).owned());
        let hmm = Hmm::new(prior(), truth.clone(), sensor()).unwrap();
        let stepped = hmm.learn(&[drive], &options).unwrap();
        let hmm = Hmm::new(prior(), within.clone(), sensor()).unwrap();
        let listed = hmm.learn(&[drive], &options).unwrap();
        let (a, b) = (stepped.model().transition(), listed.model().transition().inner());
        for ((to, from, a), (_, _, b)) in a.triplets().zip(b.triplets()) {
            assert!((a / b - 1.0).abs() < 1e-10, "{from} to {to}: {a} and {b}");
            assert!((a / truth.rate(to, from) - 1.0).abs() > 1e-3);
        }
    }
}
