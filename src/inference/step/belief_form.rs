//! Forms in which a step takes a belief and leaves one: plain, lifted, or in logarithms. The limits
//! of each form, and why they are enough, are in [`range`].

use std::f64::consts::LN_2;

use crate::kernels::{self, Aligned};
use crate::limits::{self, LIFT, LIFTED_STEPS};
use crate::transition::TransitionEntries;

/// A distribution, also as logarithms if it has positive values outside the range of `f64`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BeliefRef<'a> {
    pub(crate) linear: &'a [f64],
    pub(crate) logs: Option<&'a [f64]>,
}

impl BeliefRef<'_> {
    /// Returns the logarithm of one probability.
    pub(crate) fn log(&self, state: usize) -> f64 {
        self.logs.map_or_else(|| self.linear[state].ln(), |logs| logs[state])
    }

    /// Lists the states j that lead into a state i, with weights in proportion to α(j) A\[i, j\],
    /// which are NaN or all 0 if there are none. With `in_logs`, the step needs logarithms.
    pub(crate) fn ways<A: TransitionEntries>(
        &self,
        transition: &A,
        control: &A::Control,
        to: usize,
        in_logs: bool,
        ways: &mut Vec<(usize, f64)>,
    ) {
        ways.clear();
        if !in_logs && self.logs.is_none() {
            let incoming = transition.incoming(control, to);
            ways.extend(incoming.map(|(from, p)| (from, self.linear[from] * LIFT * p)));
            let total: f64 = ways.iter().map(|way| way.1).sum();
            // An empty list may come from entries too small to be listed in linear form.
            let nothing = || !ways.is_empty() && ways.iter().all(|way| self.linear[way.0] == 0.0);
            if limits::can_draw(total) || nothing() {
                return;
            }
        }
        // Some or all weights are too small for `f64`.
        ways.clear();
        let incoming = transition.incoming_log2(control, to);
        ways.extend(incoming.map(|(from, log2)| (from, self.log(from) + log2 * LN_2)));
        let largest = ways.iter().map(|way| way.1).fold(f64::NEG_INFINITY, f64::max);
        ways.iter_mut().for_each(|way| way.1 = (way.1 - largest).exp());
    }

    /// Writes the logarithms, from either form.
    pub(crate) fn logs_to(&self, out: &mut [f64]) {
        match self.logs {
            Some(logs) => out.copy_from_slice(logs),
            None => out.iter_mut().zip(self.linear).for_each(|(out, p)| *out = p.ln()),
        }
    }
}

/// Belief before a step in the form that products take: lifted by [`LIFT`], unless neither it nor
/// the matrix has values so small that it matters.
#[derive(Debug, Clone)]
pub(crate) struct LiftedBelief {
    values: Aligned,
    /// True if `values` belong to the present belief.
    valid: bool,
    /// True if the belief has a [tiny](limits::is_tiny) value.
    tiny: bool,
    /// Number of further steps to lift in any case, after small results.
    more: u32,
}

impl LiftedBelief {
    pub(crate) fn new(belief: &[f64]) -> Self {
        let values = Aligned::new(belief.len(), 0.0);
        let mut new = Self { values, valid: false, tiny: false, more: 0 };
        new.follow(belief);
        new
    }

    /// Switches to another belief.
    pub(crate) fn follow(&mut self, belief: &[f64]) {
        (self.valid, self.tiny) = (false, kernels::any_tiny(belief));
    }

    /// Returns true if products take the lifted belief.
    pub(crate) fn is_needed(&self) -> bool {
        self.tiny || self.more > 0
    }

    /// Lifts the next steps, after a result that was too small.
    pub(crate) fn lift_for_some_steps(&mut self) {
        self.more = LIFTED_STEPS;
    }

    /// Returns the lifted belief.
    pub(crate) fn values(&mut self, belief: &[f64]) -> &[f64] {
        if !self.valid {
            kernels::lift(belief, &mut self.values);
            self.valid = true;
        }
        &self.values
    }

    /// Takes over the belief that a step has put into its results.
    pub(crate) fn commit(&mut self, form: BeliefForm, lifted: &mut Aligned) {
        self.more = self.more.saturating_sub(1);
        match form {
            BeliefForm::Plain { tiny } => (self.valid, self.tiny) = (false, tiny),
            BeliefForm::Lifted { tiny } => {
                std::mem::swap(&mut self.values, lifted);
                (self.valid, self.tiny) = (true, tiny);
            }
            BeliefForm::Other => {}
        }
    }
}

/// BeliefForm in which a step has left its result.
#[derive(Debug, Clone, Copy)]
pub(crate) enum BeliefForm {
    /// The belief is in [`StepOutput::lifted`], not lifted.
    Plain { tiny: bool },
    /// The belief is in [`StepOutput::after`], and lifted in [`StepOutput::lifted`].
    Lifted { tiny: bool },
    /// The belief is in [`StepOutput::after`] alone.
    Other,
}

/// Output buffers of a step.
pub(crate) struct StepOutput<'a> {
    /// Prediction, lifted, which sums to [`LIFT`] up to rounding and evidence on the move; not
    /// written where it is not needed.
    pub(crate) predicted: &'a mut [f64],
    /// Belief after the observation.
    pub(crate) after: &'a mut [f64],
    /// Belief after the observation, in the form that [`BeliefForm`] says.
    pub(crate) lifted: &'a mut [f64],
    /// Logarithms of the belief, if [`StepOutcome::in_logs`].
    pub(crate) logs: &'a mut [f64],
}

/// Outcome of a step, besides its [`StepOutput`].
pub(crate) struct StepOutcome {
    /// ln N, the log-likelihood of the observation and of evidence on the move.
    pub(crate) log: f64,
    /// N itself, if the step was taken with the likelihoods as the sensor gave them, else 0.
    pub(crate) normalizer: f64,
    /// True if the step was taken in logarithms.
    pub(crate) by_logs: bool,
    /// True if the belief has to be kept as logarithms too.
    pub(crate) in_logs: bool,
    /// BeliefForm and place of the belief.
    pub(crate) form: BeliefForm,
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
    linear.iter_mut().zip(&*logs).for_each(|(out, log)| *out = (log - largest).exp());
    let sum = kernels::sum(linear);
    kernels::normalize(linear, sum);
    let normalizer = largest + sum.ln();
    logs.iter_mut().for_each(|log| *log = (*log - largest) - sum.ln());
    Some(normalizer)
}
