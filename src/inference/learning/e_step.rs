//! The E-step of learning: expectations under a model, by forward–backward over each sequence, and
//! their sums (section 9 of the [formulas](crate::guide::formulas)).
//!
//! Sequences run in lanes, eight at a time, or one by one; under models of up to eight states in
//! whole passes, which take many steps in one call of a kernel
//! ([`few_states`](crate::inference::engines::few_states)). Their expectations are added up in an
//! order that does not depend on the threads, so that learning gives the same bits on any machine.

use std::fmt;

use super::entry_sums::EntrySums;
use crate::error::SequenceError;
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::engines::lanes::{Group, LaneExpectations, LaneModel, LaneScratch};
use crate::inference::engines::{choice, few_states, parallel};
use crate::inference::sequences::smooth_each::Order;
use crate::likelihood::LearnLikelihood;
use crate::sequence::{Sequence, by_length};
use crate::transition::{LearnTransition, MoveCounts, constant_control};
use wayfix_kernels::LANES;

/// # Learning in parts
impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Returns the sum of the expectations of all sequences, and an error for each sequence that
    /// was left out because the model rules it out or it is not valid, with its index in
    /// `sequences`. ([`learn`](Self::learn) lists these errors in its result.)
    ///
    /// Learning from data in parts, until the log-likelihood hardly grows:
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
    ///         sum.merge(&model, &expected);
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
    pub fn expectations<S>(
        &self,
        sequences: &[S],
    ) -> (Expectations<B, A::Statistics>, Vec<SequenceError>)
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let all: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
        self.expectations_of(&all)
    }

    /// Returns the sum of the expectations of sequences, which are given with their indices, and
    /// the errors of those that fail.
    #[doc(hidden)]
    pub fn expectations_of<S>(
        &self,
        sequences: &[(usize, &S)],
    ) -> (Expectations<B, A::Statistics>, Vec<SequenceError>)
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let (mut sum, mut failed) = (self.no_expectations(), Vec::new());
        // A first guess by the number of sequences alone; each group decides again by its lengths.
        let is_long = |(_, s): &(usize, &S)| choice::is_worth_a_cut(s.steps());
        let lanes = choice::learns_in_lanes(self.states(), sequences.len(), 0)
            || sequences.iter().any(is_long);
        let model = if lanes { LaneModel::new(self) } else { None };
        let order = if model.is_some() {
            let steps: Vec<usize> = sequences.iter().map(|(_, s)| s.steps()).collect();
            by_length(&steps).into_iter().map(|i| sequences[i]).collect()
        } else {
            sequences.to_vec()
        };
        // In chunks, so that no more than 64 sensor statistics are in memory. Results are merged in
        // the order of the chunk, whichever thread computed them.
        for some in order.chunks(64) {
            let results = match &model {
                Some(model) => {
                    let groups = some.chunks(LANES).collect();
                    // A group of eight gives one sum, with the memory of one sequence's statistics.
                    parallel::map(groups, |group, memory: &mut LaneScratch| {
                        self.expectations_in_lanes(model, group, memory)
                    })
                }
                None => parallel::map(some.to_vec(), |(sequence, s), (): &mut ()| {
                    vec![self.expectations_of_one(sequence, s)]
                }),
            };
            for result in results.into_iter().flatten() {
                match result {
                    Ok(expected) => sum.merge(self, &expected),
                    Err(error) => failed.push(error),
                }
            }
        }
        sort(&mut failed);
        (sum, failed)
    }

    /// Returns the sum of the expectations of a group in lanes, and those of each sequence that has
    /// to run by itself.
    fn expectations_in_lanes<S>(
        &self,
        model: &LaneModel<'_, A, B>,
        sequences: &[(usize, &S)],
        memory: &mut LaneScratch,
    ) -> Vec<Result<Expectations<B, A::Statistics>, SequenceError>>
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let states = self.states();
        let learns = |count, longest| choice::learns_in_lanes(states, count, longest);
        let (mut results, mut whole) = (Vec::new(), Vec::with_capacity(sequences.len()));
        let mut group = Group::new(sequences, learns);
        // A few sequences leave lanes empty, whereas the segments of a single one fill them all.
        if !group.in_lanes || choice::leaves_lanes_empty(sequences.len()) {
            for &(number, sequence) in sequences {
                match self.expectations_of_long(model, sequence) {
                    Some(expected) => results.push(Ok(expected)),
                    None => whole.push((number, sequence)),
                }
            }
            group = Group::new(&whole, learns);
        }
        let mut lanes = [None; LANES];
        if group.in_lanes {
            let found = model.expectations(&group, memory);
            lanes = found.log_likelihoods;
            results.push(Ok(self.expectations_of_lanes(found)));
        }
        // A lane without a log-likelihood left the range of doubles, or was not run.
        let single = group.sequences.iter().zip(lanes).filter(|(_, lane)| lane.is_none());
        results.extend(single.map(|(&(sequence, s), _)| self.expectations_of_one(sequence, s)));
        results
    }

    /// Returns the expectations of a long sequence, computed in segments, or `None` if it does not
    /// suit them.
    fn expectations_of_long<S>(
        &self,
        model: &LaneModel<'_, A, B>,
        sequence: &S,
    ) -> Option<Expectations<B, A::Statistics>>
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let mut sum = self.no_expectations();
        model.expectations_in_segments(sequence, |found| {
            sum.merge(self, &self.expectations_of_lanes(found));
        })?;
        Some(sum)
    }

    fn expectations_of_lanes(
        &self,
        found: LaneExpectations<B::Statistics>,
    ) -> Expectations<B, A::Statistics> {
        let mut expected = self.no_expectations();
        (expected.first, expected.sensor) = (found.first, found.sensor);
        let control = constant_control::<A>();
        let counts = control.and_then(|u| self.transition().counts(&mut expected.moves, u));
        // Nothing is counted for a fixed operator.
        if let (Some(counts), Some(moves)) = (counts, found.moves) {
            *counts = moves;
        }
        found.log_likelihoods.iter().flatten().for_each(|log| expected.log_likelihood.add(*log));
        expected
    }

    fn expectations_of_one<S>(
        &self,
        sequence: usize,
        observed: &S,
    ) -> Result<Expectations<B, A::Statistics>, SequenceError>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let wrap = |source| SequenceError { sequence, source };
        let mut expected = self.no_expectations();
        if observed.steps() == 0 {
            return Ok(expected); // its γ_0 is the prior itself, which would only slow convergence
        }
        if self.add_few_states(observed, &mut expected).is_some() {
            return Ok(expected);
        }
        let mut result = Ok(());
        let mut entries = EntrySums::new(self, &mut expected.moves);
        let log = self.smooth_each(observed, Order::Backward, |step| {
            let (number, posterior) = (step.step(), step.smoothed().as_slice());
            if number == 0 {
                expected.first.copy_from_slice(posterior);
                return;
            }
            let observation = observed.observation(number);
            self.likelihood().add(&mut expected.sensor, observation, posterior);
            // A visitor cannot stop the smoother. After an error it skips the moves, and the error
            // is returned below instead of the sums.
            if let (Some(pairs), Ok(())) = (step.pairs(), &result) {
                match &mut entries {
                    Some(entries) if pairs.in_logs => {
                        entries.add_logs(pairs.alpha, pairs.ratio);
                    }
                    Some(entries) => {
                        entries.add(pairs.alpha.linear, pairs.ratio, pairs.scale);
                    }
                    None => result = pairs.count_to(&mut expected.moves, number),
                }
            }
        });
        let log = log.map_err(wrap)?;
        result.map_err(wrap)?;
        if let Some(entries) = entries {
            entries.finish(self, &mut expected.moves);
        }
        expected.log_likelihood.add(log);
        Ok(expected)
    }
}

