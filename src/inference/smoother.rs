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

use super::posteriors::Posteriors;
use super::step::{LN_LIFT, Step, Workspace, exponentiate};
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
        for (number, observation) in (1..).zip(observations) {
            let (before, after) = filtered.rows_mut(number);
            let predicted = smoothed.row_mut(number);
            let log =
                step(number).advance(observation.borrow(), before, predicted, after, &mut work)?;
            log_likelihood.add(log);
        }

        // Backward.
        let mut gamma = filtered.row(steps).to_vec();
        let mut ratio = vec![0.0; n];
        let mut back = vec![0.0; n];
        for number in (1..=steps).rev() {
            let row = smoothed.row_mut(number);
            let held = divide(&gamma, row, &mut ratio);
            row.copy_from_slice(&gamma);
            if let Some(control) = step(number).control {
                let alpha = filtered.row(number - 1);
                let held = held
                    && retreat(self.transition(), control, alpha, &ratio, &mut back, &mut gamma);
                if !held {
                    let row = smoothed.row(number);
                    step(number).retreat_in_logs(alpha, row, &mut ratio, &mut back, &mut gamma)?;
                }
            }
        }
        smoothed.row_mut(0).copy_from_slice(&gamma);
        Ok(Smoothing { filtered, smoothed, log_likelihood: log_likelihood.value() })
    }
}

/// A ratio γ / p above 2^64 is not trusted if p is below 2^-960: too few
/// digits of it may be left.
const LARGEST_RATIO: f64 = f64::from_bits((1023 + 64) << 52);
const LEAST_PREDICTED: f64 = f64::from_bits((1023 - 960) << 52);

/// `ratio = gamma / predicted`, 0 where γ is. Returns whether doubles held it.
fn divide(gamma: &[f64], predicted: &[f64], ratio: &mut [f64]) -> bool {
    let mut held = true;
    for ((ratio, &g), &p) in ratio.iter_mut().zip(gamma).zip(predicted) {
        *ratio = if g > 0.0 { g / p } else { 0.0 };
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
    let lifted = kernels::multiply(alpha, back, gamma);
    kernels::normalise(gamma, lifted);
    (lifted / LIFT - 1.0).abs() < 1e-6
}

/// How far below the largest a ratio may lie to share a product with it, as a
/// logarithm: then its product with the smallest entry is still a normal double.
const BAND: f64 = 600.0;

impl<A: Transition, B: Likelihood> Step<'_, A, B> {
    /// From γ_k to γ_{k-1} where linear space does not hold the ratios: they
    /// are taken as logarithms, and applied band by band.
    #[cold]
    fn retreat_in_logs(
        &self,
        alpha: &[f64],
        gamma_after: &[f64],
        log_ratio: &mut [f64],
        lifted: &mut [f64],
        gamma: &mut [f64],
    ) -> Result<(), InferenceError> {
        let Some(control) = self.control else { return Ok(()) };
        let largest = |x: &[f64]| x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        lifted.iter_mut().zip(alpha).for_each(|(out, p)| *out = p * LIFT);
        self.predict(lifted, gamma)?;
        for ((out, &g), &p) in log_ratio.iter_mut().zip(gamma_after).zip(&*gamma) {
            *out = if g > 0.0 { g.ln() - (p.ln() - LN_LIFT) } else { f64::NEG_INFINITY };
        }
        gamma.fill(f64::NEG_INFINITY);
        let mut back = vec![0.0; lifted.len()];
        let mut top = largest(log_ratio);
        while top.is_finite() {
            let mut next = f64::NEG_INFINITY;
            for (out, &log) in lifted.iter_mut().zip(&*log_ratio) {
                let in_band = log <= top && log > top - BAND;
                *out = if in_band { (log - top + LN_LIFT).exp() } else { 0.0 };
                if log <= top - BAND {
                    next = next.max(log);
                }
            }
            self.hmm.transition().apply_transpose(control, lifted, &mut back);
            for ((out, &alpha), &back) in gamma.iter_mut().zip(alpha).zip(&back) {
                *out = log_add(*out, alpha.ln() + back.ln() - LN_LIFT + top);
            }
            top = next;
        }
        let largest = largest(gamma);
        if top == f64::INFINITY || !largest.is_finite() {
            // A' leads from where A says that nothing comes to.
            let state = gamma_after.iter().position(|&g| g > 0.0).unwrap_or(0);
            return Err(InferenceError::Predicted { step: self.number, state, value: 0.0 });
        }
        exponentiate(gamma, largest);
        Ok(())
    }
}

/// ln(e^a + e^b).
fn log_add(a: f64, b: f64) -> f64 {
    let (high, low) = if a > b { (a, b) } else { (b, a) };
    if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}
