//! Snapshots of filters and smoothers from JSON.

use wayfix::inference::{FilterSnapshot, FixedLagSnapshot};
use wayfix::{Hmm, TransitionEntries};

use super::{check_message, read};
use crate::counts::Counts;
use crate::draw::Draw;
use crate::matrices;
use crate::model::{Observation, Scene, Sensor};

/// Reads the damaged snapshot of a filter or a smoother on its way through a drive.
pub fn json_snapshots(bytes: &[u8], counts: &mut Counts) {
    let mut draw = Draw::new(bytes);
    let states = 2 + draw.below(5);
    let (filter, lag) = (draw.one_in(2), draw.below(4));
    let steps = draw.below(6);
    let controls: Vec<usize> = (0..steps).map(|_| draw.below(2)).collect();
    // First the damage to the document, then the model.
    let scene = Scene::draw(&mut draw, states);
    let nothing = vec![None; steps];
    let drive = scene.drives.iter().find(|drive| drive.len() >= steps).unwrap_or(&nothing);
    let (operator, matrices) = matrices::driven(&mut draw, states, scene.range);
    let hmm = scene.hmm(operator);
    let steps: Vec<_> =
        controls.iter().map(|control| control % matrices.len()).zip(&drive[..steps]).collect();
    if filter {
        filters(&mut draw, &hmm, &steps, counts);
    } else {
        smoothers(&mut draw, &hmm, &steps, lag, counts);
    }
}

fn filters<A: TransitionEntries<Control = usize>>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, Sensor>,
    steps: &[(usize, &Observation)],
    counts: &mut Counts,
) {
    let mut filter = hmm.filter();
    let possible = |step: &&(usize, &Observation)| filter.step_with(&step.0, step.1).is_ok();
    let _ = steps.iter().take_while(possible).count();
    let Some(state) = read::<FilterSnapshot>(draw, &filter.snapshot(), counts) else { return };
    let mut other = hmm.filter();
    if let Err(error) = other.restore(&state) {
        return check_message(&error);
    }
    for turn in 0..3 {
        // In the restored state, the observation need not be possible.
        let stepped = match (turn, steps.first()) {
            (0, _) | (_, None) => other.predict_with(&0),
            (_, Some((control, y))) => other.step_with(control, y).map(|_| ()),
        };
        stepped.unwrap_or_else(|error| check_message(&error));
        check(other.belief().as_slice(), other.log_likelihood());
        again(&other.snapshot());
    }
    counts.add("filters restored");
}

fn smoothers<A: TransitionEntries<Control = usize>>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, Sensor>,
    steps: &[(usize, &Observation)],
    lag: usize,
    counts: &mut Counts,
) {
    let mut smoother = hmm.fixed_lag(lag);
    let possible = |step: &&(usize, &Observation)| smoother.step_with(&step.0, step.1).is_ok();
    let _ = steps.iter().take_while(possible).count();
    let state = read::<FixedLagSnapshot<usize>>(draw, &smoother.snapshot(), counts);
    let Some(state) = state else { return };
    let mut other = hmm.fixed_lag(0);
    let before = other.snapshot();
    if let Err(error) = other.restore(&state) {
        assert_eq!(other.snapshot(), before, "the smoother after an error");
        return check_message(&error);
    }
    for turn in 0..3 {
        let stepped = match (turn, steps.first()) {
            (0, _) | (_, None) => other.predict_with(&0),
            (_, Some((control, y))) => other.step_with(control, y).map(|_| ()),
        };
        stepped.unwrap_or_else(|error| check_message(&error));
        check(other.filter().belief().as_slice(), other.filter().log_likelihood());
        check(other.lagged().as_slice(), 0.0);
        again(&other.snapshot());
    }
    counts.add("smoothers restored");
}

fn check(belief: &[f64], log_likelihood: f64) {
    let sum: f64 = belief.iter().sum();
    assert!((sum - 1.0).abs() < 1e-8, "a belief that sums to {sum}");
    assert!(belief.iter().all(|p| *p >= 0.0), "{belief:?}");
    assert!(!log_likelihood.is_nan(), "a log-likelihood that is NaN");
}

/// Checks that the state of a filter can be stored and read.
fn again<T: serde::Serialize + serde::de::DeserializeOwned>(state: &T) {
    let text = serde_json::to_string(state).expect("a document");
    let back: T = serde_json::from_str(&text)
        .unwrap_or_else(|error| panic!("a snapshot is not read again: {error}"));
    assert_eq!(serde_json::to_string(&back).expect("a document"), text);
}