/// Sorts errors by their sequence. A function of its own, since otherwise every model would
/// instantiate a sort.
fn sort(failed: &mut [SequenceError]) {
    failed.sort_unstable_by_key(|error| error.sequence);
}

/// Expected statistics of the hidden states of sequences, given their observations: the E-step of
/// Baum–Welch.
///
/// Made by [`Hmm::expectations`]. Those of several parts of the data are
/// [merged](Expectations::merge), and [`Hmm::maximize`] computes the next model from the sum.
///
/// To add those of several machines, send their fields, and reassemble them by
/// [`new`](Self::new). The fields are plain numbers if the statistics are. Those of tables, counts,
/// durations and directions are; those of the Gaussian families cannot be sent.
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
/// sum.merge(&hmm, &others);
/// assert!((sum.first().iter().sum::<f64>() - 4.0).abs() < 1e-12);
///
/// let options = LearningOptions::default();
/// let next = hmm.maximize(&sum, &options)?;
/// let (after, _) = next.expectations(&[[0, 0, 0, 1], [0, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1]]);
/// assert!(after.log_likelihood() > sum.log_likelihood());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Expectations<B: LearnLikelihood, M = MoveCounts> {
    /// Σ p(X_0 | y_1 … y_T), or of X_1, over the sequences.
    pub(crate) first: Vec<f64>,
    pub(crate) moves: M,
    pub(crate) sensor: B::Statistics,
    pub(crate) log_likelihood: LogSum,
}

