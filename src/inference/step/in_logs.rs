//! Beliefs and steps in logarithms, for values that linear space cannot hold.
//!
//! A step comes here, with nothing committed yet, if the previous belief has logarithms or if the
//! linear step would have lost a possible state ([`limits`](wayfix_kernels::limits), "Forms"). The recursion
//! is that of section 2 of the [formulas](crate::guide::formulas), with log-sum-exp in place of
//! sums of products.

use std::f64::consts::LN_2;

use super::Step;
use super::state::{BeliefForm, StepOutcome, StepOutput};
use crate::error::InferenceError;
use crate::likelihood::{Diagonal, Likelihood};
use crate::transition::{Transition, TransitionEntries};
use wayfix_kernels::limits::{self, LIFT};
use wayfix_kernels::{self as kernels, Valid};

/// A distribution, with its logarithms too if it has positive values outside the range of `f64`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BeliefRef<'a> {
    pub(crate) linear: &'a [f64],
    pub(crate) logs: Option<&'a [f64]>,
}

impl BeliefRef<'_> {
    /// Returns the logarithm of one probability.
    #[doc(hidden)]
    pub(crate) fn log(&self, state: usize) -> f64 {
        self.logs.map_or_else(|| self.linear[state].ln(), |logs| logs[state])
    }

    /// Lists the states j that lead into state i, with weights proportional to α(j) A\[i, j\]. If
    /// none has a positive weight, the weights are NaN or all 0. `in_logs` says that the step needs
    /// logarithms.
    pub(crate) fn predecessors<A: TransitionEntries>(
        &self,
        transition: &A,
        control: &A::Control,
        to: usize,
        in_logs: bool,
        predecessors: &mut Vec<(usize, f64)>,
    ) {
        predecessors.clear();
        if !in_logs && self.logs.is_none() {
            let incoming = transition.incoming(control, to);
            predecessors.extend(incoming.map(|(from, p)| (from, self.linear[from] * LIFT * p)));
            let total: f64 = predecessors.iter().map(|way| way.1).sum();
            // All weights are truly 0 if every listed α(j) is. An empty list proves nothing, since
            // entries too small for doubles are not listed in linear form.
            let nothing = || {
                !predecessors.is_empty() && predecessors.iter().all(|way| self.linear[way.0] == 0.0)
            };
            if limits::can_draw(total) || nothing() {
                return;
            }
        }
        // Some or all weights are too small for `f64`. Dividing by the largest, in logarithms,
        // makes it 1; −∞ − −∞ gives the documented NaN.
        predecessors.clear();
        let incoming = transition.incoming_log2(control, to);
        predecessors.extend(incoming.map(|(from, log2)| (from, self.log(from) + log2 * LN_2)));
        let largest = predecessors.iter().map(|way| way.1).fold(f64::NEG_INFINITY, f64::max);
        predecessors.iter_mut().for_each(|way| way.1 = (way.1 - largest).exp());
    }

    /// Writes the logarithms, from either form.
    pub(crate) fn logs_to(&self, out: &mut [f64]) {
        match self.logs {
            Some(logs) => out.copy_from_slice(logs),
            None => out.iter_mut().zip(self.linear).for_each(|(out, p)| *out = p.ln()),
        }
    }
}

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// Predicts in logarithms, into `output.logs`, and checks the prediction: it must be a
    /// distribution unless there is evidence on the move.
    pub(crate) fn predict_in_logs(
        &self,
        before: BeliefRef<'_>,
        evidence: Option<f64>,
        output: &mut StepOutput,
        values: &mut [f64],
    ) -> Result<(), InferenceError> {
        before.logs_to(values);
        match self.control {
            Some(control) => self.hmm.transition().apply_log(control, values, &mut output.logs),
            None => output.logs.copy_from_slice(values),
        }
        if evidence.is_some() {
            return self.check_log_evidence(&output.logs);
        }
        // Lifted, so that the test of the sum includes values below the range of `f64`.
        // `predicted` is unused by a step in logarithms, and serves as scratch here.
        let lift = LIFT.ln();
        let states = output.predicted.iter_mut().zip(&output.logs);
        states.for_each(|(out, log)| *out = (log + lift).exp());
        self.check_prediction(&output.predicted)?;
        Ok(())
    }

    /// Updates the prediction in logarithms to the belief after the observation. `log_scale` is
    /// subtracted from the log-likelihoods first, so that the sums keep their digits.
    #[cold]
    pub(crate) fn update_in_logs(
        &self,
        diagonal: &Diagonal<'_>,
        log_scale: f64,
        output: &mut StepOutput,
    ) -> Result<StepOutcome, InferenceError> {
        for (out, log) in output.logs.iter_mut().zip(diagonal.logs()) {
            *out += log - log_scale;
        }
        // Callers have excluded an all-zero prediction and all-zero likelihoods, but the two may
        // have no state in common.
        let Some(normalizer) = normalize_logs(&mut output.logs, &mut output.after) else {
            return Err(InferenceError::Impossible { step: self.number });
        };
        let log = normalizer + log_scale + diagonal.log_factor;
        let in_logs = !self.hmm.rounds_tails() && loses(&output.logs, &output.after);
        Ok(StepOutcome { log, normalizer: 0.0, by_logs: true, in_logs, form: BeliefForm::Other })
    }

    /// Checks that the logarithms of a prediction with evidence are finite or −∞, and not all −∞.
    pub(crate) fn check_log_evidence(&self, logs: &[f64]) -> Result<(), InferenceError> {
        let step = self.number;
        match kernels::largest(logs, Valid::Logs) {
            Err(state) => Err(InferenceError::Predicted { step, state, value: logs[state].exp() }),
            Ok(f64::NEG_INFINITY) => Err(InferenceError::ImpossibleMove { step }),
            Ok(_) => Ok(()),
        }
    }
}

/// Returns true if some probability above 0 rounds to 0 in linear space.
pub(crate) fn loses(logs: &[f64], linear: &[f64]) -> bool {
    logs.iter().zip(linear).any(|(log, p)| limits::needs_log(*p, *log))
}

/// Normalises a distribution given by logarithms, and writes it to `linear` too. Returns the
/// logarithm of the sum, or `None` if the sum is 0.
pub(crate) fn normalize_logs(logs: &mut [f64], linear: &mut [f64]) -> Option<f64> {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return None;
    }
    // Log-sum-exp: the largest term is e^0, so that the sum is from 1 to n, and small terms round
    // away harmlessly.
    linear.iter_mut().zip(&*logs).for_each(|(out, log)| *out = (log - largest).exp());
    let sum = kernels::sum(linear);
    kernels::normalize(linear, sum);
    let normalizer = largest + sum.ln();
    // Two subtractions: `largest + ln sum` would round at the size of `largest`, whereas the first
    // difference here is small and so nearly exact.
    logs.iter_mut().for_each(|log| *log = (*log - largest) - sum.ln());
    Some(normalizer)
}
