//! Learning in parts, from several starts and with failures, and the choice among models.

use std::error::Error;
use std::ops::ControlFlow;
use std::sync::Mutex;

use proptest::collection::vec;
use proptest::prelude::*;
use rand::RngExt;
use wayfix::inference::{
    Expectations, LabelledSequence, LearnError, LearnedModel, LearningOptions,
};
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::{
    ConstrainedTransition, LearnTransition, Move, MoveCounts, SwitchedTransition,
};
use wayfix::{
    Belief, DenseTransition, Diagonal, Fixed, Hmm, Likelihood, LikelihoodError, Prior, Scratch,
    SparseTransition, TableLikelihood,
};
use wayfix_learn::{Candidate, ModelSelection, StandardErrors};

use crate::kit::{cases, rng};

type Model = Hmm<DenseTransition, TableLikelihood>;

fn random_model(states: usize, symbols: usize, seed: u64) -> Model {
    let mut rng = rng(seed);
    let mut distribution = |n: usize| {
        let weights = (0..n).map(|_| 0.05 + rng.random::<f64>()).collect();
        Belief::from_weights(weights).unwrap().into_vec()
    };
    let columns: Vec<_> = (0..states).map(|_| distribution(states)).collect();
    let rows: Vec<_> = (0..states).map(|_| distribution(symbols)).collect();
    let prior = Prior::AtFirstObservation(Belief::new(distribution(states)).unwrap());
    let transition = DenseTransition::from_fn(states, |i, j| columns[j][i]).unwrap();
    Hmm::new(prior, transition, TableLikelihood::from_rows(&rows).unwrap()).unwrap()
}

/// Equal up to rounding.
fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-11 * a.abs().max(1.0)
}

fn same(a: &Model, b: &Model, tolerance: f64) -> bool {
    let flat = |rows: Vec<Vec<f64>>| rows.concat();
    let all = |hmm: &Model| {
        let mut all = hmm.prior().belief().as_slice().to_vec();
        all.extend(flat(hmm.transition().to_rows()));
        all.extend(flat(hmm.likelihood().to_rows()));
        all
    };
    all(a).iter().zip(all(b)).all(|(a, b)| (a - b).abs() <= tolerance)
}

proptest! {
    #![proptest_config(cases())]

    /// Learning in parts gives the same, however the sequences are divided, and through serialized
    /// parts.
    #[test]
    fn iterations_in_parts_equal_learning(
        seed: u64,
        sequences in vec(vec(0..3_usize, 0..12), 1..30)
            .prop_filter("observations", |all| all.iter().any(|one| !one.is_empty())),
        parts in 1..6_usize,
        pseudo_count in prop_oneof![Just(0.0), 0.1..2.0],
    ) {
        let start = random_model(3, 3, seed);
        let learning = LearningOptions::default().with_iterations(4).with_tolerance(0.0).with_prior_pseudo_count(pseudo_count).with_transition_pseudo_count(pseudo_count).with_likelihood_pseudo_count(pseudo_count);
        let learned = start.learn(&sequences, &learning).unwrap();
        let mut model = start;
        for _ in 0..learned.iterations() {
            let mut sum = model.no_expectations();
            for part in 0..parts {
                let some: Vec<_> = sequences.iter().skip(part).step_by(parts).collect();
                let (expected, failed) = model.expectations(&some);
                prop_assert!(failed.is_empty());
                let moves = MoveCounts::from_moves(expected.moves().moves());
                let sent = Expectations::<TableLikelihood>::new(
                    expected.first().to_vec(),
                    moves,
                    expected.sensor().clone(),
                    expected.log_likelihood(),
                );
                sum.merge(&model, &sent);
            }
            model = model.maximize(&sum, &learning).unwrap();
        }
        prop_assert!(same(&model, learned.model(), 1e-11));
        let (last, _) = model.expectations(&sequences);
        prop_assert!(near(last.log_likelihood(), learned.log_likelihood()));
    }

    /// Every answer is the same up to the numbering of the states.
    #[test]
    fn reordered_states_change_names_only(
        seed: u64,
        ys in vec(0..3_usize, 1..10),
        order in Just(vec![0, 1, 2, 3]).prop_shuffle(),
    ) {
        let hmm = random_model(4, 3, seed);
        let other = hmm.reordered(&order).unwrap();
        let (smoothed, renamed) = (hmm.smooth(&ys).unwrap(), other.smooth(&ys).unwrap());
        prop_assert!(near(smoothed.log_likelihood(), renamed.log_likelihood()));
        for (before, after) in smoothed.posteriors().iter().zip(renamed.posteriors().iter()) {
            for (new, &old) in order.iter().enumerate() {
                prop_assert!((before.as_slice()[old] - after.as_slice()[new]).abs() < 1e-12);
            }
        }
        let sparse = SparseTransition::from_rows(&hmm.transition().to_rows()).unwrap();
        let (prior, _, table) = hmm.into_parts();
        let switched = SwitchedTransition::new(vec![sparse.clone(), sparse]).unwrap();
        let switched = Hmm::new(prior, switched, Fixed(table)).unwrap().reordered(&order).unwrap();
        for operator in switched.transition().operators() {
            for to in 0..4 {
                for from in 0..4 {
                    prop_assert_eq!(operator.get(to, from), other.transition().get(to, from));
                }
            }
        }
    }
}

