//! The two passes of every routine that smooths (sections 2 and 3 of the
//! [formulas](crate::guide::formulas)): filtered distributions α_k of consecutive steps, and single
//! steps back from γ_k to γ_{k-1} (paper section III-B), scaled.
//!
//! The forward steps are those of a filter, so that rows equal those of a stream to the bit.
//!
//! Backward, the paper's recursion γ_k ∝ α_k β_k with β_{k-1} = A' B(y_k) β_k (eqs. 12 and 14)
//! under- or overflows. With filtered α_k that sum to one, and predictions p_k = A α_{k-1}, the
//! same γ obeys
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

use std::collections::HashMap;

use super::Step;
use super::state::{BeliefForm, BeliefRef, FilterSnapshot, StepScratch, normalize_logs};
use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::likelihood::{Likelihood, Scratch};
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels as kernels;
use wayfix_kernels::limits::{BACK_LIFT, LIFT};
use wayfix_kernels::{Aligned, BackwardStep, Product, in_large_pages, limits};

/// Distributions over n states, stored one after the other.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    states: usize,
    values: Vec<f64>,
}

impl Rows {
    /// Creates an empty block with capacity for `rows` rows.
    pub(crate) fn with_capacity(states: usize, rows: usize) -> Self {
        Self { states, values: in_large_pages(Vec::with_capacity(states * rows)) }
    }

    /// Creates rows of zeros.
    pub(crate) fn zeros(states: usize, rows: usize) -> Self {
        Self { states, values: in_large_pages(vec![0.0; states * rows]) }
    }

    pub(crate) fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.states..(row + 1) * self.states]
    }

    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.values[row * self.states..(row + 1) * self.states]
    }

    /// Returns a row and the next one.
    pub(crate) fn row_and_next(&mut self, row: usize) -> (&mut [f64], &[f64]) {
        let pair = &mut self.values[row * self.states..(row + 2) * self.states];
        let (row, next) = pair.split_at_mut(self.states);
        (row, next)
    }

    pub(crate) fn into_values(self) -> Vec<f64> {
        self.values
    }
}

/// Filtered distributions of consecutive steps; row r is the belief r steps after the first one.
#[derive(Debug, Clone)]
pub(crate) struct ForwardPass {
    pub(crate) rows: Rows,
    /// Logarithms of those rows with values outside the range of `f64`; usually few.
    logs: HashMap<usize, Vec<f64>>,
    /// Normaliser of the step to each row, as in
    /// [`StepOutcome`](super::state::StepOutcome).
    normalizers: Vec<f64>,
    /// Rows whose step was taken in logarithms, in ascending order.
    taken_in_logs: Vec<usize>,
}

impl ForwardPass {
    /// Creates an empty pass over `steps` steps, with capacity for `more` extra rows.
    pub(crate) fn new(states: usize, steps: usize, more: usize) -> Self {
        // Rows are appended into capacity, not written over zeros: zeroing would be one more pass
        // over all of the memory.
        let rows = Rows::with_capacity(states, steps + 1 + more);
        let normalizers = vec![0.0; steps + 1];
        Self { rows, logs: HashMap::new(), normalizers, taken_in_logs: Vec::new() }
    }

