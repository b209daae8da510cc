//! The batch smoother (paper section III-B), scaled.
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

use std::borrow::Borrow;
use std::collections::HashMap;

use super::posteriors::Posteriors;
use super::step::{Held, Results, Step, Workspace, is_one, normalise_logs};
use super::{LogSum, check_controls};
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::kernels::{self, LIFT};
use crate::likelihood::Likelihood;
use crate::transition::Transition;

/// Filtered and smoothed distributions of a whole sequence.
///
/// Made by [`Hmm::smooth`].
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothing {
    filtered: Posteriors,
    smoothed: Posteriors,
    log_likelihood: f64,
}

impl Smoothing {
    /// p(X_k | y_1 … y_k) for k = 0 … T; the prior at 0.
    #[must_use]
    pub fn filtered(&self) -> &Posteriors {
        &self.filtered
    }

    /// p(X_k | y_1 … y_T) for k = 0 … T. At T it equals the filtered one.
    #[must_use]
    pub fn smoothed(&self) -> &Posteriors {
        &self.smoothed
    }

    /// ln p(y_1 … y_T).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }
}

impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Filters and smooths a sequence of observations (paper eqs. 10 to 14).
    ///
    /// The sequence is a slice of observations, or of what can be borrowed as
    /// one: `&[Vec<f64>]` for observations of type `[f64]`. An empty one is
    /// allowed: the posterior of X_0 then is the prior.
    ///
    /// Takes two products with A or A' and O(n) a step; the result holds
    /// 2 n (T + 1) numbers.
    ///
    /// # Errors
    ///
    /// [`InferenceError`] with the step at which an observation is impossible
    /// or has no valid likelihood.
    pub fn smooth<Y>(&self, observations: &[Y]) -> Result<Smoothing, InferenceError>
    where
        A: Transition<Control = ()>,
        Y: Borrow<B::Observation>,
    {
        self.smooth_with(&vec![(); observations.len()], observations)
    }

    /// The same under controls: `controls[k - 1]` drives the transition from
    /// k − 1 to k, the one before `observations[k - 1]`.
    ///
    /// Under [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation)
    /// the first control is not looked at.
    ///
    /// # Errors
    ///
    /// As [`smooth`](Self::smooth), and if a control is not valid or there is
    /// not one for each observation.
    pub fn smooth_with<Y>(
        &self,
        controls: &[A::Control],
        observations: &[Y],
    ) -> Result<Smoothing, InferenceError>
    where
        Y: Borrow<B::Observation>,
    {
        check_controls(controls, observations)?;
        let (n, steps) = (self.states(), observations.len());
        let mut filtered = Posteriors::new(n, steps);
        let mut smoothed = Posteriors::new(n, steps);
        let mut log_likelihood = LogSum::default();
        let mut work = Workspace::new(n);
        let step = |number: usize| {
            let control = self.prior().moves_at(number).then(|| &controls[number - 1]);
            Step { hmm: self, number, control }
        };

        // Forward. The block for γ holds the predictions until they are used.
        filtered.row_mut(0).copy_from_slice(self.prior().belief().as_slice());
        let mut logs = vec![0.0; n];
        let mut kept: HashMap<usize, Vec<f64>> = HashMap::new();
        for (number, observation) in (1..).zip(observations) {
            let (before, after) = filtered.rows_mut(number);
            let before = Held { linear: before, logs: kept.get(&(number - 1)).map(Vec::as_slice) };
            let predicted = smoothed.row_mut(number);
            let mut results = Results { predicted, after, logs: &mut logs };
            let advanced =
                step(number).advance(observation.borrow(), before, &mut results, &mut work)?;
            log_likelihood.add(advanced.log);
            if advanced.in_logs {
                kept.insert(number, logs.clone());
            }
        }

        // Backward.
        let mut gamma = filtered.row(steps).to_vec();
        let mut ratio = vec![0.0; n];
        let mut back = vec![0.0; n];
        for number in (1..=steps).rev() {
            let row = smoothed.row_mut(number);
            let held = divide(&gamma, row, &mut ratio);
            row.copy_from_slice(&gamma);
            let step = step(number);
            let Some(control) = step.control else { continue };
            let (linear, logs) = (filtered.row(number - 1), kept.get(&(number - 1)));
            let alpha = Held { linear, logs: logs.map(Vec::as_slice) };
            if held && alpha.logs.is_none() {
                let transition = self.transition();
                if retreat(transition, control, linear, &ratio, &mut back, &mut gamma) {
                    continue;
                }
            }
            let row = smoothed.row(number);
            step.retreat_in_logs(control, alpha, row, [&mut ratio, &mut back, &mut gamma])?;
        }
        smoothed.row_mut(0).copy_from_slice(&gamma);
        Ok(Smoothing { filtered, smoothed, log_likelihood: log_likelihood.value() })
    }
}

/// A ratio γ / p above 2^64 is not taken in linear space if the lifted p is
/// below 2^40: it might overflow.
const LARGEST_RATIO: f64 = f64::from_bits((1023 + 64) << 52);
const LEAST_PREDICTED: f64 = f64::from_bits((1023 + 40) << 52);

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

/// From γ_k / p_k to γ_{k-1}. Returns whether doubles held it: the sum of γ
/// does not change from step to step but for rounding.
fn retreat<A: Transition>(
    transition: &A,
    control: &A::Control,
    alpha: &[f64],
    ratio: &[f64],
    back: &mut [f64],
    gamma: &mut [f64],
) -> bool {
    transition.apply_transpose(control, ratio, back);
    kernels::lift(alpha, gamma);
    gamma.iter_mut().zip(back).for_each(|(gamma, back)| *gamma *= *back);
    let sum = kernels::sum(gamma);
    kernels::normalise(gamma, sum);
    is_one(sum / LIFT)
}

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// From γ_k to γ_{k-1} in logarithms, where linear space does not hold the
    /// ratios. What γ_k itself rounds to 0 cannot matter: it would add no more
    /// than that to γ_{k-1}.
    #[cold]
    fn retreat_in_logs(
        &self,
        control: &A::Control,
        alpha: Held<'_>,
        gamma_after: &[f64],
        [ratio, back, gamma]: [&mut [f64]; 3],
    ) -> Result<(), InferenceError> {
        let transition = self.hmm.transition();
        alpha.logs_to(back);
        transition.apply_log(control, back, gamma);
        for ((ratio, &g), &predicted) in ratio.iter_mut().zip(gamma_after).zip(&*gamma) {
            *ratio = if g > 0.0 { g.ln() - predicted } else { f64::NEG_INFINITY };
        }
        transition.apply_transpose_log(control, ratio, back);
        alpha.logs_to(ratio);
        // As in linear space, the sum of γ must have stayed one, as far as the
        // digits of the logarithms go. (−∞ stays so, also where A' has led here
        // from somewhere.)
        let mut size = 0.0_f64;
        for (out, &back) in ratio.iter_mut().zip(&*back) {
            if out.is_finite() {
                size = size.max(out.abs()).max(back.abs());
            }
            *out += back;
        }
        match normalise_logs(ratio, gamma) {
            Some(log) if log.abs() <= 1e-6 + 16.0 * f64::EPSILON * size => Ok(()),
            sum => {
                let sum = sum.map_or(0.0, f64::exp);
                Err(InferenceError::PredictedSum { step: self.number, sum })
            }
        }
    }
}