#[test]
fn expectations_of_another_model_are_refused() {
    let (two, three) = (random_model(2, 3, 1), random_model(3, 3, 1));
    let error = three.maximize(&two.no_expectations(), &LearningOptions::default()).unwrap_err();
    assert_eq!(error.to_string(), "the expectations are of 2 states, the model has 3");
    let none = two.no_expectations();
    let one = SparseTransition::from_rows(&[[1.0]]).unwrap();
    let switched = SwitchedTransition::new(vec![one]).unwrap();
    let error = switched.maximize(&Vec::new(), 0.0).unwrap_err();
    assert_eq!(error.to_string(), "statistics of 0 operators given, expected those of 1");
    let far = MoveCounts::from_moves([Move { from: 7, to: 0, weight: 1.0 }]);
    let far = Expectations::new(vec![1.0, 0.0], far, none.sensor().clone(), 0.0);
    assert!(matches!(
        two.maximize(&far, &LearningOptions::default()).unwrap_err(),
        LearnError::Transition(_)
    ));
}

#[test]
fn an_order_names_each_state_once() {
    let hmm = random_model(3, 2, 1);
    for (order, state) in [(&[0, 1][..], 2), (&[0, 1, 1], 1), (&[0, 1, 3], 3), (&[2, 1, 0, 0], 0)] {
        let error = hmm.reordered(order).unwrap_err().to_string();
        assert!(error.ends_with(&format!("check state {state}")), "{error}");
    }
}

/// A sensor with scripted learning: a table until the given number of re-estimations, then worse.
#[derive(Debug, Clone)]
struct Spoiled {
    table: TableLikelihood,
    left: usize,
    then: Trouble,
}

#[derive(Debug, Clone, Copy)]
enum Trouble {
    SmallFall,
    GreatFall,
    Failure,
}

impl Likelihood for Spoiled {
    type Observation = usize;

    fn states(&self) -> usize {
        self.table.states()
    }

    fn diagonal<'a>(
        &'a self,
        y: &'a usize,
        scratch: &'a mut Scratch,
    ) -> Result<Diagonal<'a>, LikelihoodError> {
        self.table.diagonal(y, scratch)
    }
}

impl LearnLikelihood for Spoiled {
    type Statistics = Vec<f64>;

    fn statistics(&self) -> Vec<f64> {
        self.table.statistics()
    }

    fn add(&self, statistics: &mut Vec<f64>, y: &usize, posterior: &[f64]) {
        self.table.add(statistics, y, posterior);
    }

    fn merge(&self, statistics: &mut Vec<f64>, other: &Vec<f64>) {
        self.table.merge(statistics, other);
    }

    fn maximize(
        &self,
        statistics: &Vec<f64>,
        pseudo_count: f64,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let mut table = self.table.maximize(statistics, pseudo_count)?;
        if self.left == 0 {
            let mixed = |share: f64| {
                let rows = table.to_rows();
                let row =
                    |row: &Vec<f64>| row.iter().map(|p| p + share * (1.0 / 3.0 - p)).collect();
                TableLikelihood::from_rows(&rows.iter().map(row).collect::<Vec<Vec<f64>>>())
            };
            table = match self.then {
                Trouble::SmallFall => mixed(0.02)?,
                Trouble::GreatFall => mixed(0.9)?,
                Trouble::Failure => return Err("there is no such table".into()),
            };
        }
        Ok(Self { table, left: self.left.saturating_sub(1), then: self.then })
    }

