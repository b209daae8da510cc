//! Control k drives the transition from k − 1 to k.

use std::sync::Arc;

use wayfix::error::At;
use wayfix::inference::{LearningOptions, Order};
use wayfix::likelihood::SparseObservation;
use wayfix::transition::SwitchedTransition;
use wayfix::{
    Belief, Controlled, DenseTransition, FusedLikelihood, Hmm, HmmError, Likelihood,
    LikelihoodVector, OptionalLikelihood, Prior, SparseLikelihood, TableLikelihood, Transition,
};

use crate::kit::rng;

/// Control 0 stays, control 1 moves to the next of three places on a loop.
fn hmm(prior: Prior) -> Hmm<SwitchedTransition<DenseTransition>, LikelihoodVector> {
    let stay = DenseTransition::from_fn(3, |i, j| f64::from(i == j)).unwrap();
    let go = DenseTransition::from_fn(3, |i, j| f64::from(i == (j + 1) % 3)).unwrap();
    let gears = SwitchedTransition::new(vec![stay, go]).unwrap();
    Hmm::new(prior, gears, LikelihoodVector::linear(3)).unwrap()
}

const NOTHING: [f64; 3] = [1.0; 3];

#[test]
fn a_control_drives_the_step_to_its_observation() {
    let hmm = hmm(Prior::BeforeFirstTransition(Belief::certain(3, 0).unwrap()));
    let controls = [1, 0, 1];
    let expected = [1, 1, 2];
    let drive = Controlled::new(&controls, &[NOTHING; 3]).unwrap();
    assert_eq!(hmm.forward(&drive).unwrap().posteriors().modes(), expected);
    assert_eq!(hmm.smooth(&drive).unwrap().posteriors().modes(), expected);
    assert_eq!(hmm.viterbi(&drive).unwrap().states(), expected);
    let mut filter = hmm.filter();
    for (control, state) in controls.iter().zip(expected) {
        filter.step_with(control, &NOTHING).unwrap();
        assert_eq!(filter.belief().mode(), state);
    }
}

#[test]
fn the_first_control_is_not_looked_at_if_the_prior_is_at_the_first_observation() {
    let hmm = hmm(Prior::AtFirstObservation(Belief::certain(3, 0).unwrap()));
    let controls = [usize::MAX, 1, 0];
    let expected = [0, 1, 1];
    let drive = Controlled::new(&controls, &[NOTHING; 3]).unwrap();
    let smoothing = hmm.smooth(&drive).unwrap();
    assert_eq!(smoothing.posteriors().modes(), expected);
    assert_eq!(smoothing.posteriors().get(0), smoothing.posteriors().get(1));
    assert_eq!(hmm.viterbi(&drive).unwrap().states(), expected);
}

#[test]
fn an_unknown_control_or_a_missing_one_is_an_error_and_the_filter_stays() {
    let hmm = hmm(Prior::BeforeFirstTransition(Belief::certain(3, 0).unwrap()));
    let mut filter = hmm.filter();
    filter.step_with(&1, &NOTHING).unwrap();
    let before = filter.snapshot();
    let error = filter.step_with(&2, &NOTHING).unwrap_err();
    assert_eq!(
        error.to_string(),
        "step 2 has no valid control: operator 2, expected one of 2 (0 to 1)"
    );
    assert!(std::error::Error::source(&error).is_none(), "it has been said");
    assert_eq!(filter.snapshot(), before);
    assert!(filter.predict_with(&2).is_err());
    assert!(filter.forecast_with(&[0, 2]).is_err());
    assert_eq!(filter.snapshot(), before);

    let error = hmm.smooth(&Controlled::new(&[0, 2], &[NOTHING; 2]).unwrap()).unwrap_err();
    assert!(matches!(error, HmmError::Control(At { number: 2, .. })));
    let error = hmm.viterbi(&Controlled::new(&[0, 2], &[NOTHING; 2]).unwrap()).unwrap_err();
    assert!(matches!(error, HmmError::Control(At { number: 2, .. })));
    let error = Controlled::new(&[0], &[NOTHING; 2]).unwrap_err();
    assert_eq!(error.to_string(), "1 controls for 2 observations, expected one each");
}

