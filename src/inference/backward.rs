//! One step back: from what is known of X_k given all, to X_{k-1}
//! (paper section III-B), scaled.
//!
//! The paper's recursion γ_k ∝ α_k β_k with β_{k-1} = A' B(y_k) β_k (eqs. 12
//! and 14) under- or overflows. With filtered α_k that sum to one, and
//! predictions p_k = A α_{k-1}, the same γ obeys
//!
//! γ_{k-1} = α_{k-1} ∘ A' (γ_k / p_k),
//!
//! because B(y_k) β_k is in proportion to γ_k / p_k. Every product on the right
//! is a probability, that of a pair of states, so that nothing can grow; and
//! the sum of γ_{k-1} is that of γ_k, so that a loss would be noticed.
//! Predictions are made again: to keep them would take as much memory as the
//! result.

use super::step::{Held, Step, is_one, normalise_logs};
use crate::error::InferenceError;
use crate::kernels::{self, LIFT};
use crate::likelihood::Likelihood;
use crate::transition::Transition;

/// A ratio γ / p above 2^64 is not taken in linear space if the lifted p is
/// below 2^40: it might overflow.
const LARGEST_RATIO: f64 = f64::from_bits((1023 + 64) << 52);
const LEAST_PREDICTED: f64 = f64::from_bits((1023 + 40) << 52);

/// Memory for steps back, and the result of the last one.
#[derive(Debug, Clone)]
pub(super) struct Backward {
    /// γ_{k-1}.
    pub(super) gamma: Vec<f64>,
    /// γ_k / p_k, or its logarithm.
    pub(super) ratio: Vec<f64>,
    /// Whether `ratio` is in logarithms.
    pub(super) in_logs: bool,
    predicted: Vec<f64>,
    values: Vec<f64>,
}

impl Backward {
    pub(super) fn new(states: usize) -> Self {
        let zeros = vec![0.0; states];
        Self {
            gamma: zeros.clone(),
            ratio: zeros.clone(),
            in_logs: false,
            predicted: zeros.clone(),
            values: zeros,
        }
    }

    /// From γ_k to γ_{k-1}, where a step leads from α_{k-1}. Where nothing
    /// moves they are the same, and there is no ratio.
    pub(super) fn retreat<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        alpha: Held<'_>,
        gamma: &[f64],
    ) -> Result<(), InferenceError> {
        let Some(control) = step.control else {
            self.gamma.copy_from_slice(gamma);
            return Ok(());
        };
        self.in_logs = alpha.logs.is_some() || {
            kernels::lift(alpha.linear, &mut self.values);
            step.predict(&self.values, &mut self.predicted)?;
            let held = divide(gamma, &self.predicted, &mut self.ratio);
            !(held && self.multiply(step.hmm.transition(), control, alpha.linear))
        };
        if self.in_logs { self.retreat_in_logs(step, control, alpha, gamma) } else { Ok(()) }
    }

    /// From γ_k / p_k to γ_{k-1}. Returns whether doubles held it: the sum of γ
    /// does not change from step to step but for rounding.
    fn multiply<A: Transition>(
        &mut self,
        transition: &A,
        control: &A::Control,
        alpha: &[f64],
    ) -> bool {
        transition.apply_transpose(control, &self.ratio, &mut self.values);
        kernels::lift(alpha, &mut self.gamma);
        self.gamma.iter_mut().zip(&self.values).for_each(|(gamma, back)| *gamma *= *back);
        let sum = kernels::sum(&self.gamma);
        kernels::normalise(&mut self.gamma, sum);
        is_one(sum / LIFT)
    }

    /// The same in logarithms, where linear space does not hold the ratios.
    /// What γ_k itself rounds to 0 cannot matter: it would add no more than
    /// that to γ_{k-1}.
    #[cold]
    fn retreat_in_logs<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        control: &A::Control,
        alpha: Held<'_>,
        gamma_after: &[f64],
    ) -> Result<(), InferenceError> {
        let Self { gamma, ratio, predicted, values, .. } = self;
        let transition = step.hmm.transition();
        step.check_control(control)?; // a snapshot may bring any
        alpha.logs_to(values);
        transition.apply_log(control, values, predicted);
        for ((ratio, &g), &predicted) in ratio.iter_mut().zip(gamma_after).zip(&*predicted) {
            *ratio = if g > 0.0 { g.ln() - predicted } else { f64::NEG_INFINITY };
        }
        transition.apply_transpose_log(control, ratio, predicted);
        // As in linear space, the sum of γ must have stayed one, as far as the
        // digits of the logarithms go. (−∞ stays so, also where A' has led here
        // from somewhere.)
        let mut size = 0.0_f64;
        for (out, &back) in values.iter_mut().zip(&*predicted) {
            if out.is_finite() {
                size = size.max(out.abs()).max(back.abs());
            }
            *out += back;
        }
        match normalise_logs(values, gamma) {
            Some(log) if log.abs() <= 1e-6 + 16.0 * f64::EPSILON * size => Ok(()),
            sum => {
                let sum = sum.map_or(0.0, f64::exp);
                Err(InferenceError::PredictedSum { step: step.number, sum })
            }
        }
    }
}

/// `ratio = gamma / predicted`, 0 where γ is; the prediction is lifted. Returns
/// whether doubles held it.
fn divide(gamma: &[f64], predicted: &[f64], ratio: &mut [f64]) -> bool {
    let mut held = true;
    for ((ratio, &g), &p) in ratio.iter_mut().zip(gamma).zip(predicted) {
        *ratio = if g > 0.0 { g * LIFT / p } else { 0.0 };
        held &= p >= LEAST_PREDICTED || *ratio <= LARGEST_RATIO;
    }
    held
}
