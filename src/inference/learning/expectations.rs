//! Expectations and re-estimation: the two halves of an iteration of learning.

use std::fmt;

use super::baum_welch::LearningOptions;
use crate::belief::Belief;
use crate::error::{LearnError, SequenceError};
use crate::hmm::{Hmm, Prior};
use crate::inference::LogSum;
use crate::inference::engines::choice;
use crate::inference::engines::lanes::{Group, LaneMemory, LaneModel};
use crate::inference::engines::parallel;
use crate::inference::sequences::smooth_each::Order;
use crate::kernels::LANES;
use crate::likelihood::LearnLikelihood;
use crate::sequence::{Sequence, by_length};
use crate::transition::{LearnTransition, MoveCounts};

/// Expected statistics of the hidden states of sequences, given their observations: the E-step of
/// Baum–Welch.
///
/// Made by [`Hmm::expectations`]. Those of several parts of the data are
/// [added up](Hmm::merge_expectations), and [`Hmm::maximize`] makes the next model of the sum.
///
/// To add up those of several machines, send their parts, of which [`new`](Self::new) makes them
/// again: plain numbers if the statistics of the sensor are. Those of tables, counts, durations
/// and directions are; those of the Gaussian families cannot be sent.
///
/// ```
/// use wayfix::inference::{Expectations, LearningOptions};
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
/// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
/// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?, camera)?;
///
/// let (mut sum, failed) = hmm.expectations(&[[0, 0, 0, 1], [0, 1, 1, 1]]);
/// assert!(failed.is_empty());
/// let (others, _) = hmm.expectations(&[[1, 1, 1, 1], [0, 0, 1, 1]]); // another part of the data
/// hmm.merge_expectations(&mut sum, &others);
/// assert!((sum.first().iter().sum::<f64>() - 4.0).abs() < 1e-12);
///
/// let options = LearningOptions::default();
/// let next = hmm.maximize(&sum, &options)?;
/// let (after, _) = next.expectations(&[[0, 0, 0, 1], [0, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1]]);
/// assert!(after.log_likelihood() > sum.log_likelihood());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Expectations<B: LearnLikelihood> {
    /// Σ p(X_0 | y_1 … y_T), or of X_1, over the sequences.
    pub(crate) first: Vec<f64>,
    pub(crate) moves: Vec<MoveCounts>,
    pub(crate) sensor: B::Statistics,
    pub(crate) log_likelihood: LogSum,
}

impl<B: LearnLikelihood> fmt::Debug for Expectations<B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut fields = f.debug_struct("Expectations");
        fields.field("log_likelihood", &self.log_likelihood()).finish_non_exhaustive()
    }
}

impl<B: LearnLikelihood> Expectations<B> {
    /// Creates expectations from their parts, which [`Hmm::maximize`] checks.
    #[must_use]
    pub fn new(
        first: Vec<f64>,
        moves: Vec<MoveCounts>,
        sensor: B::Statistics,
        log_likelihood: f64,
    ) -> Self {
        let log_likelihood = LogSum { sum: log_likelihood, lost: 0.0 };
        Self { first, moves, sensor, log_likelihood }
    }

    /// Expected number of sequences that start in each state: before the first transition, or at
    /// the first observation, as the prior of the model says.
    #[must_use]
    pub fn first(&self) -> &[f64] {
        &self.first
    }

    /// Expected moves, of each [family](LearnTransition::families) of the operator.
    #[must_use]
    pub fn moves(&self) -> &[MoveCounts] {
        &self.moves
    }

    /// Statistics of the sensor.
    #[must_use]
    pub fn sensor(&self) -> &B::Statistics {
        &self.sensor
    }

    /// Log-likelihood of all observations.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood.value()
    }
}