impl<B: LearnLikelihood, M> fmt::Debug for Expectations<B, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut fields = f.debug_struct("Expectations");
        fields.field("log_likelihood", &self.log_likelihood()).finish_non_exhaustive()
    }
}

impl<B: LearnLikelihood, M> Expectations<B, M> {
    /// Creates expectations from their fields, which [`Hmm::maximize`] checks.
    #[must_use]
    pub fn new(first: Vec<f64>, moves: M, sensor: B::Statistics, log_likelihood: f64) -> Self {
        let log_likelihood = LogSum { sum: log_likelihood, compensation: 0.0 };
        Self { first, moves, sensor, log_likelihood }
    }

    /// Expected number of sequences that start in each state: before the first transition or at
    /// the first observation, depending on the prior of the model.
    #[must_use]
    pub fn first(&self) -> &[f64] {
        &self.first
    }

    /// [Statistics](LearnTransition::Statistics) of the moves.
    #[must_use]
    pub fn moves(&self) -> &M {
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

    /// Adds expectations of other sequences under the same model. The caller must ensure that they
    /// are: a sum over different models is meaningless, and [`Hmm::maximize`] detects only some of
    /// these. O(n + moves + statistics).
    pub fn merge<A>(&mut self, model: &Hmm<A, B>, other: &Self)
    where
        A: LearnTransition<Statistics = M>,
    {
        self.first.iter_mut().zip(&other.first).for_each(|(sum, p)| *sum += p);
        model.transition().merge(&mut self.moves, &other.moves);
        model.likelihood().merge(&mut self.sensor, &other.sensor);
        self.log_likelihood.add(other.log_likelihood.value());
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Expectations of no sequences, to start a sum with.
    #[must_use]
    pub fn no_expectations(&self) -> Expectations<B, A::Statistics> {
        Expectations {
            first: vec![0.0; self.states()],
            moves: self.transition().statistics(),
            sensor: self.likelihood().statistics(),
            log_likelihood: LogSum::default(),
        }
    }
}

/// Prediction below which γ / p may leave the range of doubles.
const LEAST: f64 = 1e-280;

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Adds the expectations of a sequence. Returns `None`, with nothing added, if the sequence
    /// does not suit this: single steps can use logarithms, and report errors.
    pub(super) fn add_few_states<S>(
        &self,
        sequence: &S,
        expected: &mut Expectations<B, A::Statistics>,
    ) -> Option<()>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let (n, steps) = (self.states(), sequence.steps());
        if !choice::learns_whole(n, steps) {
            return None;
        }
        let mut entries = EntrySums::new(self, &mut expected.moves)?;
        let (alpha, _, _) = few_states::filter(self, sequence)?;
        let (gamma, log_likelihood) = few_states::smooth(self, sequence)?;
        let mut ratio = vec![0.0; n];
        // `entries` collects the moves until `finish`, so that `None` below leaves nothing behind.
        let first = if self.prior().moves_at(1) { 1 } else { 2 };
        for number in first..=steps {
            let alpha = &alpha[(number - 1) * n..][..n];
            entries.predict(alpha, &mut ratio);
            for (ratio, gamma) in ratio.iter_mut().zip(&gamma[number * n..]) {
                if *gamma > 0.0 && *ratio < LEAST {
                    return None;
                }
                // A state without γ has no moves into it; its p may be 0.
                *ratio = if *gamma > 0.0 { gamma / *ratio } else { 0.0 };
            }
            entries.add(alpha, &ratio, 1.0);
        }
        expected.first.copy_from_slice(&gamma[..n]);
        for (number, posterior) in (1..).zip(gamma[n..].chunks_exact(n)) {
            self.likelihood().add(&mut expected.sensor, sequence.observation(number), posterior);
        }
        entries.finish(self, &mut expected.moves);
        expected.log_likelihood.add(log_likelihood);
        Some(())
    }
}
