//! Learning by expectation and maximisation (Baum, Petrie, Soules and Weiss
//! 1970; Rabiner 1989, section III-C).

use super::checkpoints::Order;
use super::lockstep::{self, Group, Memory, Plan};
use super::{LogSum, in_parallel};
use crate::belief::Belief;
use crate::error::{InferenceError, LearnError, SequenceError};
use crate::hmm::{Hmm, Prior};
use crate::kernels::LANES;
use crate::likelihood::{LearnLikelihood, Likelihood};
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, MoveCounts, Transition};

/// How [`Hmm::learn`] learns.
///
/// Pseudo-counts are those of a Dirichlet prior: each free parameter counts as
/// seen so many times more (0 for maximum likelihood, 1 for Laplace's rule).
/// What is 0 in the model stays 0, whatever they are: a forbidden move stays
/// forbidden.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// let learning = LearningOptions { transition_pseudo_count: 0.5, keep_prior: true, ..LearningOptions::default() };
/// assert_eq!(learning.iterations, 100);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct LearningOptions {
    /// The largest number of re-estimations; 100 unless changed.
    pub iterations: usize,
    /// Stop when one gains less than this, in nats of the objective; 1e-3
    /// unless changed.
    pub tolerance: f64,
    /// Leave the prior as it is. (Parts of the model are kept by
    /// [`Fixed`](crate::Fixed).)
    pub keep_prior: bool,
    /// For the prior; 0 unless changed.
    pub prior_pseudo_count: f64,
    /// For the transition operator; 0 unless changed.
    pub transition_pseudo_count: f64,
    /// For the sensor; 0 unless changed.
    pub likelihood_pseudo_count: f64,
}

impl Default for LearningOptions {
    fn default() -> Self {
        Self {
            iterations: 100,
            tolerance: 1e-3,
            keep_prior: false,
            prior_pseudo_count: 0.0,
            transition_pseudo_count: 0.0,
            likelihood_pseudo_count: 0.0,
        }
    }
}

impl LearningOptions {
    pub(super) fn check(&self) -> Result<(), LearnError> {
        for (what, value) in [
            ("tolerance", self.tolerance),
            ("pseudo-count of the prior", self.prior_pseudo_count),
            ("pseudo-count of the transitions", self.transition_pseudo_count),
            ("pseudo-count of the sensor", self.likelihood_pseudo_count),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(LearnError::Parameter { what, value });
            }
        }
        Ok(())
    }
}

/// Why learning stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The last re-estimation gained less than the tolerance.
    Converged,
    /// As many iterations as allowed were made.
    Iterations,
}

/// A model that was learned, and how it went.
///
/// Made by [`Hmm::learn`].
#[derive(Debug)]
pub struct LearnedModel<A, B> {
    model: Hmm<A, B>,
    objectives: Vec<f64>,
    log_likelihood: f64,
    reason: StopReason,
    left_out: Vec<SequenceError>,
}

impl<A, B> LearnedModel<A, B> {
    /// The model learned.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// The model learned, moved out.
    #[must_use]
    pub fn into_model(self) -> Hmm<A, B> {
        self.model
    }

    /// What is maximised, for the model as it was given and after each
    /// re-estimation: ln p of all observations, plus the logarithm of the
    /// Dirichlet density (but for a constant) if there are pseudo-counts. It
    /// never falls but for rounding.
    #[must_use]
    pub fn objectives(&self) -> &[f64] {
        &self.objectives
    }

    /// ln p of all observations that were not [left out](Self::left_out), under
    /// the model learned.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// How many times the model was re-estimated.
    #[must_use]
    pub fn iterations(&self) -> usize {
        self.objectives.len() - 1
    }

    /// Why it stopped.
    #[must_use]
    pub fn reason(&self) -> StopReason {
        self.reason
    }

    /// The sequences that nothing was learned from, and why: those that the
    /// model as given rules out, or that are not valid.
    #[must_use]
    pub fn left_out(&self) -> &[SequenceError] {
        &self.left_out
    }
}

/// What is expected of the hidden states, given observations.
pub(super) struct Expected<B: LearnLikelihood> {
    /// Σ p(X_0 | y_1 … y_T) over the sequences.
    pub(super) first: Vec<f64>,
    pub(super) moves: Vec<MoveCounts>,
    pub(super) sensor: B::Statistics,
    pub(super) log_likelihood: LogSum,
}