    /// Filters a whole sequence from the prior, with capacity for `more` extra rows. Returns the
    /// pass and the last state. Passes ln p(y_k | y_1 … y_{k-1}) of each step to `each`.
    pub(crate) fn over<A, B, S>(
        hmm: &Hmm<A, B>,
        sequence: &S,
        more: usize,
        each: impl FnMut(f64),
    ) -> Result<(Self, FilterSnapshot), HmmError>
    where
        A: Transition,
        B: Likelihood,
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (prior, steps) = (hmm.prior().belief().as_slice(), sequence.steps());
        let (mut state, mut scratch) = (FilterSnapshot::start(prior), StepScratch::new(prior));
        let mut pass = Self::new(prior.len(), steps, more);
        pass.fill(hmm, (&mut state, &mut scratch), sequence, steps, each)?;
        Ok((pass, state))
    }

    /// Takes `steps` more steps from a state and keeps all beliefs, the present one first.
    /// Passes ln p(y_k | y_1 … y_{k-1}) of each step to `each`.
    pub(crate) fn fill<A, B, S>(
        &mut self,
        hmm: &Hmm<A, B>,
        (state, scratch): (&mut FilterSnapshot, &mut StepScratch),
        sequence: &S,
        steps: usize,
        mut each: impl FnMut(f64),
    ) -> Result<(), HmmError>
    where
        A: Transition,
        B: Likelihood,
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        self.rows.values.clear();
        self.logs.clear();
        self.taken_in_logs.clear();
        self.rows.values.extend_from_slice(&state.belief);
        self.keep_logs(0, state);
        for row in 1..=steps {
            // Numbered by the state, so that a pass from a checkpoint numbers steps as one from the
            // prior does.
            let number = state.steps + 1;
            let step = Step::of(hmm, sequence, number);
            let (rows, observation) = (&mut self.rows.values, sequence.observation(number));
            let advanced = step.advance(observation, state.belief_ref(), scratch, Some(rows))?;
            state.commit(number, &advanced, scratch);
            // A plain step has appended its row while normalising it.
            if !matches!(advanced.form, BeliefForm::Plain { .. }) {
                self.rows.values.extend_from_slice(&state.belief);
            }
            each(advanced.log);
            // The normaliser is 0 where the likelihoods were scaled: the backward pass then
            // recomputes predictions.
            self.normalizers[row] = advanced.normalizer;
            if advanced.taken_in_logs {
                self.taken_in_logs.push(row);
            }
            self.keep_logs(row, state);
        }
        Ok(())
    }

    fn keep_logs(&mut self, row: usize, state: &FilterSnapshot) {
        if let Some(logs) = state.belief_ref().logs {
            self.logs.insert(row, logs.to_vec());
        }
    }

    /// Returns true if the step to this row was taken in logarithms.
    pub(crate) fn taken_in_logs(&self, row: usize) -> bool {
        self.taken_in_logs.binary_search(&row).is_ok()
    }

    /// Pairs the observation of the step to a row with its normaliser.
    pub(crate) fn seen<'a, Y: ?Sized>(&self, row: usize, observation: &'a Y) -> Observed<'a, Y> {
        Observed { observation, normalizer: self.normalizers[row] }
    }

    /// Begins the backward pass: duplicates the last row, which is both α_T and γ_T. Afterwards γ
    /// of row r is stored at row r + 1.
    pub(crate) fn begin_backward(&mut self) {
        let last = self.rows.values.len() - self.rows.states;
        self.rows.values.extend_from_within(last..);
    }

    /// Returns, for the backward step from this row: α of the previous row, the place for γ of the
    /// previous row, and γ of this row.
    pub(crate) fn backward_rows(&mut self, row: usize) -> (BeliefRef<'_>, &mut [f64], &[f64]) {
        // γ of row r − 1 replaces α of row r, which no further backward step reads; γ of row r is
        // one row later (see `turn`).
        let states = self.rows.states;
        let (before, after) = self.rows.values.split_at_mut(row * states);
        let (out, gamma) = after[..2 * states].split_at_mut(states);
        let logs = self.logs.get(&(row - 1)).map(Vec::as_slice);
        (BeliefRef { linear: &before[(row - 1) * states..], logs }, out, gamma)
    }

    pub(crate) fn belief(&self, row: usize) -> BeliefRef<'_> {
        BeliefRef { linear: self.rows.row(row), logs: self.logs.get(&row).map(Vec::as_slice) }
    }
}