#[test]
fn operators_and_sensors_can_be_shared_and_chosen_at_run_time() {
    let go = DenseTransition::from_fn(3, |i, j| f64::from(i == (j + 1) % 3)).unwrap();
    let go = Arc::new(go);
    let sensors: [Box<dyn Likelihood<Observation = [f64]>>; 2] =
        [Box::new(LikelihoodVector::linear(3)), Box::new(LikelihoodVector::log(3))];
    for sensor in sensors {
        let prior = Prior::BeforeFirstTransition(Belief::certain(3, 0).unwrap());
        let hmm = Hmm::new(prior, Arc::clone(&go), sensor).unwrap();
        let ys = [[1.0; 3], [1.0; 3]];
        assert_eq!(hmm.viterbi(&ys).unwrap().states(), [1, 2]);
        assert_eq!(hmm.smooth(&ys).unwrap().posteriors().modes(), [1, 2]);
    }
}

/// All routines, streaming and batch, in both conventions: control k drives
/// k − 1 → k.
#[test]
fn in_every_routine_a_control_drives_the_step_to_its_observation() {
    let start = || Belief::certain(3, 0).unwrap();
    for (prior, expected) in [
        (Prior::BeforeFirstTransition(start()), [1, 1, 2, 0]),
        (Prior::AtFirstObservation(start()), [0, 0, 1, 2]),
    ] {
        let hmm = hmm(prior);
        let controls = [1, 0, 1, 1];
        let ys = [NOTHING; 4];
        let drive = Controlled::new(&controls, &ys).unwrap();
        let (mut lagged, mut online) = (hmm.fixed_lag(2), hmm.online_viterbi());
        let mut path = Vec::new();
        for (k, control) in controls.iter().enumerate() {
            lagged.step_with(control, &NOTHING).unwrap();
            assert_eq!(lagged.get(k + 1).unwrap().mode(), expected[k]);
            path.extend_from_slice(online.step_with(control, &NOTHING).unwrap());
        }
        assert_eq!(path, expected);
        assert_eq!(hmm.k_best(&drive, 9).unwrap()[0].states(), expected);
        let mut rng = rng(1);
        assert_eq!(hmm.path_sampler(&drive).unwrap().draw(&mut rng).unwrap(), expected);
        assert_eq!(hmm.path_entropy(&drive).unwrap(), 0.0);
        assert_eq!(hmm.smooth_all(&[drive])[0].as_ref().unwrap().posteriors().modes(), expected);
        for order in [Order::Forward, Order::Backward] {
            hmm.smooth_each(&drive, order, |step| {
                if let (k @ 1.., Some(mut moves)) = (step.step(), step.moves()) {
                    let m = moves.find(|m| m.weight > 0.5).unwrap();
                    assert_eq!((m.from + controls[k - 1]) % 3, m.to);
                    assert_eq!(m.to, expected[k - 1]);
                }
            })
            .unwrap();
        }
        let ahead = hmm.filter().forecast_with(&controls).unwrap();
        assert_eq!(ahead.mode(), expected[3]);
        // Each operator is learned from the steps that it drove.
        let table = TableLikelihood::from_rows(&[[0.5, 0.5]; 3]).unwrap();
        let loose = |stay: f64| {
            DenseTransition::from_fn(3, |i, j| match (i + 3 - j) % 3 {
                0 => stay,
                1 => 1.0 - stay,
                _ => 0.0,
            })
        };
        let gears =
            SwitchedTransition::new(vec![loose(0.9).unwrap(), loose(0.2).unwrap()]).unwrap();
        let sensor =
            FusedLikelihood::new(table, OptionalLikelihood::new(SparseLikelihood::new(3))).unwrap();
        let learner = Hmm::new(hmm.prior().clone(), gears, sensor).unwrap();
        let known = expected.map(|state| (0, Some(SparseObservation::known(state))));
        let drive = Controlled::new(&controls, &known).unwrap();
        let learned = learner.learn(&[drive], &LearningOptions::default()).unwrap().into_model();
        for (k, pair) in (1..).zip(expected.windows(2)) {
            let (mut x, mut out) = ([0.0; 3], [0.0; 3]);
            x[pair[0]] = 1.0;
            learned.transition().apply(&controls[k], &x, &mut out);
            assert_eq!(out[pair[1]], 1.0, "step {}", k + 1);
        }
    }
}
