//! Filtered distributions of consecutive steps, kept for the backward pass: the α_k of sections 2
//! and 3 of the [formulas](crate::guide::formulas), as every routine with a backward pass stores
//! them.
//!
//! The steps are those of a filter, so that rows equal those of a stream to the bit; the result of
//! each step is appended as the next row.

use std::collections::HashMap;

use super::Step;
use super::backward::Observed;
use super::in_logs::BeliefRef;
use super::state::{BeliefForm, FilterSnapshot, StepScratch};
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::in_large_pages;

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
    by_logs: Vec<usize>,
}

impl ForwardPass {
    /// Creates an empty pass over `steps` steps, with capacity for `more` extra rows.
    pub(crate) fn new(states: usize, steps: usize, more: usize) -> Self {
        // Rows are appended into capacity, not written over zeros: zeroing would be one more pass
        // over all of the memory.
        let rows = Rows::with_capacity(states, steps + 1 + more);
        let normalizers = vec![0.0; steps + 1];
        Self { rows, logs: HashMap::new(), normalizers, by_logs: Vec::new() }
    }

    /// Filters a whole sequence from the prior, with capacity for `more` extra rows. Returns the
    /// pass and the last state. Passes ln p(y_k | y_1 … y_{k-1}) of each step to `each`.
    pub(crate) fn over<A, B, S>(
        hmm: &Hmm<A, B>,
        sequence: &S,
        more: usize,
        each: impl FnMut(f64),
    ) -> Result<(Self, FilterSnapshot), InferenceError>
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
    ) -> Result<(), InferenceError>
    where
        A: Transition,
        B: Likelihood,
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        self.rows.values.clear();
        self.logs.clear();
        self.by_logs.clear();
        self.rows.values.extend_from_slice(&state.belief);
        self.keep_logs(0, state);
        for row in 1..=steps {
            // Numbered by the state, so that a pass from a checkpoint numbers steps as one from the
            // prior does.
            let number = state.steps + 1;
            let step = Step::of(hmm, sequence, number);
            let (rows, observation) = (&mut self.rows.values, sequence.observation(number));
            let advanced = step.advance(observation, state.held(), scratch, Some(rows))?;
            state.commit(number, &advanced, scratch);
            // A plain step has appended its row while normalising it.
            if !matches!(advanced.form, BeliefForm::Plain { .. }) {
                self.rows.values.extend_from_slice(&state.belief);
            }
            each(advanced.log);
            // 0 where the likelihoods were scaled: the backward pass then recomputes predictions.
            self.normalizers[row] = advanced.normalizer;
            if advanced.by_logs {
                self.by_logs.push(row);
            }
            self.keep_logs(row, state);
        }
        Ok(())
    }

    fn keep_logs(&mut self, row: usize, state: &FilterSnapshot) {
        if let Some(logs) = state.held().logs {
            self.logs.insert(row, logs.to_vec());
        }
    }

    /// Returns true if the step to this row was taken in logarithms.
    pub(crate) fn by_logs(&self, row: usize) -> bool {
        self.by_logs.binary_search(&row).is_ok()
    }

    /// Pairs the observation of the step to a row with its normaliser.
    pub(crate) fn seen<'a, Y: ?Sized>(&self, row: usize, observation: &'a Y) -> Observed<'a, Y> {
        Observed { observation, normalizer: self.normalizers[row] }
    }

    /// Begins the backward pass: duplicates the last row, which is both α_T and γ_T. Afterwards γ
    /// of row r is stored at row r + 1.
    pub(crate) fn turn(&mut self) {
        let last = self.rows.values.len() - self.rows.states;
        self.rows.values.extend_from_within(last..);
    }

    /// Returns, for the backward step from this row: α of the row before, the place for γ of the
    /// row before, and γ of this row.
    pub(crate) fn way_back(&mut self, row: usize) -> (BeliefRef<'_>, &mut [f64], &[f64]) {
        // γ of row r − 1 replaces α of row r, which no further backward step reads; γ of row r is
        // one row later (see `turn`).
        let states = self.rows.states;
        let (before, after) = self.rows.values.split_at_mut(row * states);
        let (out, gamma) = after[..2 * states].split_at_mut(states);
        let logs = self.logs.get(&(row - 1)).map(Vec::as_slice);
        (BeliefRef { linear: &before[(row - 1) * states..], logs }, out, gamma)
    }

    pub(crate) fn held(&self, row: usize) -> BeliefRef<'_> {
        BeliefRef { linear: self.rows.row(row), logs: self.logs.get(&row).map(Vec::as_slice) }
    }
}
