//! One backward step: from the smoothed distribution of X_k to that of X_{k-1} (paper section
//! III-B), scaled.
//!
//! The paper's recursion γ_k ∝ α_k β_k with β_{k-1} = A' B(y_k) β_k (eqs. 12
//! and 14) under- or overflows. With filtered α_k that sum to one, and
//! predictions p_k = A α_{k-1}, the same γ obeys
//!
//! γ_{k-1} = α_{k-1} ∘ A' (γ_k / p_k),
//!
//! because B(y_k) β_k is proportional to γ_k / p_k. Every product on the right is the probability
//! of a pair of states, so that nothing can grow; and γ_{k-1} has the same sum as γ_k, so that a
//! loss would be noticed. Both hold with evidence on the move too, where neither the columns of A
//! nor p_k sum to one.
//!
//! Often predictions need not be recomputed (storing them would take as much memory as the
//! result): with q_k = γ_k / α_k, the product left by the previous backward step, and
//! α_k = b_k ∘ p_k / N_k, the ratio γ_k / p_k is b_k ∘ q_k / N_k. It is computed this way where
//! the likelihoods are available at no cost. Elsewhere, and where q leaves the range of `f64`,
//! predictions are recomputed.

use super::Step;
use super::in_logs::{BeliefRef, normalize_logs};
use crate::error::InferenceError;
use crate::likelihood::{Likelihood, Scratch};
use crate::transition::Transition;
use wayfix_kernels::limits::{self, BACK_LIFT, LIFT};
use wayfix_kernels::{self as kernels, Aligned, BackwardStep, Product};

/// Memory of backward steps, and the results of the last one other than γ_{k-1}.
#[derive(Debug, Clone)]
pub(crate) struct Backward {
    /// γ_k / p_k divided by `ratio_scale`, or its logarithm.
    pub(crate) ratio: Aligned,
    pub(crate) ratio_scale: f64,
    /// True if `ratio` is in logarithms.
    pub(crate) in_logs: bool,
    carried: BackwardState,
    predicted: Aligned,
    values: Aligned,
    scratch: Scratch,
}

/// State that one backward step passes to the next.
#[derive(Debug, Clone)]
pub(crate) struct BackwardState {
    /// γ_k / α_k, lifted by [`BACK_LIFT`]; 1 at the last step.
    q: Aligned,
    /// Σ γ_k: one up to rounding, which must not accumulate over steps.
    sum: f64,
    /// True if `q` is within the range of `f64`.
    held: bool,
}

/// Observation of step k with its normaliser N_k, which is 0 unless the filter took the step with
/// unscaled likelihoods.
pub(crate) struct Observed<'a, Y: ?Sized> {
    pub(crate) observation: &'a Y,
    pub(crate) normalizer: f64,
}

impl Backward {
    /// Creates the state at the last step of a sequence.
    pub(crate) fn new(states: usize) -> Self {
        let zeros = Aligned::new(states, 0.0);
        Self {
            ratio: zeros.clone(),
            ratio_scale: 1.0,
            in_logs: false,
            carried: BackwardState { q: Aligned::new(states, BACK_LIFT), sum: 1.0, held: true },
            predicted: zeros.clone(),
            values: zeros,
            scratch: Scratch::default(),
        }
    }

    /// Returns the state left by the last backward step.
    pub(crate) fn carried(&self) -> BackwardState {
        self.carried.clone()
    }

    /// Continues from the state that [`carried`](Self::carried) returned.
    pub(crate) fn carry_on(&mut self, carried: &BackwardState) {
        self.carried.clone_from(carried);
    }

