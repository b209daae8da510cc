//! A step of the filter with evidence on the move: measurements between two steps multiply the
//! entries of A, so that the sum of the prediction is their probability.

use super::belief_form::{BeliefForm, BeliefRef, LiftedBelief, StepOutcome, StepOutput};
use super::{Likelihoods, Step, holds};
use crate::error::InferenceError;
use crate::kernels::{self, Product, Valid};
use crate::likelihood::{Diagonal, Likelihood};
use crate::limits::{self, LIFT};
use crate::transition::{SparseTransition, Stored, Transition, TransitionEntries};

impl<'m, A: Transition, B: Likelihood> Step<'m, A, B> {
    /// Checks the control, and returns the log factor of the evidence on the move to this step,
    /// if any.
    #[inline]
    pub(crate) fn evidence(&self) -> Result<Option<f64>, InferenceError> {
        let Some(control) = self.control else { return Ok(None) };
        self.check_control(control)?;
        match self.hmm.transition().evidence(control) {
            Some(value) if limits::is_log(value) => Ok(Some(value)),
            Some(value) => Err(InferenceError::EvidenceFactor { step: self.number, value }),
            None => Ok(None),
        }
    }

    /// Returns true if entries of a step with evidence are outside the range of `f64`.
    pub(crate) fn needs_logs(&self) -> bool {
        self.control.is_some_and(|control| self.hmm.transition().needs_logs(control))
    }

    /// Returns true if single entries of a step with evidence are outside the range of `f64`.
    pub(crate) fn entries_need_logs(&self) -> bool
    where
        A: TransitionEntries,
    {
        self.control.is_some_and(|control| self.hmm.transition().entries_need_logs(control))
    }

    /// Returns the sparse matrix of the step, if there is one and no evidence.
    pub(crate) fn stored(&self, control: &A::Control) -> Option<&'m SparseTransition> {
        let transition = self.hmm.transition();
        let matrix = transition.stored(control).and_then(Stored::as_sparse)?;
        transition.evidence(control).is_none().then_some(matrix)
    }

    /// Advances with evidence on the move, otherwise as [`advance`](Self::advance).
    pub(crate) fn advance_by_evidence(
        &self,
        log_factor: f64,
        diagonal: &Diagonal<'_>,
        before: BeliefRef<'_>,
        lifted: &mut LiftedBelief,
        results: &mut StepOutput<'_>,
        values: &mut [f64],
    ) -> Result<StepOutcome, InferenceError> {
        let wrap = |cause| InferenceError::likelihood(self.number, cause);
        let largest = diagonal.check(self.hmm.states()).map_err(wrap)?;
        let tails_rounded = self.hmm.rounds_tails();
        let (likelihoods, log_scale) = match diagonal.linear_values() {
            Some(linear) if limits::is_unscaled(largest) => {
                (Likelihoods { diagonal, values: linear, scaled: false, tails_rounded }, 0.0)
            }
            _ => {
                let log_scale = self.scale(diagonal, largest, values)?;
                (Likelihoods { diagonal, values, scaled: true, tails_rounded }, log_scale)
            }
        };
        let log_factors = log_factor + diagonal.log_factor;
        if before.logs.is_none()
            && !self.needs_logs()
            && let Some((n, form)) =
                self.advance_in_doubles_by_evidence(likelihoods, before, lifted, results)?
        {
            let normalizer = if likelihoods.scaled { 0.0 } else { n };
            let log = n.ln() + log_scale + log_factors;
            return Ok(StepOutcome { log, normalizer, by_logs: false, in_logs: false, form });
        }
        self.predict_in_logs(before, Some(log_factor), results, values)?;
        let advanced = self.update_in_logs(diagonal, log_scale, results)?;
        Ok(StepOutcome { log: advanced.log + log_factor, ..advanced })
    }

    /// Takes the step in linear space. Returns the normaliser of the likelihoods, with the
    /// probability of the evidence in it, or `None` if the results leave the range of `f64`.
    fn advance_in_doubles_by_evidence(
        &self,
        likelihoods: Likelihoods<'_>,
        before: BeliefRef<'_>,
        lifted: &mut LiftedBelief,
        results: &mut StepOutput<'_>,
    ) -> Result<Option<(f64, BeliefForm)>, InferenceError> {
        let lifted = lifted.values(before.linear);
        self.predict(lifted, results.predicted);
        let prediction = Product::Computed(results.predicted);
        let updated = kernels::forward_step(likelihoods.update(prediction, LIFT, results.lifted));
        // A NaN or infinite value makes the sum NaN or infinite.
        if updated.negative_predicted || !limits::is_evidence_sum(updated.predicted / LIFT) {
            self.evidence_sum(results.predicted)?;
            return Ok(None);
        }
        if !holds(&updated, updated.predicted) {
            return Ok(None);
        }
        let tiny = kernels::normalize_and_lift(results.lifted, results.after, updated.products);
        if updated.small && self.loses_states(likelihoods, lifted, results) {
            return Ok(None);
        }
        Ok(Some((updated.products / LIFT, BeliefForm::Lifted { tiny })))
    }

    /// Returns the sum of a lifted prediction with evidence, or `None` if the step has to be
    /// taken in logarithms.
    pub(crate) fn evidence_sum(&self, predicted: &[f64]) -> Result<Option<f64>, InferenceError> {
        if let Err(state) = kernels::largest(predicted, Valid::Likelihoods) {
            let value = predicted[state] / LIFT;
            // May be finite without the lift; a NaN may be an entry of 0 times such a value. If it
            // is the operator's own, so are the logarithms.
            if value == f64::INFINITY || value.is_nan() {
                return Ok(None);
            }
            return Err(InferenceError::Predicted { step: self.number, state, value });
        }
        let sum = kernels::sum(predicted);
        Ok(limits::is_evidence_sum(sum / LIFT).then_some(sum))
    }

    /// Checks that the logarithms of a prediction with evidence are numbers or −∞, and not all
    /// −∞.
    pub(crate) fn check_log_evidence(&self, logs: &[f64]) -> Result<(), InferenceError> {
        let step = self.number;
        match kernels::largest(logs, Valid::Logs) {
            Err(state) => Err(InferenceError::Predicted { step, state, value: logs[state].exp() }),
            Ok(f64::NEG_INFINITY) => Err(InferenceError::ImpossibleMove { step }),
            Ok(_) => Ok(()),
        }
    }
}
