//! Models to start learning from.

use rand::Rng;

use super::{Clusters, EmissionError};
use crate::belief::Belief;
use crate::error::{InferenceError, LearnError, SequenceError};
use crate::hmm::{Hmm, Prior};
use crate::likelihood::{LearnLikelihood, Scratch};
use crate::sequence::Sequence;
use crate::transition::DenseTransition;

/// Weight of all observations in the start of a state, as a part of that of its cluster, so that
/// a cluster of two observations has a covariance.
const POOLED: f64 = 0.1;

/// Models to start learning from: as many as asked for, each from other random
/// [`Clusters`], whose observations give the family its parameters.
///
/// `family` has the wanted number of states and tells everything but the parameters that are
/// learned: the kind of covariance, a prior, missing components. Its parameters are those of the
/// cluster, with a tenth of the weight from all observations. A transition is what the
/// clusters of successive observations show, with one more of each; the prior is uniform at the
/// first observation. [`Hmm::learn_best`] learns from all and keeps the best:
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix::emission::{Gaussian, starts};
/// use wayfix::inference::LearningOptions;
/// use wayfix::Hmm;
///
/// let calm = (0..40).map(|k| [0.1 * f64::from(k % 3)]);
/// let busy = (0..40).map(|k| [5.0 + 0.5 * f64::from(k % 5)]);
/// let series: Vec<[f64; 1]> = calm.chain(busy).collect();
///
/// let family = Gaussian::diagonal(&[[0.0], [0.0]], &[[1.0], [1.0]])?; // two states, one component
/// let starts = starts(&family, &[&series], 5, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let fits = Hmm::learn_best(&starts, &[&series], &LearningOptions::default(), |_, _| ())?;
/// let learned = fits.into_best();
/// let mean = |state| learned.model().likelihood().mean(state).unwrap()[0];
/// assert!((mean(0) - 0.1).abs() < 0.01 && (mean(1) - 6.0).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`LearnError::Likelihood`] as [`Clusters::new`], if the family refuses an observation, or if
/// clusters do not determine its parameters, which a prior may help.
pub fn starts<B, S, R>(
    family: &B,
    sequences: &[S],
    count: usize,
    rng: &mut R,
) -> Result<Vec<Hmm<DenseTransition, B>>, LearnError>
where
    B: LearnLikelihood<Observation = [f64]>,
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    (0..count).map(|_| start(family, sequences, rng)).collect()
}

fn start<B, S, R>(
    family: &B,
    sequences: &[S],
    rng: &mut R,
) -> Result<Hmm<DenseTransition, B>, LearnError>
where
    B: LearnLikelihood<Observation = [f64]>,
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    let n = family.states();
    let wrong = |error: EmissionError| LearnError::Likelihood(error.into());
    let clusters = Clusters::new(sequences, n, rng).map_err(wrong)?;
    let mut statistics = family.statistics();
    let mut moves = vec![1.0; n * n];
    let labels = clusters.labels();
    let mut pooled = vec![0.0; n];
    labels.iter().flatten().for_each(|&label| pooled[label] += 1.0);
    let all: f64 = pooled.iter().sum();
    pooled.iter_mut().for_each(|count| *count *= POOLED / all);
    let mut weights = pooled.clone();
    let mut scratch = Scratch::default();
    for (sequence, (observations, labels)) in sequences.iter().zip(labels).enumerate() {
        for (step, &label) in (1..).zip(labels) {
            let observation = observations.observation(step);
            // The family's own check of the observation.
            if let Err(source) = family.diagonal(observation, &mut scratch) {
                let source = InferenceError::Likelihood { step, source };
                return Err(SequenceError { sequence, source }.into());
            }
            weights[label] = 1.0 + pooled[label];
            family.add(&mut statistics, observation, &weights);
            weights[label] = pooled[label];
        }
        labels.windows(2).for_each(|pair| moves[pair[0] * n + pair[1]] += 1.0);
    }
    let sums: Vec<f64> = moves.chunks_exact(n).map(|row| row.iter().sum()).collect();
    let transition = DenseTransition::from_fn(n, |to, from| moves[from * n + to] / sums[from])?;
    let likelihood = family.reestimate(&statistics, 0.0).map_err(LearnError::Likelihood)?;
    let prior = Prior::AtFirstObservation(Belief::uniform(n)?);
    Ok(Hmm::new(prior, transition, likelihood)?)
}
