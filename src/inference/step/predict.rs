//! A prediction without an observation, p = A α, and the test that it is a distribution, since the
//! operator may be the user's own. With evidence on the move its sum is the probability of the
//! evidence (section 2 of the [formulas](crate::guide::formulas)).

use super::in_logs::{BeliefRef, loses, normalize_logs};
use super::state::{BeliefForm, StepOutcome, StepOutput, StepScratch};
use super::{Likelihoods, Step};
use crate::error::InferenceError;
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::transition::{Transition, TransitionEntries};
use wayfix_kernels::limits::{self, LIFT};
use wayfix_kernels::{self as kernels, Valid};

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// Returns true if the operator reports products of this step outside the range of `f64`.
    pub(crate) fn needs_logs(&self) -> bool {
        self.control.is_some_and(|control| self.hmm.transition().needs_logs(control))
    }

    /// Returns true if the operator reports single entries of this step outside the range of `f64`.
    pub(crate) fn entries_need_logs(&self) -> bool
    where
        A: TransitionEntries,
    {
        self.control.is_some_and(|control| self.hmm.transition().entries_need_logs(control))
    }

    /// Returns the checked diagonal of an observation and its largest value.
    pub(crate) fn diagonal<'a>(
        &'a self,
        observation: &'a B::Observation,
        scratch: &'a mut Scratch,
    ) -> Result<(Diagonal<'a>, f64), InferenceError> {
        let wrap = |cause| InferenceError::likelihood(self.number, cause);
        let diagonal = self.hmm.likelihood().diagonal(observation, scratch).map_err(wrap)?;
        let largest = diagonal.check(self.hmm.states()).map_err(wrap)?;
        Ok((diagonal, largest))
    }

    /// Computes `after = A before`, or a copy without a transition, for vectors of any scale. The
    /// control must have been checked.
    pub(crate) fn predict(&self, before: &[f64], after: &mut [f64]) {
        match self.control {
            Some(control) => self.hmm.transition().apply(control, before, after),
            None => after.copy_from_slice(before),
        }
    }

    /// Takes the step without an observation. Its log-likelihood is that of evidence on the move,
    /// or 0 without evidence.
    pub(crate) fn advance_unseen(
        &self,
        before: BeliefRef<'_>,
        scratch: &mut StepScratch,
    ) -> Result<StepOutcome, InferenceError> {
        let StepScratch { lifted, output, work } = scratch;
        let (evidence, rounds_tails) = (self.evidence()?, self.hmm.rounds_tails());
        let mut by_logs = before.logs.is_some() || (evidence.is_some() && self.needs_logs());
        // ln p(u), before the log factor of the evidence is added.
        let mut log = 0.0;
        if !by_logs {
            // Always lifted: there is no update here that would notice small products.
            self.predict(lifted.values(before.linear), &mut output.after);
            let sum = match evidence {
                None => Some(self.check_prediction(&output.after)?),
                Some(_) => self.evidence_sum(&output.after)?,
            };
            match sum {
                Some(sum) => {
                    let loses = output.after.iter().any(|p| limits::rounds_to_zero(*p, sum));
                    // Without evidence the sum is one up to rounding, which must not accumulate
                    // over steps.
                    kernels::normalize(&mut output.after, sum);
                    (by_logs, log) = (loses && !rounds_tails, (sum / LIFT).ln());
                }
                None => by_logs = true,
            }
        }
        // Starts over from the previous belief; the linear result is overwritten.
        let mut in_logs = false;
        if by_logs {
            self.predict_in_logs(before, evidence, output, &mut work.values)?;
            log = normalize_logs(&mut output.logs, &mut output.after).unwrap_or(f64::NEG_INFINITY);
            in_logs = !rounds_tails && loses(&output.logs, &output.after);
        }
        let log = evidence.map_or(0.0, |log_factor| log + log_factor);
        Ok(StepOutcome { log, normalizer: 0.0, by_logs, in_logs, form: BeliefForm::Other })
    }

    /// Checks that a lifted prediction is a distribution, since the operator may be the user's own,
    /// and returns its sum.
    pub(crate) fn check_prediction(&self, predicted: &[f64]) -> Result<f64, InferenceError> {
        let step = self.number;
        if let Err(state) = kernels::largest(predicted, Valid::Likelihoods) {
            let value = predicted[state] / LIFT;
            return Err(InferenceError::Predicted { step, state, value });
        }
        let lifted = kernels::sum(predicted);
        let sum = lifted / LIFT;
        if limits::is_one(sum) {
            Ok(lifted)
        } else {
            Err(InferenceError::PredictedSum { step, sum })
        }
    }

    /// Returns the sum of a lifted prediction with evidence, or `None` if the step has to be
    /// taken in logarithms.
    pub(crate) fn evidence_sum(&self, predicted: &[f64]) -> Result<Option<f64>, InferenceError> {
        if let Err(state) = kernels::largest(predicted, Valid::Likelihoods) {
            let value = predicted[state] / LIFT;
            // An overflow may come from the lift, and a NaN from 0 · ∞ after one: try logarithms.
            // If the operator itself gave ∞ or NaN, its logarithms will be invalid, too.
            if value == f64::INFINITY || value.is_nan() {
                return Ok(None);
            }
            return Err(InferenceError::Predicted { step: self.number, state, value });
        }
        let sum = kernels::sum(predicted);
        Ok(limits::is_evidence_sum(sum / LIFT).then_some(sum))
    }
    /// Returns true if a state that prediction and likelihood allow has become 0, or if a scaled
    /// likelihood is too small to have all its digits.
    #[cold]
    pub(super) fn loses_states(
        &self,
        likelihoods: Likelihoods<'_>,
        lifted: &[f64],
        output: &mut StepOutput,
    ) -> bool {
        // Predicted again: the fused product with a stored matrix did not keep p.
        self.predict(lifted, &mut output.predicted);
        let lost =
            |((&p, &after), &scaled): ((&f64, &f64), &f64)| limits::is_lost(p, after, scaled);
        let states = output.predicted.iter().zip(&*output.after).zip(likelihoods.values);
        // If the sensor's own likelihood is 0 the state is impossible, and 0 is right.
        match likelihoods.diagonal.values {
            Values::Linear(b) | Values::Checked { linear: b, .. } => {
                states.zip(b).any(|(state, b)| lost(state) && *b > 0.0)
            }
            Values::Log(b) => states.zip(b).any(|(state, b)| lost(state) && *b > f64::NEG_INFINITY),
        }
    }
}
