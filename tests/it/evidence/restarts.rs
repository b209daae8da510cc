//! Evidence on moves of an operator with restarts, which have their own likelihood.

use proptest::prelude::*;
use wayfix::inference::{LearningOptions, Order};
use wayfix::transition::{EvidenceTransition, RestartTransition};
use wayfix::{Belief, Fixed, Hmm, LikelihoodVector, Prior, SparseTransition, TransitionEntries};

use crate::kit::{
    Evidence, Kind, Model, NEVER, cases, close, distribution, log_sum, matrix, measured_models,
    rate, restart, sensor,
};

/// A model with restarts as one matrix, with one likelihood of moves for each step.
fn with_restarts(model: &Model, rate: f64, r: &[f64], log: Option<f64>) -> Model {
    let mut all = model.clone();
    for (m, evidence) in all.matrices.iter_mut().zip(&mut all.evidence) {
        let mixed = restart(m, rate, r);
        let log = log.unwrap_or(evidence.log_factor);
        let joint = |i: usize, j: usize| {
            let moved = (1.0 - rate).ln() + m[i][j].ln() + evidence.logs[i][j];
            let restarted = (rate * r[i]).ln() + log;
            let share = |log: f64| if log.is_nan() { NEVER } else { log };
            log_sum([share(moved), share(restarted)].into_iter())
        };
        let logs =
            matrix(
                m.len(),
                |i, j| {
                    if mixed[i][j] > 0.0 { joint(i, j) - mixed[i][j].ln() } else { NEVER }
                },
            );
        (*m, *evidence) = (mixed, Evidence { logs, log_factor: evidence.log_factor });
    }
    all
}

type Restarts = (f64, Vec<f64>, Option<f64>);

fn restarts(wide: bool) -> impl Strategy<Value = (Model, Restarts)> {
    measured_models(Kind::Shifted, wide).prop_flat_map(|mut model| {
        let n = model.states;
        // The expected sums would lose digits beside 1e5.
        for evidence in model.evidence.iter_mut().filter(|evidence| evidence.log_factor < -9e4) {
            evidence.logs.iter_mut().flatten().for_each(|log| *log += 1e5);
            evidence.log_factor += 1e5;
        }
        let log = prop_oneof![
            2 => Just(None),
            2 => (-9.0..3.0).prop_map(Some),
            1 => Just(Some(-400.0)),
            1 => Just(Some(-2000.0)),
        ];
        (Just(model), (rate(false), distribution(false, n), log))
    })
}

fn check(
    model: &Model,
    (rate, r, log): &Restarts,
    of: (usize, usize, u64),
) -> Result<(), TestCaseError> {
    let belief = Belief::new(r.clone()).unwrap();
    let a = RestartTransition::new(model.measured(), *rate, belief).unwrap();
    let a = match log {
        Some(log) => a.with_evidence(*log).unwrap(),
        None => a,
    };
    crate::kit::check_evidence(&with_restarts(model, *rate, r, *log), a, of)
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn restarts_with_evidence_equal_enumeration((model, restarts) in restarts(false), of in (0..8_usize, 0..40_usize, any::<u64>())) {
        check(&model, &restarts, of)?;
    }

    #[test]
    fn restarts_with_evidence_of_wide_ranges_equal_enumeration((model, restarts) in restarts(true), of in (0..8_usize, 0..40_usize, any::<u64>())) {
        check(&model, &restarts, of)?;
    }
}

