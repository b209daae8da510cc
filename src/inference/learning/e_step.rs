//! The E-step of learning: expectations under a model, by forward–backward over each sequence
//! (section 9 of the [formulas](crate::guide::formulas)).
//!
//! Sequences run in lanes, eight at a time, or one by one; the sums are added up in an order that
//! does not depend on the threads, so that learning gives the same bits on any machine.

use super::expectations::Expectations;
use crate::error::SequenceError;
use crate::hmm::Hmm;
use crate::inference::engines::choice;
use crate::inference::engines::lanes::{Group, LaneMemory, LaneModel};
use crate::inference::engines::parallel;
use crate::inference::sequences::smooth_each::Order;
use crate::kernels::LANES;
use crate::likelihood::LearnLikelihood;
use crate::sequence::{Sequence, by_length};
use crate::transition::LearnTransition;

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

    /// Returns the expectations of sequences with their indices, added up, and the errors of those
    /// that have none.
    pub(crate) fn expectations_of<S>(
        &self,
        sequences: &[(usize, &S)],
    ) -> (Expectations<B>, Vec<SequenceError>)
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let (mut sum, mut failed) = (self.no_expectations(), Vec::new());
        // Lanes count the moves of one matrix. Lengths are not looked at yet: a group asks again.
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
                    // Each group gives one sum: as much memory for statistics as one sequence
                    // takes.
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
            // Without counted moves, such as those of a fixed operator, the families stay empty.
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
            // A visitor cannot stop the smoother. After an error it skips the moves, and the caller
            // returns the error instead of the sums.
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
}

/// Sorts by the sequence. One function, since each model would instantiate a sort.
fn sort(failed: &mut [SequenceError]) {
    failed.sort_unstable_by_key(|error| error.sequence);
}
