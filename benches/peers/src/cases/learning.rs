//! Baum–Welch.

use std::fs;
use std::time::Instant;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde_json::json;
use wayfix::inference::{LearnedModel, LearningOptions, Simulation};
use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};

use crate::model::{Entry, distribution, full, matrix, write_model};
use crate::race::Races;
use crate::{Failure, Folders, npy};

pub(crate) const CASE: &str = "learning";
const STATES: usize = 10;
const SYMBOLS: usize = 20;
const SEQUENCES: usize = 50;
const STEPS: usize = 100;
/// The re-estimations after the first.
const MORE: usize = 20;

type Model = Hmm<DenseTransition, TableLikelihood>;

/// A random model, with its entries and its table.
struct Parts {
    entries: Vec<Entry>,
    prior: Vec<f64>,
    table: Vec<Vec<f64>>,
}

impl Parts {
    fn random(rng: &mut ChaCha8Rng) -> Self {
        let entries = full(STATES, rng);
        let prior = distribution(STATES, rng);
        let table = (0..STATES).map(|_| distribution(SYMBOLS, rng)).collect();
        Self { entries, prior, table }
    }

    fn hmm(&self) -> Result<Model, Failure> {
        let transition = DenseTransition::from_row_major(STATES, &matrix(STATES, &self.entries))?;
        let prior = Prior::AtFirstObservation(Belief::new(self.prior.clone())?);
        Ok(Hmm::new(prior, transition, TableLikelihood::from_rows(&self.table)?)?)
    }
}

pub(crate) fn run(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let truth = Parts::random(&mut rng).hmm()?;
    let simulated: Vec<Simulation<usize>> =
        (0..SEQUENCES).map(|_| truth.simulate(STEPS, &mut rng)).collect();
    let seen: Vec<&[usize]> = simulated.iter().map(Simulation::observations).collect();
    let start = Parts::random(&mut rng);
    let hmm = start.hmm()?;

    let (learned, _) = learn(&hmm, &seen, 1 + MORE)?;
    let folder = folders.out.join(CASE);
    write_model(&folder, STATES, &start.prior, &start.entries)?;
    npy::doubles(&folder.join("table.npy"), &[STATES, SYMBOLS], &start.table.concat())?;
    npy::indices(&folder.join("symbols.npy"), &[SEQUENCES, STEPS], &seen.concat())?;
    let sizes = json!({
        "states": STATES,
        "symbols": SYMBOLS,
        "sequences": SEQUENCES,
        "steps": STEPS,
        "more": MORE,
        // As given, and after each re-estimation.
        "log_likelihoods": learned.objectives(),
    });
    fs::write(folder.join("model.json"), serde_json::to_string_pretty(&sizes)?)?;
    let transition = learned.model().transition();
    let matrix: Vec<f64> =
        (0..STATES * STATES).map(|at| transition.get(at / STATES, at % STATES)).collect();
    npy::doubles(&folder.join("learned_transition.npy"), &[STATES, STATES], &matrix)?;

    // One re-estimation is what some more of them take longer.
    let mut times = Vec::new();
    for _ in 0..races.repetitions() {
        let (_, one) = learn(&hmm, &seen, 1)?;
        let (_, all) = learn(&hmm, &seen, 1 + MORE)?;
        times.push((all - one) * 1e6 / (MORE * SEQUENCES * STEPS) as f64);
    }
    races.add(CASE, "iteration", "wayfix", 0.0, times);
    Ok(())
}

/// So many re-estimations, and the seconds that they take with the E-step that
/// comes first.
fn learn(
    hmm: &Model,
    seen: &[&[usize]],
    iterations: usize,
) -> Result<(LearnedModel<DenseTransition, TableLikelihood>, f64), Failure> {
    let learning = LearningOptions { iterations, tolerance: 0.0, ..LearningOptions::default() };
    let start = Instant::now();
    let learned = hmm.learn(seen, &learning)?;
    let seconds = start.elapsed().as_secs_f64();
    if learned.iterations() < iterations {
        return Err("learning stopped early".into());
    }
    Ok((learned, seconds))
}