/// # Learning in parts
impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Returns a pair: the expectations of all sequences, added up, and an error for each sequence
    /// that was left out, since the model rules it out or it is not valid, with its index in
    /// `sequences`. (Where [`learn`](Self::learn) is enough, its result lists these errors.)
    ///
    /// A loop in parts, which ends when the log-likelihood hardly grows:
    ///
    /// ```
    /// # use wayfix::inference::LearningOptions;
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?;
    /// # let start = Hmm::new(prior, DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?, camera)?;
    /// let parts = [vec![[0, 0, 0, 1], [0, 1, 1, 1]], vec![[1, 1, 1, 1], [0, 0, 1, 1]]];
    /// let (mut model, mut before) = (start, f64::NEG_INFINITY);
    /// for _ in 0..100 {
    ///     let mut sum = model.no_expectations();
    ///     for (number, part) in parts.iter().enumerate() {
    ///         let (expected, left_out) = model.expectations(part);
    ///         left_out.iter().for_each(|error| eprintln!("part {number}: {error}"));
    ///         model.merge_expectations(&mut sum, &expected);
    ///     }
    ///     let log_likelihood = sum.log_likelihood();
    ///     if log_likelihood - before < 1e-6 {
    ///         break;
    ///     }
    ///     before = log_likelihood;
    ///     model = model.maximize(&sum, &LearningOptions::default())?;
    /// }
    /// assert!(model.likelihood().probability(0, 0) > Some(0.8));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// Cost and memory are those of an iteration of [`learn`](Self::learn), in parallel with the
    /// feature `rayon`, with the same result to the bit.
    pub fn expectations<S>(&self, sequences: &[S]) -> (Expectations<B>, Vec<SequenceError>)
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let all: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
        self.expectations_of(&all)
    }

    /// Expectations of no sequence, to start a sum with.
    #[must_use]
    pub fn no_expectations(&self) -> Expectations<B> {
        Expectations {
            first: vec![0.0; self.states()],
            moves: vec![MoveCounts::default(); self.transition().families()],
            sensor: self.likelihood().statistics(),
            log_likelihood: LogSum::default(),
        }
    }

    /// Adds expectations of other sequences under this model, which the caller must ensure: a sum
    /// over several models means nothing, and [`maximize`](Self::maximize) detects only some
    /// of them. O(n + moves + statistics).
    pub fn merge_expectations(&self, sum: &mut Expectations<B>, other: &Expectations<B>) {
        sum.first.iter_mut().zip(&other.first).for_each(|(sum, p)| *sum += p);
        sum.moves.iter_mut().zip(&other.moves).for_each(|(sum, m)| sum.merge(m));
        self.likelihood().merge(&mut sum.sensor, &other.sensor);
        sum.log_likelihood.add(other.log_likelihood.value());
    }

    /// Returns the model that fits expectations under this model best: the M-step. Of the options
    /// it uses the pseudo-counts and `keep_prior`.
    ///
    /// # Errors
    ///
    /// [`LearnError`] if a number of `learning` is not valid, the expectations are those of
    /// another model, or of no sequence ([`LearnError::Nothing`]), or a part cannot be
    /// re-estimated.
    pub fn maximize(
        &self,
        expectations: &Expectations<B>,
        learning: &LearningOptions,
    ) -> Result<Self, LearnError> {
        learning.check()?;
        let families = self.transition().families();
        for (what, found, expected) in [
            ("states", expectations.first.len(), self.states()),
            ("families of moves", expectations.moves.len(), families),
        ] {
            if found != expected {
                return Err(LearnError::Expectations { what, found, expected });
            }
        }
        if expectations.first.iter().all(|p| *p == 0.0) {
            return Err(LearnError::Nothing { sequences: 0, first: None });
        }
        self.maximize_checked(expectations, learning)
    }

    /// Returns the expectations of sequences with their indices, added up, and the errors of those
    /// that have none.
    ///
    /// Parts are added up in an order that does not depend on the threads: the same bits on any
    /// machine.
    pub(crate) fn expectations_of<S>(
        &self,
        sequences: &[(usize, &S)],
    ) -> (Expectations<B>, Vec<SequenceError>)
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let (mut sum, mut failed) = (self.no_expectations(), Vec::new());
        // Lanes count the moves of one matrix.
        let lanes = choice::learns_in_lanes(self.states(), sequences.len(), 0)
            && self.transition().families() <= 1;
        let model = if lanes { LaneModel::new(self) } else { None };
        let order = if model.is_some() {
            let steps: Vec<usize> = sequences.iter().map(|(_, s)| s.steps()).collect();
            by_length(&steps).into_iter().map(|i| sequences[i]).collect()
        } else {
            sequences.to_vec()
        };
        // No more statistics of the sensor at a time than those of 64 sequences.
        for some in order.chunks(64) {
            let results = match &model {
                Some(model) => {
                    let groups = some.chunks(LANES).collect();
                    parallel::map(groups, |group, memory: &mut LaneMemory| {
                        self.expectations_in_lanes(model, group, memory)
                    })
                }
                None => parallel::map(some.to_vec(), |(sequence, s), (): &mut ()| {
                    vec![self.expectations_of_one(sequence, s)]
                }),
            };
            for result in results.into_iter().flatten() {
                match result {
                    Ok(expected) => self.merge_expectations(&mut sum, &expected),
                    Err(error) => failed.push(error),
                }
            }
        }
        sort(&mut failed);
        (sum, failed)
    }

    /// Returns the expectations of a group in lanes, and of each sequence that has to be taken by
    /// itself.
    fn expectations_in_lanes<S>(
        &self,
        model: &LaneModel<'_, A, B>,
        sequences: &[(usize, &S)],
        memory: &mut LaneMemory,
    ) -> Vec<Result<Expectations<B>, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let states = self.states();
        let learns = |count, longest| choice::learns_in_lanes(states, count, longest);
        let group = Group::new(sequences, learns);
        let mut results = Vec::new();
        let mut lanes = [None; LANES];
        if group.in_lanes {
            let found = model.expectations(&group, memory);
            let mut expected = self.no_expectations();
            (expected.first, expected.sensor) = (found.first, found.sensor);
            found.moves.into_iter().for_each(|moves| expected.moves = vec![moves]);
            lanes = found.log_likelihoods;
            lanes.iter().flatten().for_each(|log| expected.log_likelihood.add(*log));
            results.push(Ok(expected));
        }
        let single = sequences.iter().zip(lanes).filter(|(_, lane)| lane.is_none());
        results.extend(single.map(|(&(sequence, s), _)| self.expectations_of_one(sequence, s)));
        results
    }

    fn expectations_of_one<S>(
        &self,
        sequence: usize,
        observed: &S,
    ) -> Result<Expectations<B>, SequenceError>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let wrap = |source| SequenceError { sequence, source };
        let mut expected = self.no_expectations();
        if observed.steps() == 0 {
            return Ok(expected); // X_0 without an observation tells nothing about the prior
        }
        let mut result = Ok(());
        let log = self.smooth_each(observed, Order::Backward, |step| {
            let (number, posterior) = (step.step(), step.smoothed().as_slice());
            if number == 0 {
                expected.first.copy_from_slice(posterior);
                return;
            }
            let observation = observed.observation(number);
            self.likelihood().add(&mut expected.sensor, observation, posterior);
            if let (Some(pairs), Ok(())) = (step.pairs(), &result) {
                let family = self.transition().family(observed.control(number));
                if let Some(moves) = expected.moves.get_mut(family) {
                    result = pairs.count_to(moves, number);
                }
            }
        });
        let log = log.map_err(wrap)?;
        result.map_err(wrap)?;
        expected.log_likelihood.add(log);
        Ok(expected)
    }

    /// Returns the model that fits the expectations best.
    pub(crate) fn maximize_checked(
        &self,
        expected: &Expectations<B>,
        learning: &LearningOptions,
    ) -> Result<Self, LearnError> {
        let belief = self.prior().belief();
        let unseen = learning.prior_pseudo_count == 0.0 && expected.first.iter().all(|p| *p == 0.0);
        let prior = if learning.keep_prior || unseen {
            belief.clone()
        } else {
            let known = belief.as_slice().iter().zip(&expected.first);
            let weight = |(&old, &seen): (&f64, &f64)| {
                if old > 0.0 { seen + learning.prior_pseudo_count } else { 0.0 }
            };
            Belief::from_weights(known.map(weight).collect())?
        };
        let prior = match self.prior() {
            Prior::BeforeFirstTransition(_) => Prior::BeforeFirstTransition(prior),
            Prior::AtFirstObservation(_) => Prior::AtFirstObservation(prior),
        };
        let transition =
            self.transition().maximize(&expected.moves, learning.transition_pseudo_count)?;
        let likelihood = self
            .likelihood()
            .maximize(&expected.sensor, learning.likelihood_pseudo_count)
            .map_err(LearnError::Likelihood)?;
        Ok(Self::new(prior, transition, likelihood)?.rounding_tails(self.rounds_tails()))
    }
}

/// Sorts by the sequence. One function, since each model would instantiate a sort.
fn sort(failed: &mut [SequenceError]) {
    failed.sort_unstable_by_key(|error| error.sequence);
}
