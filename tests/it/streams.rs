//! All streams have the same verbs, with the same meaning.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{Belief, Hmm, HmmError, LikelihoodVector, Prior, SparseTransition};

use crate::kit::{Kind, Model, all_close, cases, close_logs, models, weighted};

/// Observations of a second sensor before step 1, and at each of up to six steps.
pub(crate) fn more(states: usize) -> impl Strategy<Value = Vec<Option<Vec<f64>>>> {
    let log = prop_oneof![1 => Just(f64::NEG_INFINITY), 5 => (0.001..1.0).prop_map(f64::ln)];
    let logs = vec(log, states);
    vec(prop_oneof![1 => Just(None), 2 => logs.prop_map(Some)], 7)
}

fn added(one: Option<&Vec<f64>>, other: Option<&Vec<f64>>) -> Option<Vec<f64>> {
    match (one, other) {
        (Some(one), Some(other)) => Some(one.iter().zip(other).map(|(a, b)| a + b).collect()),
        (one, other) => one.or(other).cloned(),
    }
}

fn with_more(kind: Kind) -> impl Strategy<Value = (Model, Vec<Option<Vec<f64>>>)> {
    models(kind).prop_flat_map(|model| {
        let states = model.states;
        (Just(model), more(states))
    })
}

proptest! {
    #![proptest_config(cases())]

    /// A second sensor at a step equals one combined sensor, for all steps of the window.
    #[test]
    fn an_update_of_the_smoother_is_smoothing_with_both_sensors(
        (model, more) in with_more(Kind::Plain),
        lag in 0..8_usize,
        first_by_update in any::<bool>(),
    ) {
        let hmm = model.hmm(model.sparse());
        let (mut smoother, mut filter) = (hmm.fixed_lag(lag), hmm.filter());
        let mut both = Model { logs: Vec::new(), ..model.clone() };
        for (control, (y, more)) in model.logs.iter().zip(&more[1..]).enumerate() {
            let k = control + 1;
            let by_update = k == 1 && model.at_first && first_by_update;
            let mut results = Vec::new();
            if by_update {
                results.push((smoother.update(y), filter.update(y)));
            } else {
                results.push((smoother.step_with(&control, y), filter.step_with(&control, y)));
            }
            if results[0].0.is_ok() {
                let before = smoother.snapshot();
                results.push((smoother.update(more), filter.update(more)));
                if results[1].0.is_err() {
                    prop_assert_eq!(smoother.snapshot(), before);
                }
            }
            for (found, expected) in &results {
                prop_assert_eq!(format!("{found:?}"), format!("{expected:?}"));
            }
            prop_assert_eq!(smoother.filter().snapshot(), filter.snapshot());
            both.logs.push(added(y.as_ref(), more.as_ref()));
            let answer = both.enumerate();
            if results.iter().any(|result| result.0.is_err()) {
                prop_assert_eq!(answer.impossible_at, Some(k));
                break;
            }
            close_logs(filter.log_likelihood(), answer.log_likelihood, 1e-12)?;
            for (j, expected) in answer.smoothed.iter().enumerate() {
                match smoother.get(j) {
                    Some(found) => all_close(found.as_slice(), expected, 1e-11, 1e-280)?,
                    None => prop_assert!(j + lag < k),
                }
            }
            prop_assert_eq!(smoother.get(k + 1), None);
            prop_assert_eq!(Some(smoother.lagged()), smoother.get(k.saturating_sub(lag)));
            let mut other = hmm.fixed_lag(0);
            other.restore(&smoother.snapshot()).unwrap();
            prop_assert_eq!(other.snapshot(), smoother.snapshot());
            prop_assert_eq!(other.lagged(), smoother.lagged());
        }
    }

    /// Before any step it is an observation of X_0.
    #[test]
    fn an_update_before_the_first_step_is_of_the_prior(
        (model, more) in with_more(Kind::Plain).prop_filter("before", |(model, more)| {
            !model.at_first && more[0].is_some()
        }),
        lag in 0..8_usize,
    ) {
        let hmm = model.hmm(model.sparse());
        let mut smoother = hmm.fixed_lag(lag);
        let weights: Vec<f64> = more[0].iter().flatten().zip(&model.prior)
            .map(|(log, p)| log.exp() * p).collect();
        let Ok(prior) = Belief::from_weights(weights) else {
            prop_assert!(smoother.update(&more[0]).is_err());
            return Ok(());
        };
        smoother.update(&more[0]).unwrap();
        prop_assert_eq!(smoother.filter().steps(), 0);
        let log = smoother.filter().log_likelihood();
        let model = Model { prior: prior.into_vec(), ..model };
        for k in 1..=model.steps() {
            let part = Model { logs: model.logs[..k].to_vec(), ..model.clone() };
            let answer = part.enumerate();
            if smoother.step_with(&(k - 1), &model.logs[k - 1]).is_err() {
                prop_assert_eq!(answer.impossible_at, Some(k));
                break;
            }
            close_logs(smoother.filter().log_likelihood() - log, answer.log_likelihood, 1e-11)?;
            for (j, expected) in answer.smoothed.iter().enumerate().skip(k.saturating_sub(lag)) {
                all_close(smoother.get(j).unwrap().as_slice(), expected, 1e-11, 1e-280)?;
            }
        }
    }

    /// After a relocation, the smoother is that of a drive that begins there.
    #[test]
    fn a_relocation_begins_a_new_stretch(
        (model, place) in models(Kind::Plain).prop_flat_map(|model| {
            let states = model.states;
            (Just(model), weighted(prop_oneof![1 => Just(0.0), 2 => 0.01..1.0], states))
        }),
        at in 0..7_usize,
        lag in 0..8_usize,
    ) {
        let hmm = model.hmm(model.sparse());
        let mut smoother = hmm.fixed_lag(lag);
        let at = at.min(model.steps());
        for k in 1..=at {
            if smoother.step_with(&(k - 1), &model.logs[k - 1]).is_err() {
                return Ok(());
            }
        }
        let (before, belief) = (smoother.filter().log_likelihood(), Belief::new(place).unwrap());
        smoother.relocate(&belief).unwrap();
        prop_assert_eq!(smoother.lagged().as_slice(), belief.as_slice());
        prop_assert_eq!(smoother.filter().log_likelihood(), before);
        let rest = Model {
            prior: belief.into_vec(),
            at_first: model.at_first && at == 0,
            matrices: model.matrices[at..].to_vec(),
            logs: model.logs[at..].to_vec(),
            ..model.clone()
        };
        for k in 1..=rest.steps() {
            let part = Model { logs: rest.logs[..k].to_vec(), ..rest.clone() };
            let answer = part.enumerate();
            if smoother.step_with(&(at + k - 1), &rest.logs[k - 1]).is_err() {
                prop_assert_eq!(answer.impossible_at, Some(k));
                break;
            }
            let log = smoother.filter().log_likelihood() - before;
            close_logs(log, answer.log_likelihood, 1e-11)?;
            for (j, expected) in answer.smoothed.iter().enumerate() {
                match smoother.get(at + j) {
                    Some(found) => all_close(found.as_slice(), expected, 1e-11, 1e-280)?,
                    None => prop_assert!(j + lag < k),
                }
            }
            for j in 0..at {
                // (Under a prior at the first observation, X_0 is X_1.)
                prop_assert!(smoother.get(j).is_none() || (at, model.at_first) == (1, true));
            }
            let mut other = hmm.fixed_lag(3);
            other.restore(&smoother.snapshot()).unwrap();
            prop_assert_eq!(other.snapshot(), smoother.snapshot());
            prop_assert_eq!(other.lagged(), smoother.lagged());
        }
    }
}

