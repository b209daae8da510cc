//! Steps in logarithms are counted, and rounding tails saves most of them.

use wayfix::inference::LearningOptions;
use wayfix::{Belief, DenseTransition, Fixed, Hmm, LikelihoodVector, Prior, Transition, canberra};

use crate::kit::{rng, still};

type Standing = Hmm<wayfix::SparseTransition, LikelihoodVector<Vec<f64>>>;

/// A model without moves, so that log-odds of the two states add up.
fn standing() -> Standing {
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    Hmm::new(prior, still(2), LikelihoodVector::log(2).owned()).unwrap()
}

/// Log-odds of 10, 1010, 1020, 120 and 120: doubles do not hold the second and the third,
/// and the fourth comes from there.
fn odds() -> Vec<Vec<f64>> {
    [[0.0, -10.0], [0.0, -1000.0], [0.0, -10.0], [-900.0, 0.0], [0.0, 0.0]].map(Vec::from).to_vec()
}

#[test]
fn a_usual_drive_takes_none() {
    let hmm = canberra::hmm(5, 1.0).unwrap();
    let drives: Vec<Vec<usize>> =
        (0..6).map(|_| hmm.simulate(200, &mut rng(1)).observations().to_vec()).collect();
    assert_eq!(hmm.forward(&drives[0]).unwrap().steps_in_logs(), 0);
    assert_eq!(hmm.smooth(&drives[0]).unwrap().steps_in_logs(), 0);
    assert!(hmm.forward_all(&drives).iter().all(|all| all.as_ref().unwrap().steps_in_logs() == 0));
    let (mut filter, mut lagged) = (hmm.filter(), hmm.fixed_lag(3));
    for y in &drives[0] {
        filter.step(y).unwrap();
        lagged.step(y).unwrap();
    }
    assert_eq!((filter.steps_in_logs(), lagged.steps_in_logs()), (0, 0));
}

#[test]
fn each_is_counted_once() {
    let (exact, ys) = (standing(), odds());
    let (mut filter, mut lagged) = (exact.filter(), exact.fixed_lag(2));
    let counts: Vec<usize> = ys
        .iter()
        .map(|y| {
            filter.step(y).unwrap();
            lagged.step(y).unwrap();
            assert_eq!(lagged.steps_in_logs(), filter.steps_in_logs());
            filter.steps_in_logs()
        })
        .collect();
    assert_eq!(counts, [0, 1, 2, 3, 3]);
    assert_eq!(exact.forward(&ys).unwrap().steps_in_logs(), 3);
    assert_eq!(exact.smooth(&ys).unwrap().steps_in_logs(), 3);
    // Only the step that contradicts all earlier ones by more than the range of a double.
    let rounded = exact.with_rounded_tails();
    assert_eq!(rounded.forward(&ys).unwrap().steps_in_logs(), 1);
    assert_eq!(rounded.smooth(&ys).unwrap().steps_in_logs(), 1);
}

#[test]
fn predictions_and_updates_count_too_and_a_snapshot_knows() {
    let (hmm, ys) = (standing(), odds());
    let mut filter = hmm.filter();
    filter.step(&ys[1]).unwrap();
    filter.predict().unwrap();
    filter.update(&ys[0]).unwrap();
    assert_eq!((filter.steps(), filter.steps_in_logs()), (2, 3));
    let snapshot = filter.snapshot();
    assert_eq!(snapshot.steps_in_logs(), 3);
    assert!(filter.step(&vec![f64::NAN; 2]).is_err());
    assert_eq!(filter.steps_in_logs(), 3);
    filter.restart();
    assert_eq!(filter.steps_in_logs(), 0);
    filter.restore(&snapshot).unwrap();
    assert_eq!(filter.steps_in_logs(), 3);
    filter.relocate(&Belief::uniform(2).unwrap()).unwrap();
    filter.step(&ys[0]).unwrap();
    assert_eq!(filter.steps_in_logs(), 3);
}

/// Among many sequences, those that doubles do not hold are redone by themselves.
#[test]
fn of_many_sequences_each_has_its_own_count() {
    let n = 9;
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let motion = DenseTransition::from_fn(n, |to, from| f64::from(to == from)).unwrap();
    let hmm = Hmm::new(prior, motion, LikelihoodVector::log(n).owned()).unwrap();
    let quiet = vec![(0..n).map(|i| -(i as f64)).collect::<Vec<f64>>(); 12];
    let mut wild = quiet.clone();
    wild[10][0] = -2000.0;
    let drives = [quiet.clone(), quiet.clone(), wild, quiet.clone(), quiet];
    let filtered = hmm.forward_all(&drives).into_iter().map(|all| all.unwrap().steps_in_logs());
    assert_eq!(filtered.collect::<Vec<_>>(), [0, 0, 2, 0, 0]);
    let smoothed = hmm.smooth_all(&drives).into_iter().map(|all| all.unwrap().steps_in_logs());
    assert_eq!(smoothed.collect::<Vec<_>>(), [0, 0, 2, 0, 0]);
}

/// Few states over many steps have routines of their own, which leave such sequences to the general
/// ones.
#[test]
fn of_few_states_too() {
    let hmm = standing();
    let mut ys = vec![vec![0.0, 0.0]; 100];
    assert_eq!(hmm.forward(&ys).unwrap().steps_in_logs(), 0);
    assert_eq!(hmm.smooth(&ys).unwrap().steps_in_logs(), 0);
    ys[97] = vec![0.0, -2000.0];
    assert_eq!(hmm.forward(&ys).unwrap().steps_in_logs(), 3);
    assert_eq!(hmm.smooth(&ys).unwrap().steps_in_logs(), 3);
}

#[test]
fn the_choice_stays_with_a_model() {
    let exact = standing();
    assert!(!exact.rounds_tails() && exact.clone().with_rounded_tails().clone().rounds_tails());
    let (prior, motion, sensor) = exact.into_parts();
    assert_eq!(motion.states(), 2);
    let hmm = Hmm::new(prior, motion, Fixed(sensor)).unwrap();
    let learned = |hmm: &Hmm<_, _>| {
        let learned = hmm.learn(&[odds()], &LearningOptions::default()).unwrap();
        learned.model().rounds_tails()
    };
    assert!(!learned(&hmm));
    assert!(learned(&hmm.with_rounded_tails()));
}

/// A prediction, as for a missing sighting, rounds tails, too.
#[test]
fn a_prediction_rounds_tails_too() {
    let fade = DenseTransition::from_rows(&[[1.0, 1.0], [0.0, 1e-30]]);
    let prior = Prior::AtFirstObservation(Belief::new(vec![1.0, 1e-300]).unwrap());
    let exact = Hmm::new(prior, fade.unwrap(), LikelihoodVector::log(2)).unwrap();
    let predicted = |hmm: &Hmm<DenseTransition, LikelihoodVector>| {
        let mut filter = hmm.filter();
        filter.step(&[0.0, 0.0]).unwrap();
        filter.predict().unwrap();
        let count = filter.steps_in_logs();
        filter.update(&[-2000.0, 0.0]).unwrap();
        (count, filter.belief().mode())
    };
    assert_eq!(predicted(&exact), (1, 1));
    assert_eq!(predicted(&exact.with_rounded_tails()), (0, 0));
}