    fn free_parameters(&self) -> usize {
        self.table.free_parameters()
    }
}

fn spoiled(left: usize, then: Trouble) -> (Hmm<DenseTransition, Spoiled>, Vec<Vec<usize>>) {
    let truth = random_model(2, 3, 5);
    let sequences =
        (0..40).map(|seed| truth.simulate(50, &mut rng(seed)).observations().to_vec()).collect();
    let (prior, transition, table) = random_model(2, 3, 6).into_parts();
    (Hmm::new(prior, transition, Spoiled { table, left, then }).unwrap(), sequences)
}

/// The best model is kept, and the cause is reported.
#[test]
fn small_trouble_ends_learning_without_losing_it() {
    let learning = LearningOptions::default().with_tolerance(0.0);
    for (then, failed) in [(Trouble::SmallFall, false), (Trouble::Failure, true)] {
        // By then, gains are smaller than the loss of the failure.
        let (hmm, sequences) = spoiled(60, then);
        let learned = hmm.learn(&sequences, &learning).unwrap();
        assert_eq!((learned.failed(), learned.iterations()), (failed, 60));
        assert!(!learned.converged() && !learned.stopped());
        let kept: f64 = hmm.log_likelihood_all(&sequences).into_iter().map(Result::unwrap).sum();
        assert!(learned.log_likelihood() > kept + 1.0);
        assert_eq!(learned.objective(), *learned.objectives().last().unwrap());
        let again: f64 =
            learned.model().log_likelihood_all(&sequences).into_iter().map(Result::unwrap).sum();
        assert!(near(again, learned.log_likelihood()));
        match (then, learned.cause().unwrap()) {
            (Trouble::SmallFall, LearnError::Fell { iteration: 61, before, after }) => {
                assert_eq!(*before, learned.objective());
                assert!(after < before);
            }
            (Trouble::Failure, LearnError::Likelihood(error)) => {
                assert_eq!(error.cause.to_string(), "there is no such table");
            }
            (_, other) => panic!("{other}"),
        }
    }
}

#[test]
fn great_trouble_is_an_error() {
    let learning = LearningOptions::default().with_tolerance(0.0);
    let (hmm, sequences) = spoiled(60, Trouble::GreatFall);
    let error = hmm.learn(&sequences, &learning).unwrap_err();
    assert!(matches!(error, LearnError::Fell { iteration: 61, before, after } if after < before));
    let (hmm, sequences) = spoiled(0, Trouble::Failure);
    assert!(matches!(hmm.learn(&sequences, &learning), Err(LearnError::Likelihood(_))));
}

#[test]
fn the_best_of_several_starts_is_returned() {
    let truth = random_model(3, 4, 8);
    let sequences: Vec<_> =
        (0..10).map(|seed| truth.simulate(60, &mut rng(seed)).observations().to_vec()).collect();
    let starts: Vec<Model> = (0..5).map(|seed| random_model(3, 4, 100 + seed)).collect();
    let learning = LearningOptions::default().with_iterations(30);
    let ended = Mutex::new(Vec::new());
    let best = Hmm::learn_best(&starts, &sequences, &learning, |start, learned| {
        ended.lock().unwrap().push((start, learned.clone().unwrap()));
    })
    .unwrap();
    let mut ended = ended.into_inner().unwrap();
    ended.sort_by_key(|entry| entry.0);
    assert_eq!(ended.len(), 5);
    for ((start, learned), model) in ended.iter().zip(&starts) {
        let alone = model.learn(&sequences, &learning).unwrap();
        assert_eq!(learned.objective(), alone.objective(), "start {start}");
        assert_eq!(learned.objectives(), alone.objectives());
        assert_eq!((learned.start(), alone.start()), (*start, 0));
    }
    assert!(ended.iter().all(|(_, learned)| learned.objective() <= best.objective()));
    assert_eq!(ended[best.start()].1.objectives(), best.objectives());

    // Among equal ones the first wins, and it ends as from its start alone.
    let equal = [starts[1].clone(), starts[1].clone()];
    let best = Hmm::learn_best(&equal, &sequences, &learning, |_, _| ()).unwrap();
    assert_eq!((best.start(), best.objectives()), (0, ended[1].1.objectives()));

    let none: [Model; 0] = [];
    let error = Hmm::learn_best(&none, &sequences, &learning, |_, _| ()).unwrap_err();
    assert!(matches!(error, LearnError::Nothing { .. }));
}

