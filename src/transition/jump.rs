//! Jumps beside the moves of an operator: the arithmetic of restarts, and of moves off the map and
//! back. From any state, a step is a move of A with probability κ, and a jump otherwise.
//!
//! `out = κ A x + r s`, with the probability r of a jump to each state and the mass s that jumps.
//! With [evidence on moves](Transition::evidence) the entries of A have a log factor c taken out,
//! so jumps are scaled by p(u | jump) exp(−c).

use std::f64::consts::LOG2_E;

use super::Transition;
use super::log::{self, LARGEST_LINEAR_ENTRY};
use crate::belief::Belief;
use crate::error::{OutOfRange, TransitionError};
use wayfix_kernels::{self as kernels, log2};

/// The moves of an operator, and jumps added to them.
#[derive(Debug, Clone)]
pub(crate) struct Jumps<A> {
    pub(crate) inner: A,
    /// Probability of a move by the inner operator, κ.
    pub(crate) move_probability: f64,
    /// Probability of a jump to each state, r, and its logarithms.
    pub(crate) jump_probabilities: Vec<f64>,
    pub(crate) log2_jump_probabilities: Vec<f64>,
    /// ln p(u) at a jump; if `None`, the log factor that the inner operator takes out.
    pub(crate) evidence: Option<f64>,
}

impl<A: Transition> Jumps<A> {
    /// Adds jumps to the moves of an operator. The caller has checked the probabilities, and that
    /// there is one for each state.
    pub(crate) fn new(inner: A, move_probability: f64, jump_probabilities: Vec<f64>) -> Self {
        let log2_jump_probabilities = jump_probabilities.iter().map(|&p| log2(p)).collect();
        Self {
            inner,
            move_probability,
            jump_probabilities,
            log2_jump_probabilities,
            evidence: None,
        }
    }

    /// The same jumps with another operator.
    pub(super) fn with_inner(&self, inner: A) -> Self {
        Self {
            evidence: self.evidence,
            ..Self::new(inner, self.move_probability, self.jump_probabilities.clone())
        }
    }

    /// Sets the log-likelihood of evidence at a jump, which must be finite; `place` names the jumps
    /// in errors.
    pub(crate) fn with_evidence(
        self,
        evidence: Option<f64>,
        place: &str,
    ) -> Result<Self, TransitionError> {
        if let Some(value) = evidence.filter(|log| !log.is_finite()) {
            let what = format!("the log-likelihood of evidence {place}");
            return Err(OutOfRange::new(what, value, "a finite number").into());
        }
        Ok(Self { evidence, ..self })
    }

    /// Logarithm of the factor of jumps at a step; 0 without evidence.
    pub(crate) fn log_factor(&self, control: &A::Control) -> f64 {
        let taken_out = self.inner.evidence(control);
        // By default ln p(u | jump) is what was taken out, and the difference 0.
        taken_out.map_or(0.0, |taken_out| self.evidence.map_or(0.0, |log| log - taken_out))
    }

    /// Base-2 logarithm of the factor of jumps, on the grid of scores.
    pub(crate) fn log2_factor(&self, control: &A::Control) -> f64 {
        kernels::on_grid(self.log_factor(control) * LOG2_E)
    }

    /// True if a jump, or one of the `further` probabilities times the factor of jumps, is out of
    /// the range of doubles.
    pub(crate) fn need_logs(&self, control: &A::Control, further: &[f64]) -> bool {
        let log = self.log_factor(control);
        let beyond = |p: &f64| {
            *p > 0.0 && !(f64::MIN_POSITIVE..=LARGEST_LINEAR_ENTRY).contains(&(p * log.exp()))
        };
        // With a factor of 1, the probabilities themselves count: `scale_belief` has checked them.
        log != 0.0 && self.jump_probabilities.iter().chain(further).any(beyond)
    }

    /// Computes `out = κ A x + r jumping`.
    pub(crate) fn apply(&self, control: &A::Control, x: &[f64], jumping: f64, out: &mut [f64]) {
        self.inner.apply(control, x, out);
        for (out, to) in out.iter_mut().zip(&self.jump_probabilities) {
            *out = product_or_zero(self.move_probability, *out) + product_or_zero(*to, jumping);
        }
    }

    /// Computes `out = κ A' x + jumped`, where `jumped` is the sum over the targets of jumps, the
    /// same for every state.
    pub(crate) fn apply_transpose(
        &self,
        control: &A::Control,
        x: &[f64],
        jumped: f64,
        out: &mut [f64],
    ) {
        self.inner.apply_transpose(control, x, out);
        out.iter_mut().for_each(|out| *out = product_or_zero(self.move_probability, *out) + jumped);
    }

    /// Computes [`apply`](Self::apply) in logarithms.
    pub(crate) fn apply_log(&self, control: &A::Control, x: &[f64], jumping: f64, out: &mut [f64]) {
        self.inner.apply_log(control, x, out);
        let keep = self.move_probability.ln();
        for (out, to) in out.iter_mut().zip(&self.jump_probabilities) {
            *out = log::add(keep + *out, to.ln() + jumping);
        }
    }

    /// Computes [`apply_transpose`](Self::apply_transpose) in logarithms.
    pub(crate) fn apply_transpose_log(
        &self,
        control: &A::Control,
        x: &[f64],
        jumped: f64,
        out: &mut [f64],
    ) {
        self.inner.apply_transpose_log(control, x, out);
        let keep = self.move_probability.ln();
        out.iter_mut().for_each(|out| *out = log::add(keep + *out, jumped));
    }

    /// Lists the states that jumps lead to, with their probabilities.
    pub(crate) fn targets(&self) -> impl Iterator<Item = (usize, f64)> + Clone {
        self.jump_probabilities.iter().copied().enumerate().filter(|entry| entry.1 > 0.0)
    }

    /// Scales entries of A by κ.
    pub(crate) fn scaled_entries(
        &self,
        entries: impl Iterator<Item = (usize, f64)>,
    ) -> impl Iterator<Item = (usize, f64)> {
        entries.map(|(state, p)| (state, self.move_probability * p)).filter(|entry| entry.1 > 0.0)
    }

    /// Scales base-2 logarithms of entries of A by κ.
    pub(crate) fn scaled_log2(
        &self,
        entries: impl Iterator<Item = (usize, f64)>,
    ) -> impl Iterator<Item = (usize, f64)> {
        let keep = log2(self.move_probability);
        let entries = entries.map(move |(state, log2)| (state, keep + log2));
        entries.filter(|entry| entry.1 > f64::NEG_INFINITY)
    }
}

/// Product that is 0 if either factor is, even if the other is infinite.
pub(crate) fn product_or_zero(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}

/// Multiplies a belief by a rate. A product that underflows is an error.
pub(crate) fn scale_belief(
    belief: Belief,
    rate: f64,
    what: &str,
) -> Result<Vec<f64>, TransitionError> {
    let mut values = belief.into_vec();
    for (state, r) in values.iter_mut().enumerate() {
        let value = *r * rate;
        // An underflow would make unreachable a state that the caller made reachable.
        if *r > 0.0 && rate > 0.0 && value < f64::MIN_POSITIVE {
            let what = format!("the probability of {what} state {state}");
            let expected = "0 or at least 2.2e-308, the smallest normal double";
            return Err(OutOfRange::new(what, value, expected).into());
        }
        *r = value;
    }
    Ok(values)
}