/// Memory of backward steps, and the results of the last one other than γ_{k-1}.
#[derive(Debug, Clone)]
pub(crate) struct Backward {
    /// γ_k / p_k divided by `ratio_scale`, or its logarithm.
    pub(crate) ratio: Aligned,
    pub(crate) ratio_scale: f64,
    /// True if `ratio` is in logarithms.
    pub(crate) ratio_in_logs: bool,
    state: BackwardState,
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
    q_is_valid: bool,
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
            ratio_in_logs: false,
            state: BackwardState { q: Aligned::new(states, BACK_LIFT), sum: 1.0, q_is_valid: true },
            predicted: zeros.clone(),
            values: zeros,
            scratch: Scratch::default(),
        }
    }

    /// Returns the state left by the last backward step.
    pub(crate) fn state(&self) -> BackwardState {
        self.state.clone()
    }

    /// Continues from the state that [`state`](Self::state) returned.
    pub(crate) fn restore_state(&mut self, state: &BackwardState) {
        self.state.clone_from(state);
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
    ) -> Result<(), HmmError> {
        let Some(control) = step.control else { return self.step_back(step, alpha, gamma, out) };
        // The ratio comes from α_k = b ∘ p / N, which holds up to the rounding of the forward step.
        // Excluded are steps in logarithms, which leave no N, and a q that an earlier backward step
        // could not represent, which does not belong to γ_k.
        if alpha.logs.is_some()
            || !self.state.q_is_valid
            || !self.weigh(step.hmm.likelihood(), seen)
        {
            return self.step_back(step, alpha, gamma, out);
        }
        let Self { ratio, state: BackwardState { q, .. }, values, .. } = self;
        let product = if let Some(matrix) = step.stored(control) {
            Product::Sparse { matrix: &matrix.sliced_columns, x: ratio }
        } else {
            step.hmm.transition().apply_transpose(control, ratio, values);
            Product::Computed(values)
        };
        let back = BackwardStep { product, alpha: alpha.linear, gamma: &mut *out, q };
        let sum = kernels::backward_step(back);
        // Anything that left the range of doubles, in q, in the ratio or in their products, is
        // missing from the sum or makes it infinite ("The way back" in `limits`). Then q is also
        // wrong. The step with predictions computes a new q if it can.
        if !limits::is_one(sum) {
            return self.step_back(step, alpha, gamma, out);
        }
        (self.state.sum, self.ratio_in_logs, self.ratio_scale) = (sum, false, 1.0 / BACK_LIFT);
        Ok(())
    }

    /// Computes the ratio γ_k / p_k from the observation of step k. Returns false if that is not
    /// possible.
    fn weigh<B: Likelihood>(
        &mut self,
        likelihood: &B,
        seen: &Observed<'_, B::Observation>,
    ) -> bool {
        let Self { ratio, state, scratch, .. } = self;
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
        // Also divided by Σ γ, whose rounding error would otherwise accumulate over a long
        // sequence.
        let factor = 1.0 / (seen.normalizer * state.sum);
        kernels::divide_by_prediction(&state.q, likelihoods, factor, ratio);
        true
    }

    /// Goes back from γ_k over the step that led from α_{k-1}, and writes γ_{k-1} to `out`.
    /// Without a transition the two are equal, and no ratio is taken.
    pub(crate) fn step_back<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        alpha: BeliefRef<'_>,
        gamma: &[f64],
        out: &mut [f64],
    ) -> Result<(), HmmError> {
        let Some(control) = step.control else {
            out.copy_from_slice(gamma);
            self.ratio_in_logs = false;
            return Ok(());
        };
        step.check_control(control)?;
        (self.state.q_is_valid, self.ratio_scale) = (false, 1.0);
        let evidence = step.hmm.transition().evidence(control).is_some();
        // Predictions are lifted, so that doubles hold every ratio except that of a state which was
        // predicted below 2^-960 and now has a γ more than 2^64 times as large.
        self.ratio_in_logs = alpha.logs.is_some() || (evidence && step.needs_logs()) || {
            kernels::lift(alpha.linear, &mut self.values);
            step.predict(&self.values, &mut self.predicted);
            let held = divide(gamma, &self.predicted, &mut self.ratio);
            !(held && self.multiply(step.hmm.transition(), control, alpha.linear, out))
        };
        if self.ratio_in_logs {
            self.step_back_in_logs(step, control, alpha, gamma, out)
        } else {
            Ok(())
        }
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
        let state = &mut self.state;
        state.q.iter_mut().zip(&*self.values).for_each(|(q, back)| *q = back * BACK_LIFT);
        (state.sum, state.q_is_valid) = (sum / LIFT, limits::is_one(sum / LIFT));
        state.q_is_valid
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
    ) -> Result<(), HmmError> {
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
                Err(HmmError::PredictedSum { step: step.number, sum })
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
