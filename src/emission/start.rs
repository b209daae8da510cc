//! Models to begin learning with (section 9 of the formulas finds the maximum that is near).

use rand::Rng;

use super::{Clusters, EmissionError, StartFromClusters};
use crate::belief::Belief;
use crate::error::{InferenceError, LearnError, SequenceError};
use crate::hmm::{Hmm, Prior};
use crate::likelihood::Scratch;
use crate::sequence::Sequence;
use crate::transition::DenseTransition;

/// Models to start learning from: as many as asked for, each from other random
/// [`Clusters`], whose observations give the family its parameters.
///
/// Parameters are estimated from the observations of each cluster, with a tenth of the weight from all
/// observations. A transition is what the clusters of successive observations show, with one more
/// of each; the prior is uniform at the first observation. [`Hmm::learn_best`] learns from all and
/// keeps the best:
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix::emission::{Gaussian, GaussianPrior, starts};
/// use wayfix::inference::LearningOptions;
/// use wayfix::Hmm;
///
/// let calm = (0..40).map(|k| [0.1 * f64::from(k % 3)]);
/// let busy = (0..40).map(|k| [5.0 + 0.5 * f64::from(k % 5)]);
/// let series: Vec<[f64; 1]> = calm.chain(busy).collect();
///
/// let family = Gaussian::diagonal(&[[0.0], [0.0]], &[[1.0], [1.0]])?; // two states, one component
/// // 0.01 times the variance of all, so that no state becomes as narrow as one observation.
/// let family = family.with_prior(GaussianPrior::new(1)?.with_covariance(0.0, &[0.09])?)?;
/// let starts = starts(&family, &[&series], 5, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let learned = Hmm::learn_best(&starts, &[&series], &LearningOptions::default(), |_, _| ())?;
/// let mean = |state| learned.model().likelihood().mean(state).unwrap()[0];
/// assert!((mean(0) - 0.1).abs() < 0.01 && (mean(1) - 6.0).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # The family
///
/// `family` is a placeholder. It decides the number of states, the kind of covariance, the
/// [prior](super::GaussianPrior) of its parameters, whether components may be missing, and the
/// number of a mixture's parts, which come from clusters within that of a state. It also keeps
/// what is fixed (put fixed means in ascending order, as clusters are) and what observations do
/// not give: probabilities of 0, and in the start, but not in learning, the degrees of freedom of a
/// [`StudentT`](super::StudentT). Its other parameters have no influence,
/// but for the choice among equals (a mean direction of observations that have none).
///
/// Without a prior a state may take hold of one observation, or of several that are the same:
/// the likelihood then has no maximum, and learning ends there. `with_prior`, as above, avoids it
/// in starts and in learning.
///
/// Clusters are of observations near to each other, by Euclidean distances: states that differ
/// only in spread, or in what follows what, start alike, and a group of headings around ±π is two
/// clusters ([`Clusters`] says what to do).
///
/// # Another transition
///
/// Keep the family alone to learn with a transition of your own. States are in ascending order of
/// the first component; [`Hmm::reordered`] puts them in the order in which they follow each other.
///
/// ```
/// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// # use wayfix::emission::{Gaussian, starts};
/// # use wayfix::{Belief, DenseTransition, Hmm, HmmError, Prior};
/// # let series = [[0.0], [0.1], [0.2], [5.0], [5.1], [5.3]];
/// # let family = Gaussian::diagonal(&[[0.0], [0.0]], &[[1.0], [1.0]])?;
/// # let starts = starts(&family, &[&series], 2, &mut ChaCha8Rng::seed_from_u64(1))?;
/// // From state 0 to state 1, and never back.
/// let onward = DenseTransition::from_rows(&[[0.9, 0.0], [0.1, 1.0]])?;
/// let first = Prior::AtFirstObservation(Belief::new(vec![1.0, 0.0])?);
/// let own = |start: Hmm<_, _>| Hmm::new(first.clone(), onward.clone(), start.into_parts().2);
/// let starts = starts.into_iter().map(own).collect::<Result<Vec<_>, HmmError>>()?;
/// # assert_eq!(starts.len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`LearnError::Sequence`] with sequence and step if the family refuses an observation;
/// [`LearnError::Likelihood`] if there are no observations, or fewer different ones than states,
/// if a component is missing in all, or if clusters do not determine the parameters, which a prior
/// may help. A component that is always the same is then named.
///
/// # Complexity
///
/// Each start costs as much as [`Clusters`] and one iteration of learning without its recursions;
/// as four to seven iterations if components are missing, or for a [`StudentT`](super::StudentT).
pub fn starts<B, S, R>(
    family: &B,
    sequences: &[S],
    count: usize,
    rng: &mut R,
) -> Result<Vec<Hmm<DenseTransition, B>>, LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    check(family, sequences)?;
    (0..count).map(|_| start(family, sequences, rng)).collect()
}

/// Checks that the family takes all observations, and that no component is missing in all.
fn check<B, S>(family: &B, sequences: &[S]) -> Result<(), LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]>,
{
    let mut scratch = Scratch::default();
    let mut is_missing = Vec::new();
    for (sequence, observations) in sequences.iter().enumerate() {
        for step in 1..=observations.steps() {
            let row = observations.observation(step);
            if let Err(source) = family.diagonal(row, &mut scratch) {
                let source = InferenceError::likelihood(step, source);
                return Err(SequenceError { sequence, source }.into());
            }
            is_missing.resize(row.len(), true);
            is_missing.iter_mut().zip(row).for_each(|(is_missing, y)| *is_missing &= y.is_nan());
        }
    }
    match is_missing.iter().position(|is_missing| *is_missing) {
        None => Ok(()),
        Some(component) => Err(LearnError::likelihood(EmissionError::AllMissing { component })),
    }
}

fn start<B, S, R>(
    family: &B,
    sequences: &[S],
    rng: &mut R,
) -> Result<Hmm<DenseTransition, B>, LearnError>
where
    B: StartFromClusters,
    S: Sequence<(), [f64]>,
    R: Rng + ?Sized,
{
    let n = family.states();
    let wrong = |error: EmissionError| LearnError::likelihood(error);
    let clusters = Clusters::new(sequences, n, rng).map_err(|error| match error {
        EmissionError::TooFewDifferent { found, expected, .. } => {
            wrong(EmissionError::TooFewDifferent { found, expected, what: "states" })
        }
        other => wrong(other),
    })?;
    let likelihood = family
        .start(&clusters, rng)
        .map_err(|error| LearnError::likelihood(clusters.explain(error)))?;
    let mut moves = vec![1.0; n * n];
    for (sequence, labels) in sequences.iter().zip(clusters.labels()) {
        // An observation without a known component tells nothing of its state.
        let is_known = |step: usize| sequence.observation(step).iter().any(|y| !y.is_nan());
        let pairs = (1..).zip(labels.windows(2));
        for (_, pair) in pairs.filter(|&(step, _)| is_known(step) && is_known(step + 1)) {
            moves[pair[0] * n + pair[1]] += 1.0;
        }
    }
    let sums: Vec<f64> = moves.chunks_exact(n).map(|row| row.iter().sum()).collect();
    let transition = DenseTransition::from_fn(n, |to, from| moves[from * n + to] / sums[from])?;
    let prior = Prior::AtFirstObservation(Belief::uniform(n)?);
    Ok(Hmm::new(prior, transition, likelihood)?)
}