/// # Learning
impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Learns prior, transitions and sensor from sequences of observations, of
    /// any lengths: Baum–Welch, from this model on, to a local maximum.
    ///
    /// Sequences that this model rules out take no part:
    /// [`LearnedModel::left_out`] names them.
    ///
    /// Structure is kept: what has probability 0 keeps it. What must not be
    /// learned is wrapped in [`Fixed`](crate::Fixed). An iteration goes twice through
    /// each sequence, O(E) a step. With a stored matrix eight go in lock-step, with
    /// 128 n T bytes for such a group; others, and those that doubles do not hold,
    /// one by one as by [`smooth_each`](Self::smooth_each), with O(n + E) memory and
    /// the sensor's statistics for each of 64 that are gone through together. Empty
    /// ones say nothing. In parallel with the feature `rayon`, with the same result to
    /// the bit.
    ///
    /// ```
    /// use wayfix::inference::LearningOptions;
    /// use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    ///
    /// let hmm = Hmm::new(
    ///     Prior::AtFirstObservation(Belief::uniform(2)?),
    ///     DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?,
    ///     TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?,
    /// )?;
    /// let seen = [vec![0, 0, 0, 0, 1, 1, 1], vec![1, 1, 1, 0, 0, 0, 0, 0]];
    /// let learned = hmm.learn(&seen, &LearningOptions::default())?;
    /// assert!(learned.log_likelihood() > learned.objectives()[0] + 2.0);
    /// assert!(learned.model().transition().get(0, 0) > 0.8); // it seldom changes
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError`] if there is no sequence to learn from, a number of
    /// `learning` is not valid, a part cannot be re-estimated, or the objective
    /// falls (which an operator or sensor of your own may cause).
    pub fn learn<S>(
        &self,
        sequences: &[S],
        learning: &LearningOptions,
    ) -> Result<LearnedModel<A, B>, LearnError>
    where
        A: LearnTransition,
        B: LearnLikelihood,
        Self: Clone + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        learning.check()?;
        let all: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
        let (expected, left_out) = self.expect(&all);
        let out = |index: &usize| left_out.binary_search_by_key(index, |e| e.sequence).is_ok();
        let kept: Vec<_> = all.into_iter().filter(|(index, _)| !out(index)).collect();
        if kept.is_empty() {
            let sequences = sequences.len();
            return Err(LearnError::Nothing { sequences, first: left_out.into_iter().next() });
        }
        let (mut model, mut expected) = (self.clone(), expected);
        let mut objectives: Vec<f64> = Vec::new();
        loop {
            let log_likelihood = expected.log_likelihood.value();
            let objective = log_likelihood + model.log_prior(learning);
            let gain = objectives.last().map(|last| objective - last);
            objectives.push(objective);
            let iteration = objectives.len() - 1;
            if let Some(gain) = gain
                && gain < -1e-9 * objective.abs().max(1.0)
            {
                return Err(LearnError::Fell {
                    iteration,
                    before: objective - gain,
                    after: objective,
                });
            }
            let converged = gain.is_some_and(|gain| gain < learning.tolerance);
            if converged || iteration == learning.iterations {
                let reason = if converged { StopReason::Converged } else { StopReason::Iterations };
                return Ok(LearnedModel { model, objectives, log_likelihood, reason, left_out });
            }
            model = model.maximize(&expected, learning)?;
            let failed;
            (expected, failed) = model.expect(&kept);
            if let Some(error) = failed.into_iter().next() {
                return Err(LearnError::Sequence(error));
            }
        }
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// The expectations of each sequence, added up in order, and those that
    /// have none.
    fn expect<S>(&self, sequences: &[(usize, &S)]) -> (Expected<B>, Vec<SequenceError>)
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let (mut sum, mut failed) = (self.nothing_expected(), Vec::new());
        let mut order = sequences.to_vec();
        let together =
            sequences.len() >= lockstep::FEWEST_TO_LEARN && self.transition().families() <= 1;
        let plan = if together { Plan::new(self) } else { None };
        if plan.is_some() {
            order.sort_by_key(|(_, sequence)| sequence.steps());
        }
        for some in order.chunks(64) {
            let results = match &plan {
                Some(plan) => {
                    let groups = some.chunks(LANES).collect();
                    lockstep::in_parallel(groups, |group, memory| {
                        self.expect_together(plan, group, memory)
                    })
                }
                None => in_parallel::each(some, |(_, sequence)| self.expect_one(*sequence))
                    .into_iter()
                    .zip(some)
                    .map(|(result, (sequence, _))| {
                        let sequence = *sequence;
                        vec![result.map_err(|error| SequenceError { sequence, ..error })]
                    })
                    .collect(),
            };
            for result in results.into_iter().flatten() {
                match result {
                    Ok(expected) => {
                        sum.first.iter_mut().zip(&expected.first).for_each(|(sum, p)| *sum += p);
                        sum.moves.iter_mut().zip(&expected.moves).for_each(|(sum, m)| sum.merge(m));
                        self.likelihood().merge(&mut sum.sensor, &expected.sensor);
                        sum.log_likelihood.add(expected.log_likelihood.value());
                    }
                    Err(error) => failed.push(error),
                }
            }
        }
        failed.sort_unstable_by_key(|error: &SequenceError| error.sequence);
        (sum, failed)
    }

    /// The expectations of a group in lock-step, and those of each sequence that
    /// has to be gone through by itself.
    fn expect_together<S>(
        &self,
        plan: &Plan<'_, A, B>,
        sequences: &[(usize, &S)],
        memory: &mut Memory,
    ) -> Vec<Result<Expected<B>, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let group = Group::new(sequences);
        let mut results = Vec::new();
        let mut held = [false; LANES];
        if group.pays(self.states(), lockstep::FEWEST_TO_LEARN) {
            let expected;
            (expected, held) = lockstep::expect(plan, &group, memory);
            results.push(Ok(expected));
        }
        let alone = sequences.iter().zip(held).filter(|(_, held)| !held);
        results.extend(alone.map(|(&(sequence, s), _)| {
            self.expect_one(s).map_err(|source| SequenceError { sequence, source })
        }));
        results
    }

    pub(super) fn nothing_expected(&self) -> Expected<B> {
        Expected {
            first: vec![0.0; self.states()],
            moves: vec![MoveCounts::default(); self.transition().families()],
            sensor: self.likelihood().statistics(),
            log_likelihood: LogSum::default(),
        }
    }

    fn expect_one<S>(&self, sequence: &S) -> Result<Expected<B>, InferenceError>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let mut expected = self.nothing_expected();
        if sequence.steps() == 0 {
            return Ok(expected); // it says nothing
        }
        let mut result = Ok(());
        let log = self.smooth_each(sequence, Order::Backward, |step| {
            let (number, posterior) = (step.step(), step.smoothed().as_slice());
            if number == 0 {
                expected.first.copy_from_slice(posterior);
                return;
            }
            let observation = sequence.observation(number);
            self.likelihood().add(&mut expected.sensor, observation, posterior);
            if let (Some(pairs), Ok(())) = (step.pairs(), &result) {
                let family = self.transition().family(sequence.control(number));
                if let Some(moves) = expected.moves.get_mut(family) {
                    result = pairs.add_to(moves, number);
                }
            }
        })?;
        result?;
        expected.log_likelihood.add(log);
        Ok(expected)
    }

    /// The model that fits the expectations best.
    pub(super) fn maximize(
        &self,
        expected: &Expected<B>,
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
            self.transition().reestimate(&expected.moves, learning.transition_pseudo_count)?;
        let likelihood = self
            .likelihood()
            .reestimate(&expected.sensor, learning.likelihood_pseudo_count)
            .map_err(LearnError::Likelihood)?;
        Ok(Self::new(prior, transition, likelihood)?.rounding_tails(self.rounds_tails()))
    }

    fn log_prior(&self, learning: &LearningOptions) -> f64 {
        let prior = if learning.keep_prior || learning.prior_pseudo_count == 0.0 {
            0.0
        } else {
            let possible = self.prior().belief().as_slice().iter().filter(|p| **p > 0.0);
            learning.prior_pseudo_count * possible.map(|p| p.ln()).sum::<f64>()
        };
        prior
            + self.transition().log_prior(learning.transition_pseudo_count)
            + self.likelihood().log_prior(learning.likelihood_pseudo_count)
    }
}
