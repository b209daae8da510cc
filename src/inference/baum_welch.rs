//! Learning by expectation–maximisation (Baum, Petrie, Soules and Weiss 1970; Rabiner 1989,
//! section III-C).

use super::batch::{self, BatchMemory, BatchModel, Group};
use super::checkpoints::Order;
use super::plan::{self, Engine};
use super::{LogSum, in_parallel};
use crate::belief::Belief;
use crate::error::{InferenceError, LearnError, SequenceError};
use crate::hmm::{Hmm, Prior};
use crate::kernels::LANES;
use crate::likelihood::{LearnLikelihood, Likelihood};
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, MoveCounts, Transition};

/// Options of [`Hmm::learn`].
///
/// Pseudo-counts are those of a Dirichlet prior: each free parameter counts as observed so many
/// more times (0 for maximum likelihood, 1 for Laplace's rule). Probabilities of 0 in the model
/// stay 0 in any case: a forbidden move stays forbidden.
///
/// ```
/// use wayfix::inference::LearningOptions;
/// let learning = LearningOptions { transition_pseudo_count: 0.5, keep_prior: true, ..LearningOptions::default() };
/// assert_eq!(learning.iterations, 100);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct LearningOptions {
    /// Largest number of re-estimations; 100 by default.
    pub iterations: usize,
    /// Gain of a re-estimation below which learning stops, in nats of the objective; 1e-3 by
    /// default.
    pub tolerance: f64,
    /// True to keep the prior as it is. (Other parts of the model are kept by
    /// [`Fixed`](crate::Fixed).)
    pub keep_prior: bool,
    /// Pseudo-count of the prior; 0 by default.
    pub prior_pseudo_count: f64,
    /// Pseudo-count of the transition operator; 0 by default.
    pub transition_pseudo_count: f64,
    /// Pseudo-count of the sensor; 0 by default.
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

/// Reason why learning stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The last re-estimation gained less than the tolerance.
    Converged,
    /// The allowed number of iterations was made.
    Iterations,
}

/// A learned model, with the course of learning.
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
    /// The learned model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Returns the learned model by value.
    #[must_use]
    pub fn into_model(self) -> Hmm<A, B> {
        self.model
    }

    /// Values of the objective, of the given model and after each re-estimation: ln p of all
    /// observations, plus the logarithm of the Dirichlet density (up to a constant) if there are
    /// pseudo-counts. It never falls, up to rounding.
    #[must_use]
    pub fn objectives(&self) -> &[f64] {
        &self.objectives
    }

    /// Log-likelihood of all observations that were not [left out](Self::left_out), under the
    /// learned model.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Number of re-estimations.
    #[must_use]
    pub fn iterations(&self) -> usize {
        self.objectives.len() - 1
    }

    /// Reason why learning stopped.
    #[must_use]
    pub fn reason(&self) -> StopReason {
        self.reason
    }

    /// Sequences excluded from learning, with the reason: the given model rules them out, or they
    /// are not valid.
    #[must_use]
    pub fn left_out(&self) -> &[SequenceError] {
        &self.left_out
    }
}

/// Expected statistics of the hidden states, given observations.
pub(super) struct Expected<B: LearnLikelihood> {
    /// Σ p(X_0 | y_1 … y_T) over the sequences.
    pub(super) first: Vec<f64>,
    pub(super) moves: Vec<MoveCounts>,
    pub(super) sensor: B::Statistics,
    pub(super) log_likelihood: LogSum,
}

/// # Learning
impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Learns prior, transitions and sensor from sequences of observations, of any lengths:
    /// Baum–Welch, from this model to a local maximum.
    ///
    /// States that are alike in this model (equal rows of the table, equal moves) stay alike: start
    /// from different ones, or from several random models, and keep the one with the highest
    /// [`log_likelihood`](LearnedModel::log_likelihood).
    ///
    /// Sequences that this model rules out are excluded: [`LearnedModel::left_out`] names them.
    ///
    /// Structure is kept: probabilities of 0 stay 0. Parts that must not be learned are wrapped
    /// in [`Fixed`](crate::Fixed). An iteration passes twice through each sequence, O(E) a step.
    /// With a stored matrix, eight sequences run in lanes, with 128 n T bytes for such a
    /// group; others, and those outside the range of `f64`, run one by one as in
    /// [`smooth_each`](Self::smooth_each), with O(n + E) memory and the sensor's statistics for
    /// each of 64 that are processed together. Empty sequences have no influence. Runs in
    /// parallel with the feature `rayon`, with the same result to the bit.
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
    /// Returns the expectations of all sequences, added up in order, and the errors of those that
    /// have none.
    fn expect<S>(&self, sequences: &[(usize, &S)]) -> (Expected<B>, Vec<SequenceError>)
    where
        Self: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let (mut sum, mut failed) = (self.nothing_expected(), Vec::new());
        let mut order = sequences.to_vec();
        let together = plan::for_learning(sequences.len()) == Engine::Lanes
            && self.transition().families() <= 1;
        let batch = if together { BatchModel::new(self) } else { None };
        if batch.is_some() {
            order.sort_by_key(|(_, sequence)| sequence.steps());
        }
        for some in order.chunks(64) {
            let results = match &batch {
                Some(batch) => {
                    let groups = some.chunks(LANES).collect();
                    in_parallel::map(groups, |group, memory: &mut BatchMemory| {
                        self.expect_together(batch, group, memory)
                    })
                }
                None => in_parallel::map(some.to_vec(), |(sequence, s), (): &mut ()| {
                    vec![self.expect_one(s).map_err(|source| SequenceError { sequence, source })]
                }),
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

    /// Returns the expectations of a group in lanes, and of each sequence that has to be
    /// processed by itself.
    fn expect_together<S>(
        &self,
        model: &BatchModel<'_, A, B>,
        sequences: &[(usize, &S)],
        memory: &mut BatchMemory,
    ) -> Vec<Result<Expected<B>, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let group = Group::new(sequences);
        let mut results = Vec::new();
        let mut held = [false; LANES];
        if group.is_in_lanes(self.states(), |sequences, _| plan::for_learning(sequences)) {
            let expected;
            (expected, held) = batch::expect(model, &group, memory);
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
            return Ok(expected); // no observations
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

    /// Returns the model that fits the expectations best.
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