    /// Goes back as [`step_back`](Self::step_back) does, but computes the ratio from the
    /// observation if possible.
    pub(crate) fn step_back_from<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        seen: &Observed<'_, B::Observation>,
        alpha: BeliefRef<'_>,
        gamma: &[f64],
        out: &mut [f64],
    ) -> Result<(), InferenceError> {
        let Some(control) = step.control else { return self.step_back(step, alpha, gamma, out) };
        // The ratio comes from α_k = b ∘ p / N, which holds up to the rounding of the forward step.
        // Excluded are steps in logarithms, which leave no N, and a q that an earlier backward step
        // could not hold: it does not belong to γ_k.
        if alpha.logs.is_some() || !self.carried.held || !self.weigh(step.hmm.likelihood(), seen) {
            return self.step_back(step, alpha, gamma, out);
        }
        let Self { ratio, carried: BackwardState { q, .. }, values, .. } = self;
        let product = if let Some(matrix) = step.stored(control) {
            Product::Sparse { matrix: &matrix.sliced_columns, x: ratio }
        } else {
            step.hmm.transition().apply_transpose(control, ratio, values);
            Product::Computed(values)
        };
        let back = BackwardStep { product, alpha: alpha.linear, gamma: &mut *out, q };
        let sum = kernels::backward_step(back);
        // Anything that left the range of doubles, in q, in the ratio or in their products, is
        // missing from the sum or makes it infinite ("The way back" in `limits`). Then q is wrong
        // too; the step with predictions computes a new one if it can.
        if !limits::is_one(sum) {
            return self.step_back(step, alpha, gamma, out);
        }
        (self.carried.sum, self.in_logs, self.ratio_scale) = (sum, false, 1.0 / BACK_LIFT);
        Ok(())
    }

    /// Computes the ratio γ_k / p_k from the observation of step k. Returns false if that is not
    /// possible.
    fn weigh<B: Likelihood>(
        &mut self,
        likelihood: &B,
        seen: &Observed<'_, B::Observation>,
    ) -> bool {
        let Self { ratio, carried, scratch, .. } = self;
        if seen.normalizer == 0.0 || !likelihood.is_precomputed() {
            return false;
        }
        // The forward pass validated this observation, but a sensor may answer differently the
        // second time. Then the step with predictions, which needs no sensor, is still right.
        let found = likelihood.diagonal(seen.observation, scratch);
        let Ok(ref diagonal) = found else { return false };
        let Some(likelihoods) = diagonal.linear_values() else { return false };
        if likelihoods.len() != ratio.len() {
            return false;
        }
        // Divided by Σ γ too, whose rounding error would otherwise accumulate over a long sequence.
        let factor = 1.0 / (seen.normalizer * carried.sum);
        kernels::divide_by_prediction(&carried.q, likelihoods, factor, ratio);
        true
    }

    /// Goes back from γ_k over the step that led from α_{k-1}, and writes γ_{k-1} to `out`.
    /// Without a transition the two are equal, and there is no ratio.
    pub(crate) fn step_back<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        alpha: BeliefRef<'_>,
        gamma: &[f64],
        out: &mut [f64],
    ) -> Result<(), InferenceError> {
        let Some(control) = step.control else {
            out.copy_from_slice(gamma);
            self.in_logs = false;
            return Ok(());
        };
        step.check_control(control)?;
        (self.carried.held, self.ratio_scale) = (false, 1.0);
        let evidence = step.hmm.transition().evidence(control).is_some();
        // Predictions are lifted, so that doubles hold every ratio except that of a state which was
        // predicted below 2^-960 and now has a γ more than 2^64 times as large.
        self.in_logs = alpha.logs.is_some() || (evidence && step.needs_logs()) || {
            kernels::lift(alpha.linear, &mut self.values);
            step.predict(&self.values, &mut self.predicted);
            let held = divide(gamma, &self.predicted, &mut self.ratio);
            !(held && self.multiply(step.hmm.transition(), control, alpha.linear, out))
        };
        if self.in_logs { self.step_back_in_logs(step, control, alpha, gamma, out) } else { Ok(()) }
    }

    /// Computes γ_{k-1} from γ_k / p_k. Returns false if the result left the range of `f64`, as
    /// shown by the sum of γ, which a correct step changes by rounding only.
    fn multiply<A: Transition>(
        &mut self,
        transition: &A,
        control: &A::Control,
        alpha: &[f64],
        out: &mut [f64],
    ) -> bool {
        transition.apply_transpose(control, &self.ratio, &mut self.values);
        kernels::lift(alpha, out);
        out.iter_mut().zip(&*self.values).for_each(|(gamma, back)| *gamma *= *back);
        let sum = kernels::sum(out);
        kernels::normalize(out, sum);
        // This makes a new q, so that the next ratio can come from its observation again. If q
        // overflows here, the next sum will not be one.
        let carried = &mut self.carried;
        carried.q.iter_mut().zip(&*self.values).for_each(|(q, back)| *q = back * BACK_LIFT);
        (carried.sum, carried.held) = (sum / LIFT, limits::is_one(sum / LIFT));
        carried.held
    }

    /// Goes back in logarithms, where linear space cannot hold the ratios. Values of γ_k that round
    /// to 0, below 2.2e-308 each, do not matter: they would add no more than that to γ_{k-1}.
    #[cold]
    fn step_back_in_logs<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        control: &A::Control,
        alpha: BeliefRef<'_>,
        gamma: &[f64],
        out: &mut [f64],
    ) -> Result<(), InferenceError> {
        let Self { ratio, predicted, values, .. } = self;
        let (predicted, values) = (&mut **predicted, &mut **values);
        let transition = step.hmm.transition();
        // r(i) = ln γ_k(i) − ln p_k(i), then ln γ_{k-1} = ln α_{k-1} + ln A' exp r (formulas,
        // section 3, "In logarithms"). `values` stays ln α; `predicted` is reused for the product.
        alpha.logs_to(values);
        transition.apply_log(control, values, predicted);
        for ((ratio, &g), &predicted) in ratio.iter_mut().zip(gamma).zip(&*predicted) {
            *ratio = if g > 0.0 { g.ln() - predicted } else { f64::NEG_INFINITY };
        }
        transition.apply_transpose_log(control, ratio, predicted);
        // As in linear space, the sum of γ must have stayed one, here up to the rounding of
        // logarithms of this size. (An α of −∞ stays −∞ and is not counted in the size.)
        let mut size = 0.0_f64;
        for (log, &back) in values.iter_mut().zip(&*predicted) {
            if log.is_finite() {
                size = size.max(log.abs()).max(back.abs());
            }
            *log += back;
        }
        match normalize_logs(values, out) {
            Some(log) if log.abs() <= limits::log_rounding(size) => Ok(()),
            sum => {
                let sum = sum.map_or(0.0, f64::exp);
                Err(InferenceError::PredictedSum { step: step.number, sum })
            }
        }
    }
}

/// Computes `ratio = gamma / predicted` from a lifted prediction; the ratio is 0 where γ is.
/// Returns false if some ratio is not trusted.
fn divide(gamma: &[f64], predicted: &[f64], ratio: &mut [f64]) -> bool {
    let mut held = true;
    for ((ratio, &g), &p) in ratio.iter_mut().zip(gamma).zip(predicted) {
        *ratio = if g > 0.0 { g * LIFT / p } else { 0.0 };
        held &= limits::is_trusted(*ratio, p);
    }
    held
}