/// At least the better half of twelve starts is learned to the end.
#[test]
fn the_worse_half_of_the_starts_is_left_after_a_short_run() {
    let truth = random_model(3, 4, 8);
    let sequences: Vec<_> =
        (0..6).map(|seed| truth.simulate(60, &mut rng(seed)).observations().to_vec()).collect();
    let starts: Vec<Model> = (0..12).map(|seed| random_model(3, 4, 100 + seed)).collect();
    let learning = LearningOptions::default().with_iterations(150).with_tolerance(1e-4);
    let ended = Mutex::new(Vec::new());
    let best = Hmm::learn_best(&starts, &sequences, &learning, |start, learned| {
        ended.lock().unwrap().push((start, learned.clone().unwrap()));
    })
    .unwrap();
    let mut ended = ended.into_inner().unwrap();
    ended.sort_by_key(|entry| entry.0);
    let mut objectives = Vec::new();
    for ((start, learned), model) in ended.iter().zip(&starts) {
        let alone = model.learn(&sequences, &learning).unwrap();
        let made = learned.objectives();
        assert_eq!(made, &alone.objectives()[..made.len()], "start {start}");
        assert_eq!(learned.stopped(), made.len() < alone.objectives().len());
        if learned.stopped() {
            assert_eq!(learned.iterations(), 30);
        } else {
            objectives.push(learned.objective());
        }
    }
    assert_eq!(ended.len(), 12);
    assert!((6..12).contains(&objectives.len()), "{objectives:?}");
    // The abandoned ones were not better at that point than those that continued.
    let after = |learned: &LearnedModel<DenseTransition, TableLikelihood>| learned.objectives()[30];
    let long = ended.iter().filter(|(_, learned)| learned.iterations() > 30);
    let least = long.map(|(_, learned)| after(learned)).fold(f64::INFINITY, f64::min);
    let left = ended.iter().filter(|(_, learned)| learned.stopped());
    assert!(left.map(|(_, learned)| after(learned)).all(|objective| objective <= least));
    objectives.sort_by(f64::total_cmp);
    let gaps = objectives.windows(2).filter(|pair| pair[1] - pair[0] > 1e-4).count();
    assert_eq!(best.ends(), gaps + 1);
    let first = ended.iter().find(|(_, learned)| {
        !learned.stopped() && learned.objective() >= objectives[objectives.len() - 1] - 1e-4
    });
    assert_eq!(best.start(), first.unwrap().0);
    let same = [starts[1].clone(), starts[1].clone(), starts[1].clone()];
    assert_eq!(Hmm::learn_best(&same, &sequences, &learning, |_, _| ()).unwrap().ends(), 1);
    assert_eq!(starts[1].learn(&sequences, &learning).unwrap().ends(), 1);
}

/// Attempts and candidates with an unbounded likelihood do not win.
#[test]
fn failed_fits_rank_last() {
    let learning = LearningOptions::default().with_tolerance(0.0);
    let (failing, sequences) = spoiled(60, Trouble::Failure);
    let (whole, _) = spoiled(1000, Trouble::Failure);
    // The second has reached less than the first.
    let short = learning.clone().with_iterations(1);
    let worse = whole.learn(&sequences, &short).unwrap();
    let failed = failing.learn(&sequences, &learning).unwrap();
    assert!(worse.objective() < failed.objective());

    let short = learning.with_iterations(61);
    let starts = [failing.clone(), whole.clone()];
    let best = Hmm::learn_best(&starts, &sequences, &short, |_, _| ()).unwrap();
    let second = whole.learn(&sequences, &short).unwrap();
    assert!(!best.failed() && best.objectives() == second.objectives());
    assert_eq!(best.start(), 1);
    let best = Hmm::learn_best(&starts[..1], &sequences, &short, |_, _| ()).unwrap();
    assert!(best.failed());
    // The better half (the first among equal ones) fails: the others continue.
    let starts = [vec![failing.clone(); 4], vec![whole.clone(); 4]].concat();
    let best = Hmm::learn_best(&starts, &sequences, &short, |_, _| ()).unwrap();
    assert_eq!((best.start(), best.iterations(), best.failed()), (4, 61, false));
    assert_eq!(best.ends(), 1);

    let learn = |&fails: &bool, some: &[&Vec<usize>]| {
        let (hmm, iterations) = if fails { (&failing, 61) } else { (&whole, 1) };
        hmm.learn(some, &short.clone().with_iterations(iterations))
    };
    let selection = ModelSelection::new([true, false], &sequences, 2, learn).unwrap();
    let [first, second] = selection.rows() else { panic!("two rows") };
    assert_eq!((first.failed, second.failed), (3, 0));
    assert!(first.criteria.bic() < second.criteria.bic());
    assert_eq!((selection.best_by_bic(), selection.best_held_out()), (&false, Some(&false)));
    assert!(selection.to_string().lines().nth(1).unwrap().ends_with("3 failed"), "{selection}");
}

