//! Beliefs and steps in logarithms, for what linear space does not hold.
//!
//! A step comes here, with nothing committed, if the belief before has logarithms, or the linear
//! step has noticed that it would lose a possible state ([`limits`](wayfix_kernels::limits), "Forms"). It is
//! the recursion of section 2 of the [formulas](crate::guide::formulas), with sums of products as
//! logarithms of sums of exponentials.

use std::f64::consts::LN_2;

use super::Step;
use super::state::{BeliefForm, StepOutcome, StepOutput};
use crate::error::InferenceError;
use crate::likelihood::{Diagonal, Likelihood};
use crate::transition::{Transition, TransitionEntries};
use wayfix_kernels::limits::{self, LIFT};
use wayfix_kernels::{self as kernels, Valid};

/// A distribution, also as logarithms if it has positive values outside the range of `f64`.
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

    /// Lists the states j that lead into a state i, with weights in proportion to α(j) A\[i, j\],
    /// which are NaN or all 0 if there are none. With `in_logs`, the step needs logarithms.
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
            // An empty list may come from entries too small to be listed in linear form.
            let nothing = || {
                !predecessors.is_empty() && predecessors.iter().all(|way| self.linear[way.0] == 0.0)
            };
            if limits::can_draw(total) || nothing() {
                return;
            }
        }
        // Some or all weights are too small for `f64`.
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
    /// Predicts in logarithms, into those of the output, and checks the prediction: a
    /// distribution, unless there is evidence on the move.
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
        // Lifted, so that the test of the sum sees what is below the range of `f64`, too.
        let lift = LIFT.ln();
        // (`predicted` is free in a step in logarithms, and serves as scratch for the test.)
        let states = output.predicted.iter_mut().zip(&output.logs);
        states.for_each(|(out, log)| *out = (log + lift).exp());
        self.check_prediction(&output.predicted)?;
        Ok(())
    }

    /// Updates the prediction in logarithms to the belief after the observation. `log_scale` is
    /// taken out of the likelihoods first, so that they keep their digits.
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
        // Neither prediction nor likelihoods are all 0 here, but they may have no state in common.
        let Some(normalizer) = normalize_logs(&mut output.logs, &mut output.after) else {
            return Err(InferenceError::Impossible { step: self.number });
        };
        let log = normalizer + log_scale + diagonal.log_factor;
        let in_logs = !self.hmm.rounds_tails() && loses(&output.logs, &output.after);
        Ok(StepOutcome { log, normalizer: 0.0, by_logs: true, in_logs, form: BeliefForm::Other })
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

/// Returns true if a probability above 0 rounds to 0 in linear space.
pub(crate) fn loses(logs: &[f64], linear: &[f64]) -> bool {
    logs.iter().zip(linear).any(|(log, p)| limits::needs_log(*p, *log))
}

/// Normalizes logarithms, and writes the distribution itself to `linear`. Returns the logarithm
/// of their sum, or `None` if the sum is 0.
pub(crate) fn normalize_logs(logs: &mut [f64], linear: &mut [f64]) -> Option<f64> {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return None;
    }
    // The largest term is e^0, so that the sum is from 1 to n and its logarithm exact enough.
    linear.iter_mut().zip(&*logs).for_each(|(out, log)| *out = (log - largest).exp());
    let sum = kernels::sum(linear);
    kernels::normalize(linear, sum);
    let normalizer = largest + sum.ln();
    // In two differences: the sum of both logarithms would round at the size of `largest`.
    logs.iter_mut().for_each(|log| *log = (*log - largest) - sum.ln());
    Some(normalizer)
}
