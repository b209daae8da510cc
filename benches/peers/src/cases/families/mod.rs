//! Baum–Welch with each family of observations: the parts that all cases share.

mod counts;
mod gaussian;
mod regression;

use std::fs;
use std::hint::black_box;
use std::time::Instant;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use serde_json::json;
use wayfix_learn::Rows;
use wayfix::inference::{LearnedModel, LearningOptions};
use wayfix::likelihood::{LearnLikelihood, Likelihood, SampleObservation};
use wayfix::{Belief, DenseTransition, Hmm, Prior, Sequence};

use crate::model::{Entry, distribution, full, matrix, observed, write_model};
use crate::race::{Contender, Races};
use crate::{Failure, Folders, Run, npy};

/// Cases by family, with the names that the Python programs use, too.
pub(crate) const CASES: [(&str, Run); 13] = [
    (counts::CATEGORICAL, counts::categorical),
    (gaussian::FULL, gaussian::full),
    (gaussian::TIED, gaussian::tied),
    (gaussian::DIAGONAL, gaussian::diagonal),
    (gaussian::SPHERICAL, gaussian::spherical),
    (gaussian::FULL_MIXTURE, gaussian::full_mixture),
    (gaussian::DIAGONAL_MIXTURE, gaussian::diagonal_mixture),
    (counts::POISSON, counts::poisson),
    (counts::BERNOULLI, counts::bernoulli),
    (counts::MULTINOMIAL, counts::multinomial),
    (counts::GAMMA, counts::gamma),
    (regression::REGRESSION, regression::regression),
    (regression::AUTOREGRESSION, regression::autoregression),
];

/// Number of re-estimations after the first.
const MORE: usize = 20;

type Model<L> = Hmm<DenseTransition, L>;

/// Size of the data.
#[derive(Clone, Copy)]
struct Sizes {
    states: usize,
    sequences: usize,
    steps: usize,
}

/// Size for most families.
const SMALL: Sizes = Sizes { states: 4, sequences: 20, steps: 500 };

/// A parameter of all states.
struct Array {
    name: &'static str,
    /// The first axis is the state; the last runs fastest.
    shape: Vec<usize>,
    values: Vec<f64>,
}

impl Array {
    /// One row for each state, or for all of them.
    fn rows(name: &'static str, rows: &[Vec<f64>], of_row: &[usize]) -> Self {
        let shape = [&[rows.len()], of_row].concat();
        Self { name, shape, values: rows.concat() }
    }
}

/// Family, and the model that learning starts from.
struct Case<L> {
    name: &'static str,
    sizes: Sizes,
    start: Model<L>,
    /// The parameters of the family.
    arrays: fn(&L) -> Vec<Array>,
}