#[test]
fn learning_can_be_watched_and_broken_off() {
    let hmm = random_model(3, 4, 5);
    let sequences: Vec<_> =
        (0..5).map(|seed| hmm.simulate(40, &mut rng(seed)).observations().to_vec()).collect();
    let start = random_model(3, 4, 6);
    let learning = LearningOptions::default().with_iterations(9).with_tolerance(0.0);
    let mut seen = Vec::new();
    let learned = start.learn_until(&sequences, &learning, |now| {
        assert_eq!(now.iterations(), seen.len() + 1);
        seen.push(now.objective());
        if seen.len() == 4 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let learned = learned.unwrap();
    assert_eq!((learned.stopped(), learned.iterations()), (true, 4));
    assert!(!learned.converged() && learned.cause().is_none());
    assert_eq!(learned.objectives()[1..], seen);
    let all = start.learn(&sequences, &learning).unwrap();
    assert_eq!(all.objectives()[..=4], *learned.objectives());
    assert_eq!((all.stopped(), all.iterations()), (false, 9));
    assert!(!all.converged() && all.cause().is_none());
    // One stops at the last allowed iteration, and one converges.
    let broken = |tolerance: f64| {
        let last = learning.clone().with_iterations(1).with_tolerance(tolerance);
        start.learn_until(&sequences, &last, |_| ControlFlow::Break(())).unwrap()
    };
    assert!(broken(0.0).stopped() && !broken(0.0).converged());
    assert!(!broken(1e9).stopped() && broken(1e9).converged());
}

#[test]
fn what_cannot_be_chosen_or_doubted_is_an_error() {
    let hmm = random_model(2, 3, 5);
    let none: [Vec<usize>; 1] = [vec![]];
    assert!(matches!(hmm.criteria(&none), Err(LearnError::Nothing { sequences: 1, .. })));
    // Symbol 3 does not exist.
    let sequences = [vec![0, 1, 2, 2], vec![0, 3], vec![1, 1, 0]];
    let read = |hmm: &Model| vec![hmm.transition().get(0, 0)];
    let error =
        StandardErrors::from_jackknife(&hmm, &sequences, 2, &LearningOptions::default(), read)
            .unwrap_err();
    assert!(matches!(&error, LearnError::Sequence(error) if error.sequence == 1), "{error}");
}

#[test]
fn free_parameters_are_counted() {
    let prior = || Prior::AtFirstObservation(Belief::new(vec![0.5, 0.0, 0.5]).unwrap());
    let sparse = SparseTransition::from_rows(&[[0.5, 0.0, 0.5], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5]]);
    let sparse = sparse.unwrap();
    let table = TableLikelihood::from_rows(&[[0.5, 0.5], [1.0, 0.0], [0.2, 0.8]]).unwrap();
    let hmm = Hmm::new(prior(), sparse.clone(), table.clone()).unwrap();
    assert_eq!(hmm.free_parameters(), 1 + 3 + 2);
    let hmm = Hmm::new(prior(), Fixed(sparse.clone()), Fixed(table)).unwrap();
    assert_eq!(hmm.free_parameters(), 1);
    // Stays or goes on, with the same probability everywhere.
    let tied =
        ConstrainedTransition::new(sparse.clone()).with_ties(|from, to| usize::from(from == to));
    assert_eq!((tied.parameters(), tied.free_parameters()), (2, 1));
    let switched = SwitchedTransition::new(vec![sparse.clone(), sparse]).unwrap();
    assert_eq!(switched.free_parameters(), 6);
}

#[test]
fn no_observation_is_nothing_to_learn_from() {
    let hmm = random_model(2, 3, 5);
    let learning = LearningOptions::default();
    let empty: [Vec<usize>; 2] = [vec![], vec![]];
    for sequences in [&empty[..0], &empty] {
        let error = hmm.learn(sequences, &learning).unwrap_err();
        let expected = format!(
            "there is no observation to learn from, in {} sequences given",
            sequences.len()
        );
        assert_eq!(error.to_string(), expected);
        let labelled: Vec<_> = sequences
            .iter()
            .map(|y| LabelledSequence { initial: None, states: &[], sequence: y })
            .collect();
        assert_eq!(hmm.fit(&labelled, &learning).unwrap_err().to_string(), expected);
        let starts = [hmm.clone(), hmm.clone()];
        let error = Hmm::learn_best(&starts, sequences, &learning, |_, _| ()).unwrap_err();
        assert_eq!(error.to_string(), expected);
    }
    // A failing sequence is named, not the empty ones beside it.
    let error = hmm.learn(&[vec![], vec![7]], &learning).unwrap_err().to_string();
    assert!(
        error
            .starts_with("there is no observation to learn from, in 2 sequences given: sequence 1")
    );
    // Empty sequences have no influence on others.
    let (some, alone) = ([vec![], vec![0, 1, 2], vec![]], [vec![0, 1, 2]]);
    let [some, alone] = [&some[..], &alone].map(|all| hmm.learn(all, &learning).unwrap());
    assert_eq!((some.criteria().observations, alone.criteria().observations), (3, 3));
    assert!(near(some.objective(), alone.objective()));
}

/// Learning until probabilities underflow does not change the number of parameters.
#[test]
fn parameters_are_those_of_the_start_however_long_learning_goes_on() {
    let prior = Prior::AtFirstObservation(Belief::uniform(2).unwrap());
    let transition = DenseTransition::from_rows(&[[0.7, 0.4], [0.3, 0.6]]).unwrap();
    let table = TableLikelihood::from_rows(&[[0.8, 0.2], [0.3, 0.7]]).unwrap();
    let start = Hmm::new(prior, transition, table).unwrap();
    let ys: Vec<Vec<usize>> = vec![(0..60).map(|k| usize::from(k % 20 >= 10)).collect()];
    let tight = LearningOptions::default().with_iterations(20_000).with_tolerance(0.0);
    let learned = start.learn(&ys, &tight).unwrap();
    assert!(learned.model().free_parameters() < 5, "{:?}", learned.model());
    assert_eq!((start.free_parameters(), learned.free_parameters()), (5, 5));
    let criteria = learned.criteria();
    assert_eq!((criteria.parameters, criteria.observations), (5, 60));
    assert_eq!(criteria.log_likelihood, learned.log_likelihood());
    let loose = start.learn(&ys, &LearningOptions::default()).unwrap().criteria();
    assert!((loose.aic() - criteria.aic()).abs() < 1.0, "{loose:?} {criteria:?}");

    // By each way of learning, and in the choice among models.
    let best = Hmm::learn_best(std::slice::from_ref(&start), &ys, &tight, |_, _| ()).unwrap();
    assert_eq!(best.free_parameters(), 5);
    let mut seen = Vec::new();
    let watched = start.learn_until(&ys, &tight, |now| {
        seen.push(now.free_parameters());
        ControlFlow::Continue(())
    });
    assert!(watched.is_ok() && seen.iter().all(|count| *count == 5));
    let all = [ys[0].clone(), ys[0].clone()];
    let selection =
        ModelSelection::new(["two"], &all, 2, |_, some| start.learn(some, &tight)).unwrap();
    assert_eq!(selection.rows()[0].criteria.parameters, 5);

    // Zeros of the start are not parameters, and neither is a prior that is kept.
    let (prior, _, table) = start.clone().into_parts();
    let forbidden = DenseTransition::from_rows(&[[0.7, 0.0], [0.3, 1.0]]).unwrap();
    let start = Hmm::new(prior, forbidden, table).unwrap();
    assert_eq!(start.learn(&ys, &tight).unwrap().free_parameters(), 1 + 1 + 2);
    let kept = tight.with_keep_prior(true);
    assert_eq!(start.learn(&ys, &kept).unwrap().free_parameters(), 1 + 2);
}

#[test]
fn models_are_chosen_by_criteria_and_folds() {
    let truth = random_model(2, 3, 8);
    let sequences: Vec<_> =
        (0..7).map(|seed| truth.simulate(30, &mut rng(seed)).observations().to_vec()).collect();
    let learning = LearningOptions::default().with_iterations(5);
    let learn =
        |&states: &usize, some: &[&Vec<usize>]| random_model(states, 3, 77).learn(some, &learning);
    let selection = ModelSelection::new([1, 2, 3], &sequences, 3, learn).unwrap();
    for row in selection.rows() {
        let Candidate { candidate: states, criteria, held_out, failed, .. } = row;
        assert_eq!(*failed, 0);
        let all: Vec<_> = sequences.iter().collect();
        let model = learn(states, &all).unwrap().into_model();
        let sum: f64 = model.log_likelihood_all(&sequences).into_iter().map(Result::unwrap).sum();
        assert!(near(criteria.log_likelihood, sum));
        assert_eq!(criteria.observations, 210);
        assert_eq!(criteria.parameters, states * states - 1 + states * 2);
        let p = criteria.parameters as f64;
        assert!(near(criteria.aic(), 2.0 * (p - sum)));
        assert!(near(criteria.bic(), p * 210_f64.ln() - 2.0 * sum));
        assert_eq!(held_out.len(), 3);
        assert_eq!(row.held_out_observations, [90, 60, 60]);
        for (fold, log) in held_out.iter().enumerate() {
            let others: Vec<_> = (0..7).filter(|s| s % 3 != fold).map(|s| &sequences[s]).collect();
            let model = learn(states, &others).unwrap().into_model();
            let held = (0..7).filter(|s| s % 3 == fold).map(|s| &sequences[s]);
            let sum: f64 = held.map(|s| model.log_likelihood(s).unwrap()).sum();
            assert!(near(*log, sum));
        }
        let sum = row.held_out_log_likelihood().unwrap();
        assert_eq!(sum, held_out.iter().sum::<f64>());
        assert!(near(row.held_out_score().unwrap() * 210.0, sum));
    }
    let lowest = |value: &dyn Fn(usize) -> f64| {
        (1..3).fold(0, |best, at| if value(at) < value(best) { at } else { best }) + 1
    };
    assert_eq!(*selection.best_by_bic(), lowest(&|at| selection.rows()[at].criteria.bic()));
    assert_eq!(*selection.best_by_aic(), lowest(&|at| selection.rows()[at].criteria.aic()));
    let held_out = |at: usize| -selection.rows()[at].held_out_log_likelihood().unwrap();
    assert_eq!(*selection.best_held_out().unwrap(), lowest(&held_out));
    let table = selection.to_string();
    assert_eq!(table.lines().count(), 4);
    assert!(table.lines().next().unwrap().ends_with("held out"), "{table}");

    let without = ModelSelection::new([1, 2], &sequences, 0, learn).unwrap();
    assert_eq!(without.best_held_out(), None);
    assert_eq!(without.rows()[0].held_out_score(), None);
    assert!(matches!(
        ModelSelection::new([1], &sequences, 8, learn),
        Err(LearnError::Groups { groups: 8, sequences: 7 })
    ));
    let none: [usize; 0] = [];
    assert!(matches!(
        ModelSelection::new(none, &sequences, 0, learn),
        Err(LearnError::Nothing { .. })
    ));
}

/// A fold whose model rules out the held-out data scores −∞, and is not an error.
#[test]
fn what_was_never_seen_is_held_against_a_fold() {
    let sequences = [vec![0, 0, 1], vec![0, 1, 0], vec![2, 0, 0]];
    let learning = LearningOptions::default().with_iterations(3);
    let learn = |(): &(), some: &[&Vec<usize>]| random_model(2, 3, 77).learn(some, &learning);
    let selection = ModelSelection::new([()], &sequences, 3, learn).unwrap();
    let folds = &selection.rows()[0].held_out;
    assert!(folds[0].is_finite() && folds[1].is_finite());
    assert_eq!(folds[2], f64::NEG_INFINITY);
}
