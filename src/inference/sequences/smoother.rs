//! Batch smoother (section 3 of the [formulas](crate::guide::formulas)): a forward pass, then a
//! backward pass over the same block, in which γ of each step overwrites α of the next. At T both
//! are the same.

use super::posteriors::Posteriors;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::engines::{choice, few_states, lanes};
use crate::inference::step::Step;
use crate::inference::step::backward::Backward;
use crate::inference::step::forward_pass::ForwardPass;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Smoothed distributions of a whole sequence.
///
/// Made by [`Hmm::smooth`].
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedSequence {
    posteriors: Posteriors,
    log_likelihood: f64,
    steps_in_logs: usize,
}

impl SmoothedSequence {
    /// Creates the result of a routine that takes no steps in logarithms.
    pub(crate) fn new(posteriors: Posteriors, log_likelihood: f64) -> Self {
        Self { posteriors, log_likelihood, steps_in_logs: 0 }
    }

    /// Smoothed distributions p(X_k | y_1 … y_T) for k = 0 … T; at T, the filtered one.
    #[must_use]
    pub fn posteriors(&self) -> &Posteriors {
        &self.posteriors
    }

    /// Returns the distributions without the rest of the result.
    #[must_use]
    pub fn into_posteriors(self) -> Posteriors {
        self.posteriors
    }

    /// Log-likelihood ln p(y_1 … y_T).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Number of steps taken in logarithms, forward or backward, which is several times slower.
    /// With up to eight states it may be lower than that of a filter. If there are many, and the
    /// tails of the model are not credible anyway, [rounded tails](Hmm::with_rounded_tails) are
    /// faster.
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.steps_in_logs
    }
}

impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Smooths a sequence of observations (paper eqs. 10 to 14): returns the distribution of
    /// every step given all of them.
    ///
    /// An empty sequence is allowed: the posterior of X_0 is then the prior.
    ///
    /// Costs two products with A or A' and O(n) a step (three where the sensor has to compute its
    /// likelihoods). The result holds at most n (T + 2) numbers; other memory grows by one number a
    /// step, and by n for each step outside the range of `f64`.
    ///
    /// Models with up to eight states and no control use specialised algorithms, which are faster;
    /// with five states or more these take n T additional `f64`s. With more than eight states and a
    /// dense matrix, or with a sparse one of a few dozen states, a sequence of 2,048 steps or more
    /// runs in lanes if the model forgets fast enough: in segments that are joined as those of
    /// [`learn`](Self::learn), with the same bound on the error and up to 64 MB of other memory.
    ///
    /// For very long sequences use [`smooth_each`](Self::smooth_each), for live ones
    /// [`fixed_lag`](Self::fixed_lag).
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
    /// let smoothing = hmm.smooth(&[0, 0, 1, 0, 0])?;
    /// let third = smoothing.posteriors().get(3).unwrap();
    /// assert!((third.as_slice()[0] - 0.307_483_576_006_617_7).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`InferenceError`] with the step at which an observation is impossible
    /// or has no valid likelihood, or a control is not valid.
    pub fn smooth<S>(&self, sequence: &S) -> Result<SmoothedSequence, InferenceError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (states, steps) = (self.states(), sequence.steps());
        let whole = if choice::is_whole(states, steps) {
            few_states::smooth(self, sequence)
        } else if choice::smooths_in_lanes(states, steps) {
            lanes::smooth(self, sequence)
        } else {
            None
        };
        if let Some((rows, log_likelihood)) = whole {
            let posteriors = Posteriors::from_values(states, rows);
            return Ok(SmoothedSequence::new(posteriors, log_likelihood));
        }
        // One extra row, in which the backward pass begins (see `ForwardPass::turn`).
        let (mut pass, last) = ForwardPass::over(self, sequence, 1, |_| ())?;
        let mut backward = Backward::new(self.states());
        pass.turn();
        let mut steps_in_logs = 0;
        for number in (1..=sequence.steps()).rev() {
            let step = Step::of(self, sequence, number);
            let seen = pass.seen(number, sequence.observation(number));
            let (alpha, out, gamma) = pass.way_back(number);
            backward.step_back_from(&step, &seen, alpha, gamma, out)?;
            // A step counts once, whether it was forward, backward or both.
            steps_in_logs += usize::from(pass.by_logs(number) || backward.in_logs);
        }
        let posteriors = Posteriors::after_a_row(self.states(), pass.rows.into_values());
        let log_likelihood = last.log_likelihood.value();
        Ok(SmoothedSequence { posteriors, log_likelihood, steps_in_logs })
    }
}