/// Counts of learning at each step: the part of each expected move that is not a restart.
fn check_counts(model: &Model, (rate, r, log): &Restarts) -> Result<(), TestCaseError> {
    let n = model.states;
    let all = with_restarts(model, *rate, r, *log);
    if model.steps() == 0 || all.enumerate().impossible_at.is_some() {
        return Ok(());
    }
    let belief = Belief::new(r.clone()).unwrap();
    let a = RestartTransition::new(model.measured(), *rate, belief).unwrap();
    let a = match log {
        Some(log) => a.with_evidence(*log).unwrap(),
        None => a,
    };
    let hmm = Hmm::new(model.prior(), a, Fixed(sensor(n))).unwrap();
    let mut expected = vec![matrix(n, |_, _| 0.0); model.steps()];
    hmm.smooth_each(model, Order::Backward, |step| {
        let Some(moves) = step.moves() else { return };
        let k = step.step() - 1;
        let (m, logs) = (&model.matrices[k], &model.evidence[k].logs);
        let log = log.unwrap_or(model.evidence[k].log_factor);
        for moved in moves {
            let (i, j) = (moved.to, moved.from);
            let part = [((1.0 - rate) * m[i][j]).ln() + logs[i][j], (rate * r[i]).ln() + log];
            let whole = log_sum(part.into_iter());
            expected[k][i][j] = moved.weight * (part[0] - whole).exp();
        }
    })
    .unwrap();
    let (found, failed) = hmm.expectations(std::slice::from_ref(model));
    prop_assert!(failed.is_empty(), "{:?}", failed);
    for (k, counts) in found.moves().iter().enumerate() {
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            close(counts.get(j, i), expected[k][i][j], 1e-9, 1e-290)?;
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn learning_counts_moves_without_restarts((model, restarts) in restarts(false)) {
        check_counts(&model, &restarts)?;
    }

    #[test]
    fn learning_counts_moves_of_wide_ranges_without_restarts((model, restarts) in restarts(true)) {
        check_counts(&model, &restarts)?;
    }
}

#[test]
fn learning_with_restarts_takes_no_more_than_the_moves_within() {
    let n = 500;
    let stay = (0..n).flat_map(|j| [(j, j, 0.5), ((j + 1) % n, j, 0.5)]);
    let a = SparseTransition::from_triplets(n, stay).unwrap();
    let a = RestartTransition::new(a, 0.01, Belief::uniform(n).unwrap()).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior, a, Fixed(LikelihoodVector::linear(n).owned())).unwrap();
    // It moves at every step, and jumps once.
    let seen = |at: usize| (0..n).map(|i| if i == at { 1.0 } else { 1e-3 }).collect::<Vec<f64>>();
    let drive: Vec<_> = (0..20).map(|k| seen(k + if k < 10 { 0 } else { 200 })).collect();
    let (expected, _) = hmm.expectations(std::slice::from_ref(&drive));
    assert_eq!(expected.moves().moves().len(), 2 * n);
    let total: f64 = expected.moves().moves().map(|m| m.weight).sum();
    assert!((total - 18.0).abs() < 0.1, "{total} of 19 moves");
    let learned = hmm.learn(&[drive], &LearningOptions::default()).unwrap();
    assert!(learned.model().transition().inner().get(5, 4) > 0.99);
    assert_eq!(learned.model().transition().incoming(&(), 4).count(), n);
}

/// A robot on a loop that measures the distance it went, and is carried elsewhere once.
#[test]
fn a_robot_that_was_carried_away_is_found_again() {
    let n = 60;
    let by = |d: usize| (0..n).map(move |j| ((j + d) % n, j, [0.25, 0.5, 0.25][d]));
    let steps = SparseTransition::from_triplets(n, (0..3).flat_map(by)).unwrap();
    let odometry = EvidenceTransition::new(steps, move |driven: &f64, to, from| {
        -0.5 * ((driven - ((to + n - from) % n) as f64) / 0.1).powi(2)
    });
    let everywhere = Belief::uniform(n).unwrap();
    let carried = RestartTransition::new(odometry.unwrap(), 1e-3, everywhere.clone()).unwrap();
    let carried = carried.with_evidence(-(3.0_f64.ln())).unwrap();
    let prior = Prior::BeforeFirstTransition(everywhere);
    let hmm = Hmm::new(prior, carried, LikelihoodVector::linear(n)).unwrap();
    let mut filter = hmm.filter();
    // Doors are at places 0, 7, 13 and 40.
    let seen = |at: usize| -> Vec<f64> {
        let door = |i: usize| [0, 7, 13, 40].contains(&i);
        (0..n).map(|i| if door(i) == door(at) { 0.9 } else { 0.1 }).collect()
    };
    let mut at = 3;
    for step in 1..=80 {
        at = if step == 40 { 33 } else { (at + 1) % n };
        let belief = filter.step_with(&1.0, &seen(at)).map(|_| filter.belief().peak()).unwrap();
        if step == 39 || step == 80 {
            assert_eq!(belief.0, at, "step {step}: {belief:?}");
            assert!(belief.1 > 0.9, "step {step}: {belief:?}");
        }
    }
}
