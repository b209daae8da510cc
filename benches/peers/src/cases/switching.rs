//! Regressions that switch: with one matrix, and with moves that depend on inputs.

use std::fs;
use std::hint::black_box;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use serde_json::json;
use wayfix_learn::LinearRegression;
use wayfix_learn::LogitTransition;
use wayfix::{
    Belief, Controlled, Hmm, Prior, Sequence, SparseTransition, Transition, TransitionEntries,
};

use crate::model::{Entry, full, observed, write_model};
use crate::race::{Contender, Races};
use crate::{Failure, Folders, npy};

pub(crate) const REGRESSION: &str = "switching regression";
pub(crate) const WITH_INPUTS: &str = "moves with inputs";

const STATES: usize = 3;
const STEPS: usize = 5000;
/// Inputs of the regression, and of the moves.
const INPUTS: usize = 2;

pub(crate) fn regression(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let entries = full(STATES, &mut rng);
    let transition = SparseTransition::from_triplets(STATES, entries.clone())?;
    let (family, rows) = drawn(&mut rng)?;
    write(REGRESSION, &family, &rows, &entries, folders)?;
    answer(REGRESSION, &Hmm::new(prior(&transition)?, transition, family)?, &rows, races, folders)
}

pub(crate) fn with_inputs(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let entries = full(STATES, &mut rng);
    let mut moves =
        LogitTransition::new(&SparseTransition::from_triplets(STATES, entries.clone())?, INPUTS)?;
    // Log-odds relative to the stay.
    let (mut intercepts, mut slopes) = (Vec::new(), Vec::new());
    for (from, to) in (0..STATES).flat_map(|from| (0..STATES).map(move |to| (from, to))) {
        if from != to {
            moves = moves.with_slopes(from, to, &normals(INPUTS, &mut rng))?;
        }
        intercepts.push(moves.intercept(from, to).unwrap_or(0.0));
        let none: &[f64] = &[0.0; INPUTS]; // slopes of the reference
        slopes.extend(moves.slopes(from, to).filter(|s| !s.is_empty()).unwrap_or(none));
    }
    let inputs: Vec<Vec<f64>> = (0..STEPS).map(|_| normals(INPUTS, &mut rng)).collect();
    let (family, rows) = drawn(&mut rng)?;
    write(WITH_INPUTS, &family, &rows, &entries, folders)?;
    let folder = folders.out.join(WITH_INPUTS);
    npy::doubles(&folder.join("inputs.npy"), &[STEPS, INPUTS], &inputs.concat())?;
    npy::doubles(&folder.join("move_intercepts.npy"), &[STATES, STATES], &intercepts)?;
    npy::doubles(&folder.join("move_slopes.npy"), &[STATES, STATES, INPUTS], &slopes)?;
    let sequence = Controlled::new(&inputs, &rows)?;
    answer(
        WITH_INPUTS,
        &Hmm::new(prior(&moves.at(&inputs[0])?)?, moves, family)?,
        &sequence,
        races,
        folders,
    )
}

/// Distribution that is uniform two moves before the first observation, with the second move by the
/// model's operator: statsmodels' reading of the probabilities that it is given.
fn prior(first: &SparseTransition) -> Result<Prior, Failure> {
    let mut moved = [0.0; STATES];
    first.apply(&(), &[1.0 / STATES as f64; STATES], &mut moved);
    Ok(Prior::BeforeFirstTransition(Belief::new(moved.to_vec())?))
}

fn normals(count: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    (0..count).map(|_| StandardNormal.sample(rng)).collect()
}

/// A family, and rows of inputs and an output, from stays of twenty steps.
fn drawn(rng: &mut ChaCha8Rng) -> Result<(LinearRegression, Vec<Vec<f64>>), Failure> {
    let coefficients: Vec<_> = (0..STATES).map(|_| normals(INPUTS, rng)).collect();
    let (intercepts, variances) = ([[-1.0], [0.0], [1.0]], [[0.25], [1.0], [4.0]]);
    let family = LinearRegression::full(&coefficients, &intercepts, &variances)?;
    let row = |step: usize| {
        let (state, mut row) = (step / 20 % STATES, normals(INPUTS, rng));
        let noise: f64 = StandardNormal.sample(rng);
        row.push(family.predict(state, &row)?[0] + noise * variances[state][0].sqrt());
        Ok(row)
    };
    let rows = (0..STEPS).map(row).collect::<Result<_, Failure>>()?;
    Ok((family, rows))
}

fn write(
    case: &str,
    family: &LinearRegression,
    rows: &[Vec<f64>],
    entries: &[Entry],
    folders: &Folders,
) -> Result<(), Failure> {
    let folder = folders.out.join(case);
    write_model(&folder, STATES, &[1.0 / STATES as f64; STATES], entries)?;
    let states = 0..STATES;
    let coefficients: Vec<_> = states.clone().filter_map(|i| family.coefficients(i)).collect();
    let intercepts: Vec<_> = states.filter_map(|i| family.intercept(i)).collect();
    npy::doubles(&folder.join("rows.npy"), &[STEPS, INPUTS + 1], &rows.concat())?;
    npy::doubles(&folder.join("coefficients.npy"), &[STATES, INPUTS], &coefficients.concat())?;
    npy::doubles(&folder.join("intercepts.npy"), &[STATES], &intercepts.concat())?;
    let variances = family.noise().covariances().concat();
    Ok(npy::doubles(&folder.join("variances.npy"), &[STATES], &variances)?)
}

/// Writes the answers and times two routines.
fn answer<A: TransitionEntries>(
    case: &'static str,
    hmm: &Hmm<A, LinearRegression>,
    sequence: &(impl Sequence<A::Control, [f64]> + ?Sized),
    races: &mut Races,
    folders: &Folders,
) -> Result<(), Failure> {
    let folder = folders.out.join(case);
    let filtering = hmm.forward(sequence)?;
    let sizes = json!({
        "states": STATES,
        "steps": STEPS,
        "log_likelihood": filtering.log_likelihood(),
    });
    fs::write(folder.join("model.json"), serde_json::to_string_pretty(&sizes)?)?;
    let shape = [STEPS, STATES];
    let smoothed = observed(hmm.smooth(sequence)?.posteriors());
    npy::doubles(&folder.join("filtered.npy"), &shape, &observed(filtering.posteriors()))?;
    npy::doubles(&folder.join("smoothed.npy"), &shape, &smoothed)?;
    let mut run = |routine, contender| races.run(case, routine, STEPS, vec![contender]);
    run("score", Contender::wayfix(|| drop(black_box(hmm.log_likelihood(black_box(sequence))))));
    run("smooth", Contender::wayfix(|| drop(black_box(hmm.smooth(black_box(sequence))))));
    Ok(())
}
