//! A model with given likelihoods, as numbers that any library can use, and its files.

use std::fs;
use std::path::Path;

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp1};
use serde_json::json;
use wayfix::inference::Posteriors;
use wayfix::{
    Belief, DenseTransition, Hmm, LikelihoodVector, Prior, SparseTransition, TransitionEntries,
};

use crate::{Failure, npy};

/// To, from, probability.
pub(crate) type Entry = (usize, usize, f64);

/// A transition matrix, the distribution of the first state, and likelihoods.
pub(crate) struct Numbers {
    pub(crate) states: usize,
    pub(crate) entries: Vec<Entry>,
    /// Distribution at the first observation.
    pub(crate) prior: Vec<f64>,
    /// T × n.
    pub(crate) likelihoods: Vec<f64>,
}

impl Numbers {
    /// Uniform at first, with likelihoods of independent exponential weights.
    pub(crate) fn new(
        states: usize,
        entries: Vec<Entry>,
        steps: usize,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let prior = vec![1.0 / states as f64; states];
        Self { states, entries, prior, likelihoods: weights(states * steps, rng) }
    }

    /// The observations, one for each step.
    pub(crate) fn observations(&self) -> Vec<&[f64]> {
        self.likelihoods.chunks(self.states).collect()
    }

    pub(crate) fn steps(&self) -> usize {
        self.likelihoods.len() / self.states
    }

    pub(crate) fn sparse(&self) -> Result<Hmm<SparseTransition, LikelihoodVector>, Failure> {
        let transition = SparseTransition::from_triplets(self.states, self.entries.clone())?;
        self.hmm(transition)
    }

    pub(crate) fn dense(&self) -> Result<Hmm<DenseTransition, LikelihoodVector>, Failure> {
        let transition =
            DenseTransition::from_row_major(self.states, &matrix(self.states, &self.entries))?;
        self.hmm(transition)
    }

    fn hmm<A: TransitionEntries>(
        &self,
        transition: A,
    ) -> Result<Hmm<A, LikelihoodVector>, Failure> {
        let prior = Prior::AtFirstObservation(Belief::new(self.prior.clone())?);
        Ok(Hmm::new(prior, transition, LikelihoodVector::linear(self.states))?)
    }

    /// Writes prior, entries and likelihoods, with `sequences` of one length
    /// one after the other.
    pub(crate) fn write(&self, folder: &Path, sequences: usize) -> Result<(), Failure> {
        let (n, steps) = (self.states, self.steps() / sequences);
        write_model(folder, n, &self.prior, &self.entries)?;
        let shape: &[usize] = if sequences == 1 { &[steps, n] } else { &[sequences, steps, n] };
        Ok(npy::doubles(&folder.join("likelihoods.npy"), shape, &self.likelihoods)?)
    }
}

/// Writes prior and entries.
pub(crate) fn write_model(
    folder: &Path,
    states: usize,
    prior: &[f64],
    entries: &[Entry],
) -> Result<(), Failure> {
    fs::create_dir_all(folder)?;
    let count = [entries.len()];
    let to: Vec<usize> = entries.iter().map(|entry| entry.0).collect();
    let from: Vec<usize> = entries.iter().map(|entry| entry.1).collect();
    let probability: Vec<f64> = entries.iter().map(|entry| entry.2).collect();
    npy::indices(&folder.join("to.npy"), &count, &to)?;
    npy::indices(&folder.join("from.npy"), &count, &from)?;
    npy::doubles(&folder.join("probability.npy"), &count, &probability)?;
    Ok(npy::doubles(&folder.join("prior.npy"), &[states], prior)?)
}

/// Answers for a sequence of observations.
pub(crate) struct Answers {
    pub(crate) log_likelihood: f64,
    /// T × n.
    pub(crate) filtered: Vec<f64>,
    /// T × n.
    pub(crate) smoothed: Vec<f64>,
    pub(crate) path: Vec<usize>,
    pub(crate) path_log_probability: f64,
}

impl Answers {
    pub(crate) fn of<A: TransitionEntries<Control = ()>>(
        hmm: &Hmm<A, LikelihoodVector>,
        ys: &[&[f64]],
    ) -> Result<Self, Failure> {
        let (filtering, path) = (hmm.forward(ys)?, hmm.viterbi(ys)?);
        Ok(Self {
            log_likelihood: filtering.log_likelihood(),
            filtered: observed(filtering.posteriors()),
            smoothed: observed(hmm.smooth(ys)?.posteriors()),
            path_log_probability: path.log_probability(),
            path: path.into_states(),
        })
    }

    /// Writes the model's sizes and all answers.
    pub(crate) fn write(&self, folder: &Path, states: usize) -> Result<(), Failure> {
        let steps = self.path.len();
        let sizes = json!({
            "states": states,
            "steps": steps,
            "log_likelihood": self.log_likelihood,
            "path_log_probability": self.path_log_probability,
        });
        fs::write(folder.join("model.json"), serde_json::to_string_pretty(&sizes)?)?;
        npy::doubles(&folder.join("filtered.npy"), &[steps, states], &self.filtered)?;
        npy::doubles(&folder.join("smoothed.npy"), &[steps, states], &self.smoothed)?;
        Ok(npy::indices(&folder.join("path.npy"), &[steps], &self.path)?)
    }
}

/// The distributions of the steps with an observation.
pub(crate) fn observed(posteriors: &Posteriors) -> Vec<f64> {
    posteriors.as_slice()[posteriors.states()..].to_vec()
}

/// Independent exponential weights.
pub(crate) fn weights(count: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    (0..count).map(|_| Exp1.sample(rng)).collect()
}

/// A full matrix, as entries: columns of independent exponential weights.
pub(crate) fn full(states: usize, rng: &mut ChaCha8Rng) -> Vec<Entry> {
    let column = |from| {
        let column = distribution(states, rng).into_iter().enumerate();
        column.map(move |(to, p)| (to, from, p)).collect::<Vec<_>>()
    };
    (0..states).flat_map(column).collect()
}

/// Independent exponential weights, divided by their sum.
pub(crate) fn distribution(count: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let weights = weights(count, rng);
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// A[to, from] at `to * n + from`.
pub(crate) fn matrix(states: usize, entries: &[Entry]) -> Vec<f64> {
    let mut matrix = vec![0.0; states * states];
    for &(to, from, p) in entries {
        matrix[to * states + from] = p;
    }
    matrix
}
