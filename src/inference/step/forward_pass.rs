//! Filtered distributions of consecutive steps, kept for the backward pass.

use std::collections::HashMap;

use super::backward::Observed;
use super::belief_form::BeliefRef;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::sequences::posteriors::Rows;
use crate::inference::streams::filter::Filter;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Filtered distributions of consecutive steps; row r is the belief r steps after the first one.
#[derive(Debug, Clone)]
pub(crate) struct ForwardPass {
    pub(crate) rows: Rows,
    /// Logarithms of the rows with values outside the range of `f64`.
    pub(crate) logs: HashMap<usize, Vec<f64>>,
    /// Normaliser of the step to each row, as
    /// [`StepOutcome`](super::belief_form::StepOutcome) has it.
    normalizers: Vec<f64>,
    /// Rows to which a step was taken in logarithms, ascending.
    by_logs: Vec<usize>,
}

impl ForwardPass {
    pub(crate) fn new(states: usize, steps: usize) -> Self {
        let rows = Rows::with_capacity(states, steps + 1);
        let normalizers = vec![0.0; steps + 1];
        Self { rows, logs: HashMap::new(), normalizers, by_logs: Vec::new() }
    }

    /// Runs a filter `steps` further and keeps all beliefs, beginning with the present one.
    /// Passes ln p(y_k | y_1 … y_{k-1}) of each step to `each`.
    pub(crate) fn fill<A, B, S>(
        &mut self,
        filter: &mut Filter<&Hmm<A, B>>,
        sequence: &S,
        steps: usize,
        mut each: impl FnMut(f64),
    ) -> Result<(), InferenceError>
    where
        A: Transition,
        B: Likelihood,
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        self.rows.clear();
        self.logs.clear();
        self.by_logs.clear();
        self.keep(0, filter);
        for row in 1..=steps {
            let step = filter.steps() + 1;
            let control = sequence.control(step);
            let advanced = filter.step_in_full(control, sequence.observation(step))?;
            each(advanced.log);
            self.normalizers[row] = advanced.normalizer;
            if advanced.by_logs {
                self.by_logs.push(row);
            }
            self.keep(row, filter);
        }
        Ok(())
    }

    fn keep<A: Transition, B: Likelihood>(&mut self, row: usize, filter: &Filter<&Hmm<A, B>>) {
        let held = filter.held();
        self.rows.push(held.linear);
        if let Some(logs) = held.logs {
            self.logs.insert(row, logs.to_vec());
        }
    }

    /// Returns true if the step to a row was taken in logarithms.
    pub(crate) fn by_logs(&self, row: usize) -> bool {
        self.by_logs.binary_search(&row).is_ok()
    }

    /// Returns the observation of the step to a row, with its normaliser.
    pub(crate) fn seen<'a, Y: ?Sized>(&self, row: usize, observation: &'a Y) -> Observed<'a, Y> {
        Observed { observation, normalizer: self.normalizers[row] }
    }

    pub(crate) fn held(&self, row: usize) -> BeliefRef<'_> {
        BeliefRef { linear: self.rows.row(row), logs: self.logs.get(&row).map(Vec::as_slice) }
    }
}