impl<L> Case<L>
where
    L: LearnLikelihood + Clone + Sync,
{
    /// Learns from rows of numbers.
    fn learn_rows(
        &self,
        drawn: &[Vec<Vec<f64>>],
        races: &mut Races,
        folders: &Folders,
    ) -> Result<(), Failure>
    where
        L: Likelihood<Observation = [f64]>,
    {
        let width = drawn[0][0].len();
        let values: Vec<Vec<f64>> = drawn.iter().map(|rows| rows.concat()).collect();
        let rows: Result<Vec<Rows<'_>>, _> =
            values.iter().map(|values| Rows::new(values, width)).collect();
        self.write_rows(&values, width, folders)?;
        self.learn(&rows?, races, folders)
    }

    fn write_rows(
        &self,
        values: &[Vec<f64>],
        width: usize,
        folders: &Folders,
    ) -> Result<(), Failure> {
        let folder = folders.out.join(self.name);
        fs::create_dir_all(&folder)?;
        let shape = [values.len(), values[0].len() / width, width];
        Ok(npy::doubles(&folder.join("rows.npy"), &shape, &values.concat())?)
    }

    /// Learns, writes the start and all answers, and times an iteration and its E-step.
    fn learn<S>(&self, seen: &[S], races: &mut Races, folders: &Folders) -> Result<(), Failure>
    where
        S: Sequence<(), L::Observation> + Sync,
    {
        let (learned, _) = self.iterate(seen, 1 + MORE)?;
        self.write(&learned, seen, folders)?;

        // The time of one re-estimation is the slope over their number.
        let steps: usize = seen.iter().map(Sequence::steps).sum();
        let mut times = Vec::new();
        for _ in 0..races.repetitions() {
            let (_, one) = self.iterate(seen, 1)?;
            let (_, all) = self.iterate(seen, 1 + MORE)?;
            times.push((all - one) * 1e6 / (MORE * steps) as f64);
        }
        races.add(self.name, "iteration", "wayfix", 0.0, times);
        let work = || drop(black_box(self.start.expectations(black_box(seen))));
        races.run(self.name, "E-step", steps, vec![Contender::wayfix(work)]);
        Ok(())
    }

    /// Runs a number of re-estimations; returns the seconds, with those of the E-step that comes
    /// first.
    fn iterate<S>(
        &self,
        seen: &[S],
        iterations: usize,
    ) -> Result<(LearnedModel<DenseTransition, L>, f64), Failure>
    where
        S: Sequence<(), L::Observation> + Sync,
    {
        let learning = LearningOptions::default().with_iterations(iterations).with_tolerance(0.0);
        let start = Instant::now();
        let learned = self.start.learn(seen, &learning)?;
        let seconds = start.elapsed().as_secs_f64();
        if learned.iterations() < iterations {
            return Err(format!("{}: learning stopped early", self.name).into());
        }
        Ok((learned, seconds))
    }

    fn write<S>(
        &self,
        learned: &LearnedModel<DenseTransition, L>,
        seen: &[S],
        folders: &Folders,
    ) -> Result<(), Failure>
    where
        S: Sequence<(), L::Observation> + Sync,
    {
        let folder = folders.out.join(self.name);
        let n = self.sizes.states;
        let parts = |model: &Model<L>| (model.prior().belief().as_slice().to_vec(), entries(model));
        let (prior, from_to) = parts(&self.start);
        write_model(&folder, n, &prior, &from_to)?;
        let (prior, from_to) = parts(learned.model());
        npy::doubles(&folder.join("learned_prior.npy"), &[n], &prior)?;
        npy::doubles(&folder.join("learned_transition.npy"), &[n, n], &matrix(n, &from_to))?;
        let all = [("", &self.start), ("learned_", learned.model())];
        for (prefix, model) in all {
            for Array { name, shape, values } in (self.arrays)(model.likelihood()) {
                npy::doubles(&folder.join(format!("{prefix}{name}.npy")), &shape, &values)?;
            }
        }

        let (mut paths, mut smoothed) = (Vec::new(), Vec::new());
        for ys in seen {
            paths.extend_from_slice(learned.model().viterbi(ys)?.states());
            smoothed.extend(observed(learned.model().smooth(ys)?.posteriors()));
        }
        let steps = paths.len() / seen.len();
        npy::indices(&folder.join("paths.npy"), &[seen.len(), steps], &paths)?;
        npy::doubles(&folder.join("smoothed.npy"), &[seen.len(), steps, n], &smoothed)?;
        let sizes = json!({
            "states": n,
            "more": MORE,
            // At the start, and after each re-estimation.
            "log_likelihoods": learned.objectives(),
        });
        Ok(fs::write(folder.join("model.json"), serde_json::to_string_pretty(&sizes)?)?)
    }
}

fn entries<L: Likelihood>(model: &Model<L>) -> Vec<Entry> {
    let (n, transition) = (model.states(), model.transition());
    (0..n * n).map(|at| (at / n, at % n, transition.get(at / n, at % n))).collect()
}

/// Generator of all random numbers of a case.
fn generator() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(1)
}

/// A model with random transitions.
fn model<L: Likelihood>(likelihood: L, rng: &mut ChaCha8Rng) -> Result<Model<L>, Failure> {
    let n = likelihood.states();
    let transition = DenseTransition::from_row_major(n, &matrix(n, &full(n, rng)))?;
    let prior = Prior::AtFirstObservation(Belief::new(distribution(n, rng))?);
    Ok(Hmm::new(prior, transition, likelihood)?)
}

/// Sequences of observations.
fn draw<L: SampleObservation>(
    hmm: &Model<L>,
    sizes: Sizes,
    rng: &mut ChaCha8Rng,
) -> Vec<Vec<L::Sample>>
where
    L::Sample: Clone,
{
    let sequence = |_| hmm.simulate(sizes.steps, rng).observations().to_vec();
    (0..sizes.sequences).map(sequence).collect()
}

/// Rows of normal numbers.
fn normals(rows: usize, columns: usize, scale: f64, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let mut normal = |_| scale * Distribution::<f64>::sample(&StandardNormal, rng);
    (0..rows).map(|_| (0..columns).map(&mut normal).collect()).collect()
}

/// Elementwise sums of two sets of rows.
fn sums(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let sum = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a + b).collect();
    a.iter().zip(b).map(sum).collect()
}
