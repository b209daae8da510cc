//! Learning by expectation–maximisation (Baum, Petrie, Soules and Weiss 1970; Rabiner 1989,
//! section III-C; section 9 of the [formulas](crate::guide::formulas)).
//!
//! No iteration lowers the objective, up to rounding. If one does, some part does not maximise it,
//! and learning ends with the model before, or with an error.

use std::ops::ControlFlow;

use super::e_step::Expectations;
use super::learned_model::{LearnedModel, LearningOptions};
use crate::error::LearnError;
use crate::hmm::Hmm;
use crate::likelihood::{LearnLikelihood, Likelihood};
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, Transition};

/// Relative fall of the objective up to which it counts as rounding.
const ROUNDING: f64 = 1e-9;
/// Relative fall up to which learning ends with the model before; a larger one is an error.
const SMALL_FALL: f64 = 1e-3;

/// # Learning
impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Learns prior, transitions and sensor from sequences of observations, of any lengths:
    /// Baum–Welch, from this model to a local maximum.
    ///
    /// States that are alike in this model (equal rows of the table, equal moves) stay alike. So
    /// start from states that differ, or from several random models, and keep the result with the
    /// highest [`log_likelihood`](LearnedModel::log_likelihood).
    ///
    /// Sequences that this model rules out are excluded: [`LearnedModel::left_out`] names them.
    /// Empty sequences have no influence.
    ///
    /// Structure is kept: probabilities of 0 stay 0. Parts that must not be learned are wrapped
    /// in [`Fixed`](crate::Fixed).
    ///
    /// An iteration passes through each sequence twice, with O(E) a step. With a stored matrix,
    /// eight sequences run in lanes, with 128 n T bytes for such a group; others, and those outside
    /// the range of `f64`, run one by one as in [`smooth_each`](Self::smooth_each), with O(n √T +
    /// E) memory and the sensor's statistics for each of the 64 that are processed together. Runs
    /// in parallel with the feature `rayon`, with the same result to the bit.
    ///
    /// A [stationary](crate::Prior::Stationary) prior is learned together with the operator that it
    /// follows from. Each iteration then takes several eliminations of states, O(n³) each for a
    /// full matrix. This works for sparse, dense, constrained and restart operators; others are an
    /// error ([`LearnError::Stationary`]) unless they are fixed.
    ///
    /// A long sequence (2,048 steps or more) runs in lanes too, if there are at most four sequences
    /// or it is too long for a lane, and if the model forgets its state within a few
    /// hundred steps. Eight segments run at a time, each with some steps before and after it. That
    /// takes 1 MB for each thread (up to 64 if the model forgets slowly), and the statistics and
    /// expected moves of 64 such groups. It is exact: at every joint the beliefs and the ratios
    /// γ / α of the two segments agree up to factors within 1e-13 of each other, or else the
    /// sequence runs in one piece. No step enlarges such a difference, so that relative errors are
    /// bounded by 2e-13 for each joint; usually they are those of rounding.
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
    /// [`LearnError`] without observations to learn from, or if an option is not valid, a prior
    /// rules out what was learned, a part cannot be re-estimated the first time or then rules out a
    /// sequence, or the objective falls by more than a thousandth (which an operator or sensor of
    /// your own may cause). Smaller failures after the first iteration end learning with the best
    /// model so far; see [`LearnedModel::cause`].
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
        self.learn_until(sequences, learning, |_| ControlFlow::Continue(()))
    }

    /// Learns as [`learn`](Self::learn) does, and passes the model after each re-estimation to
    /// `visit`, which may print or store it, and may stop learning.
    ///
    /// ```
    /// use std::ops::ControlFlow;
    /// use wayfix::inference::LearningOptions;
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let hmm = Hmm::new(
    /// #     Prior::AtFirstObservation(Belief::uniform(2)?),
    /// #     DenseTransition::from_rows(&[[0.6, 0.4], [0.4, 0.6]])?,
    /// #     TableLikelihood::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?,
    /// # )?;
    /// let seen = [vec![0, 0, 0, 0, 1, 1, 1], vec![1, 1, 1, 0, 0, 0, 0, 0]];
    /// let learned = hmm.learn_until(&seen, &LearningOptions::default(), |now| {
    ///     println!("{}: {}", now.iterations(), now.objective());
    ///     if now.iterations() < 3 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    /// })?;
    /// assert_eq!((learned.iterations(), learned.stopped()), (3, true));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError`] as [`learn`](Self::learn).
    pub fn learn_until<S>(
        &self,
        sequences: &[S],
        learning: &LearningOptions,
        mut visit: impl FnMut(&LearnedModel<A, B>) -> ControlFlow<()>,
    ) -> Result<LearnedModel<A, B>, LearnError>
    where
        A: LearnTransition,
        B: LearnLikelihood,
        Self: Clone + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let mut run = LearningRun::begin(self, sequences, learning)?;
        run.run_until(learning, learning.iterations, &mut visit)?;
        Ok(run.best)
    }
}

