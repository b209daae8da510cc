//! Every routine against the dense reference.

mod batches;
mod close;
mod learning;
mod paths;
mod products;
mod pruned;
mod streams;
mod whole;

use wayfix::error::At;
use wayfix::{Controlled, Hmm, HmmError, Sequence, Transition, TransitionEntries};

use crate::counts::Counts;
use crate::draw::Draw;
use crate::matrices;
use crate::model::{Matrix, Observation, Scene, Sensor};
use crate::reference::{Chain, Stop, logarithms};

/// Checks everything about a random model of 2 to 12 states.
pub fn differential(bytes: &[u8], counts: &mut Counts) {
    let mut draw = Draw::new(bytes);
    let states = 2 + draw.below(11);
    let scene = Scene::draw(&mut draw, states);
    if draw.one_in(3) {
        with_controls(&mut draw, &scene, counts);
    } else {
        without_controls(&mut draw, &scene, counts);
    }
}

fn without_controls(draw: &mut Draw<'_>, scene: &Scene, counts: &mut Counts) {
    counts.add("models without controls");
    let (operator, matrix) = matrices::plain(draw, scene.states, scene.range);
    counts.note(|| format!("{scene:?}\n{operator:?}\n{matrix:?}"));
    products::check(draw, &operator, &(), &matrix, counts);
    let logs = logarithms(&matrix);
    let hmm = scene.hmm(operator.clone());
    let chains: Vec<Chain> =
        scene.drives.iter().map(|drive| Chain::new(scene, |_| (&logs, None), drive)).collect();
    let controls = vec![(); scene.drives.iter().map(Vec::len).max().unwrap_or(0)];
    for (drive, chain) in scene.drives.iter().zip(&chains).take(3) {
        one(draw, &hmm, &controls[..drive.len()], drive, chain, counts);
        pruned::check(draw, &hmm, scene, (&controls[..drive.len()], drive), chain, counts);
    }
    batches::check(&hmm, &scene.drives, &chains, counts);
    learning::check(draw, scene, &operator, &matrix, &chains, counts);
}

fn with_controls(draw: &mut Draw<'_>, scene: &Scene, counts: &mut Counts) {
    counts.add("models with controls");
    let (operator, logs) = matrices::driven(draw, scene.states, scene.range);
    counts.note(|| format!("{scene:?}\n{operator:?}\n{logs:?}"));
    for (control, logs) in logs.iter().enumerate() {
        // Entries far from the smallest double, so that products of doubles keep their digits,
        // also if they are taken one factor after the other.
        let entries = logs.iter().flatten().filter(|log| **log > f64::NEG_INFINITY);
        if entries.into_iter().all(|log| log.abs() < 200.0) {
            let matrix: Matrix =
                logs.iter().map(|row| row.iter().map(|log| log.exp()).collect()).collect();
            products::check(draw, &operator, &control, &matrix, counts);
        }
    }
    let hmm = scene.hmm(operator);
    for drive in scene.drives.iter().take(4) {
        let controls: Vec<usize> = drive.iter().map(|_| draw.below(logs.len())).collect();
        let moves = |step: usize| {
            let control = controls[step - 1];
            (&logs[control], hmm.transition().evidence(&control))
        };
        let chain = Chain::new(scene, moves, drive);
        one(draw, &hmm, &controls, drive, &chain, counts);
        pruned::check(draw, &hmm, scene, (&controls, drive), &chain, counts);
    }
}

/// Checks all routines for one sequence.
fn one<A: TransitionEntries<Control: Clone + PartialEq>>(
    draw: &mut Draw<'_>,
    hmm: &Hmm<A, Sensor>,
    controls: &[A::Control],
    drive: &[Observation],
    chain: &Chain,
    counts: &mut Counts,
) {
    let sequence = Controlled::new(controls, drive).expect("a control each");
    streams::check(draw, hmm, controls, drive, chain, counts);
    paths::online(hmm, controls, drive, chain, counts);
    whole::check(hmm, &sequence, chain, counts);
    paths::check(draw, hmm, &sequence, chain, counts);
}

/// Returns the result if the reference has one; otherwise checks for the same error at the same
/// step.
fn expect<R>(
    what: &str,
    result: Result<R, HmmError>,
    chain: &Chain,
    counts: &mut Counts,
) -> Option<R> {
    let (error, stop) = match (result, chain.stop) {
        (Ok(result), None) => return Some(result),
        (Ok(_), Some(stop)) => panic!("{what}: a result, expected {stop:?}"),
        (Err(error), stop) => (error, stop),
    };
    assert!(stops(&error, stop), "{what}: {error} ({error:?}), expected {stop:?}");
    counts.add("errors");
    None
}

/// True if an error is the one that the reference expects, at the same step.
fn stops(error: &HmmError, expected: Option<Stop>) -> bool {
    expected.is_some_and(|stop| match *error {
        HmmError::Impossible { step } | HmmError::ImpossibleMove { step } => {
            stop.is_impossible(step)
        }
        HmmError::Likelihood(At { number: step, .. }) => stop.is_invalid(step),
        _ => false,
    })
}

/// A sequence of any kind.
trait Drive<A: TransitionEntries>: Sequence<A::Control, Observation> {}
impl<A: TransitionEntries, S: Sequence<A::Control, Observation>> Drive<A> for S {}