fn two_places() -> Hmm<SparseTransition, LikelihoodVector> {
    let motion = SparseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]]).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::uniform(2).unwrap());
    Hmm::new(prior, motion, LikelihoodVector::linear(2)).unwrap()
}

#[test]
fn what_is_refused_leaves_the_smoother_as_it_was() {
    let hmm = two_places();
    let mut smoother = hmm.fixed_lag(2);
    smoother.step(&[0.9, 0.2]).unwrap();
    let before = smoother.snapshot();
    assert!(matches!(smoother.update(&[0.0, 0.0]), Err(HmmError::Impossible { step: 1 })));
    let text = smoother.relocate(&Belief::uniform(3).unwrap()).unwrap_err().to_string();
    assert_eq!(text, "the belief has 3 states, expected 2 to match the model");
    assert_eq!(smoother.snapshot(), before);
    assert!(smoother.get(0).is_some());
}

#[test]
fn posteriors_are_beside_observations_or_from_the_start() {
    let hmm = two_places();
    let smoothing = hmm.smooth(&[[0.9, 0.2], [0.1, 0.8], [0.1, 0.8]]).unwrap();
    let posteriors = smoothing.posteriors();
    let modes: Vec<usize> = posteriors.iter().map(|belief| belief.mode()).collect();
    assert_eq!(modes, posteriors.modes());
    let all: Vec<_> = posteriors.with_start().collect();
    assert_eq!(all.len(), 4);
    assert!((0..4).all(|step| posteriors.get(step) == Some(all[step])));
    assert_eq!(posteriors.iter().next_back(), posteriors.get(3));
    let last = all[3].peak();
    assert_eq!((last.0, Some(last.1)), (1, all[3].probability(1)));
    // Without observations, it is the start.
    let nothing = hmm.smooth::<[[f64; 2]]>(&[]).unwrap();
    assert_eq!(
        (nothing.posteriors().iter().len(), nothing.posteriors().with_start().len()),
        (0, 1)
    );
}

#[test]
fn marginals_go_where_there_is_room() {
    let groups = wayfix::likelihood::Groups::new(vec![1, 0, 1]).unwrap();
    let belief = Belief::new(vec![0.25, 0.5, 0.25]).unwrap();
    let mut out = [7.0; 2];
    groups.marginal_into(&belief, &mut out).unwrap();
    assert_eq!(out, [0.5, 0.5]);
    let text = groups.marginal_into(&belief, &mut [0.0; 3]).unwrap_err().to_string();
    assert_eq!(text, "the length of the slice is 3, expected 2");
    let two = Belief::uniform(2).unwrap();
    let text = groups.marginal_into(&two, &mut out).unwrap_err().to_string();
    assert_eq!(text, "the number of states of the belief is 2, expected 3");
    assert_eq!(out, [0.5, 0.5]);
}