/// Learning in progress.
pub(super) struct LearningRun<'s, A: LearnTransition, B: LearnLikelihood, S> {
    /// The model so far.
    pub(super) best: LearnedModel<A, B>,
    /// Expectations under it.
    expected: Expectations<B, A::Statistics>,
    /// Sequences that the given model does not rule out, with their indices.
    remaining: Vec<(usize, &'s S)>,
}

impl<'s, A, B, S> LearningRun<'s, A, B, S>
where
    A: LearnTransition,
    B: LearnLikelihood,
    Hmm<A, B>: Clone + Sync,
    S: Sequence<A::Control, B::Observation> + Sync,
{
    /// Computes the expectations under the given model.
    pub(super) fn begin(
        hmm: &Hmm<A, B>,
        sequences: &'s [S],
        learning: &LearningOptions,
    ) -> Result<Self, LearnError> {
        learning.check()?;
        let all: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
        let (expected, left_out) = hmm.expectations_of(&all);
        let out = |index: &usize| left_out.binary_search_by_key(index, |e| e.sequence).is_ok();
        // Zeros stay 0, so a sequence that this model rules out has likelihood 0 whatever is
        // learned from the others.
        let remaining: Vec<_> = all.into_iter().filter(|(index, _)| !out(index)).collect();
        let observations = remaining.iter().map(|(_, sequence)| sequence.steps()).sum();
        if observations == 0 {
            let sequences = sequences.len();
            return Err(LearnError::nothing(sequences, left_out.into_iter().next()));
        }
        let log_likelihood = expected.log_likelihood();
        // Counted in the given model: zeros that learning makes were free parameters all the same.
        let of_prior = if learning.keep_prior { hmm.free_in_prior() } else { 0 };
        let best = LearnedModel {
            model: hmm.clone(),
            start: 0,
            ends: 1,
            objectives: vec![log_likelihood + hmm.log_prior(learning)],
            log_likelihood,
            converged: false,
            stopped: false,
            cause: None,
            left_out,
            parameters: hmm.free_parameters() - of_prior,
            observations,
        };
        Ok(Self { best, expected, remaining })
    }

    /// Re-estimates the model until learning ends, or until `iterations` re-estimations were made
    /// in all.
    pub(super) fn run_until(
        &mut self,
        learning: &LearningOptions,
        iterations: usize,
        visit: &mut impl FnMut(&LearnedModel<A, B>) -> ControlFlow<()>,
    ) -> Result<(), LearnError> {
        let best = &mut self.best;
        best.stopped = false;
        while !best.converged && best.cause.is_none() && best.iterations() < iterations {
            let iteration = best.iterations() + 1;
            // M-step, then the E-step of the next model, which also gives the likelihood to judge
            // it by.
            let next = best.model.maximize(&self.expected, learning).and_then(|model| {
                let (expected, failed) = model.expectations_of(&self.remaining);
                match failed.into_iter().next() {
                    Some(error) => Err(error.into()),
                    None => Ok((model, expected)),
                }
            });
            let (model, expected) = match next {
                Ok(next) => next,
                // Before the first re-estimation, no learned model exists to return.
                Err(error) if iteration == 1 => return Err(error),
                Err(error) => {
                    best.cause = Some(error);
                    break;
                }
            };
            let log_likelihood = expected.log_likelihood();
            let log_prior = model.log_prior(learning);
            if !log_prior.is_finite() {
                return Err(LearnError::LogPrior { iteration, value: log_prior });
            }
            let objective = log_likelihood + log_prior;
            let before = best.objective();
            let fall = (before - objective) / objective.abs().max(1.0);
            // In exact arithmetic no iteration lowers the objective (Dempster, Laird and Rubin
            // 1977), but sums over long sequences round.
            if fall.is_nan() || fall > ROUNDING {
                let fell = LearnError::Fell { iteration, before, after: objective };
                // False for NaN, which is an error.
                if fall <= SMALL_FALL {
                    best.cause = Some(fell);
                    break;
                }
                return Err(fell);
            }
            best.objectives.push(objective);
            (best.model, best.log_likelihood, self.expected) = (model, log_likelihood, expected);
            let stopped = visit(best).is_break();
            best.converged = objective - before < learning.tolerance;
            best.stopped = stopped && !best.converged;
            if best.stopped {
                break;
            }
        }
        Ok(())
    }
}

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Returns the log density of the parameters under the priors of options and parts, up to a
    /// constant.
    #[doc(hidden)]
    pub fn log_prior(&self, learning: &LearningOptions) -> f64 {
        let prior = if learning.keep_prior || learning.prior_pseudo_count == 0.0 {
            0.0
        } else {
            // The Dirichlet density over the possible states; a probability of 0 stays 0, and is
            // not a parameter.
            let possible = self.prior().belief().as_slice().iter().filter(|p| **p > 0.0);
            learning.prior_pseudo_count * possible.map(|p| p.ln()).sum::<f64>()
        };
        prior
            + self.transition().log_prior(learning.transition_pseudo_count)
            + self.likelihood().log_prior(learning.likelihood_pseudo_count)
    }
}
