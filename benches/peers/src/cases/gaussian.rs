//! Baum–Welch with Gaussian vectors.

use std::fs;
use std::time::Instant;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use serde_json::json;
use wayfix::emission::{Gaussian, Rows};
use wayfix::inference::{LearnedModel, LearningOptions};
use wayfix::{Belief, DenseTransition, Hmm, Prior};

use crate::model::{Entry, distribution, full, matrix, write_model};
use crate::race::Races;
use crate::{Failure, Folders, npy};

pub(crate) const CASE: &str = "gaussian";
const STATES: usize = 8;
const COMPONENTS: usize = 6;
const SEQUENCES: usize = 50;
const STEPS: usize = 1000;
/// The re-estimations after the first.
const MORE: usize = 20;

type Model = Hmm<DenseTransition, Gaussian>;

/// A random model, with its entries, means and full covariances.
struct Parts {
    entries: Vec<Entry>,
    prior: Vec<f64>,
    means: Vec<Vec<f64>>,
    covariances: Vec<Vec<f64>>,
}

impl Parts {
    fn random(rng: &mut ChaCha8Rng) -> Self {
        let mut normal = |scale: f64, count: usize| -> Vec<f64> {
            (0..count).map(|_| scale * Distribution::<f64>::sample(&StandardNormal, rng)).collect()
        };
        let d = COMPONENTS;
        let means = (0..STATES).map(|_| normal(1.5, d)).collect();
        let covariance = |b: Vec<f64>| {
            let entry = |i: usize, j: usize| {
                let products = (0..d).map(|k| b[i * d + k] * b[j * d + k]).sum::<f64>();
                products + if i == j { 0.4 } else { 0.0 }
            };
            (0..d * d).map(|at| entry(at / d, at % d)).collect()
        };
        let covariances = (0..STATES).map(|_| covariance(normal(0.6, d * d))).collect();
        let entries = full(STATES, rng);
        let prior = distribution(STATES, rng);
        Self { entries, prior, means, covariances }
    }

    fn hmm(&self) -> Result<Model, Failure> {
        let transition = DenseTransition::from_row_major(STATES, &matrix(STATES, &self.entries))?;
        let prior = Prior::AtFirstObservation(Belief::new(self.prior.clone())?);
        Ok(Hmm::new(prior, transition, Gaussian::full(&self.means, &self.covariances)?)?)
    }
}

pub(crate) fn run(races: &mut Races, folders: &Folders) -> Result<(), Failure> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let truth = Parts::random(&mut rng);
    let hmm = truth.hmm()?;
    let drawn: Vec<Vec<f64>> =
        (0..SEQUENCES).map(|_| hmm.simulate(STEPS, &mut rng).observations().concat()).collect();
    let rows = |values| Rows::new(values, COMPONENTS);
    let seen = drawn.iter().map(|values| rows(values)).collect::<Result<Vec<Rows<'_>>, _>>()?;
    // From other transitions, round covariances and moved means.
    let mut start = Parts::random(&mut rng);
    for (mean, truth) in start.means.iter_mut().zip(&truth.means) {
        mean.iter_mut().zip(truth).for_each(|(mean, truth)| *mean = truth + 0.3 * *mean);
    }
    let round = |at: usize| if at / COMPONENTS == at % COMPONENTS { 1.5 } else { 0.0 };
    start.covariances = vec![(0..COMPONENTS * COMPONENTS).map(round).collect(); STATES];
    let hmm = start.hmm()?;

    let (learned, _) = learn(&hmm, &seen, 1 + MORE)?;
    let folder = folders.out.join(CASE);
    write_model(&folder, STATES, &start.prior, &start.entries)?;
    let write = |name: &str, shape: &[usize], values: &[f64]| {
        npy::doubles(&folder.join(name), shape, values)
    };
    let (vectors, matrices) = ([STATES, COMPONENTS], [STATES, COMPONENTS, COMPONENTS]);
    write("rows.npy", &[SEQUENCES, STEPS, COMPONENTS], &drawn.concat())?;
    write("means.npy", &vectors, &start.means.concat())?;
    write("covariances.npy", &matrices, &start.covariances.concat())?;
    let found = learned.model();
    write("learned_means.npy", &vectors, &found.likelihood().means().concat())?;
    write("learned_covariances.npy", &matrices, &found.likelihood().covariances().concat())?;
    let paths = seen.iter().map(|rows| Ok(found.viterbi(rows)?.states().to_vec()));
    let paths = paths.collect::<Result<Vec<Vec<usize>>, Failure>>()?;
    npy::indices(&folder.join("paths.npy"), &[SEQUENCES, STEPS], &paths.concat())?;
    let sizes = json!({
        "states": STATES,
        "more": MORE,
        // As given, and after each re-estimation.
        "log_likelihoods": learned.objectives(),
    });
    fs::write(folder.join("model.json"), serde_json::to_string_pretty(&sizes)?)?;

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
    seen: &[Rows<'_>],
    iterations: usize,
) -> Result<(LearnedModel<DenseTransition, Gaussian>, f64), Failure> {
    let learning = LearningOptions { iterations, tolerance: 0.0, ..LearningOptions::default() };
    let start = Instant::now();
    let learned = hmm.learn(seen, &learning)?;
    let seconds = start.elapsed().as_secs_f64();
    if learned.iterations() < iterations {
        return Err("learning stopped early".into());
    }
    Ok((learned, seconds))
}
