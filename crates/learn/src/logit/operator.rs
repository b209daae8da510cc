//! Scores a + b · u of the moves, and their normaliser.
//!
//! Probabilities are exp(score − largest), divided by the sum of these, so that nothing overflows,
//! and a constant added to all scores changes no digit.

use std::f64::consts::LOG2_E;
use std::ops::Range;

use wayfix::internal::{Number, buffers, log};
use wayfix::transition::kit::check_slices;
use wayfix::{ReorderStates, Transition, TransitionEntries, TransitionError};
use wayfix_kernels as kernels;
use wayfix_kernels::limits;

use super::LogitTransition;

impl LogitTransition {
    /// Numbers of the moves out of a state.
    #[inline]
    pub(super) fn column(&self, from: usize) -> Range<usize> {
        self.starts[from] as usize..self.starts[from + 1] as usize
    }

    /// Slopes of a move by its number.
    #[inline]
    pub(super) fn slopes_at(&self, at: usize) -> &[f64] {
        match self.groups[at] as usize {
            0 => &[],
            group => &self.slopes[(group - 1) * self.inputs..group * self.inputs],
        }
    }

    #[inline]
    pub(super) fn score(&self, inputs: &[f64], at: usize) -> f64 {
        let terms = self.slopes_at(at).iter().zip(inputs).map(|(b, u)| b * u);
        self.intercepts[at] + terms.sum::<f64>()
    }

    /// The largest score of a column, and the sum of exp(score − largest).
    #[inline]
    pub(super) fn normalizer(&self, inputs: &[f64], from: usize) -> (f64, f64) {
        let scores = || self.column(from).map(|at| self.score(inputs, at));
        let largest = scores().fold(f64::NEG_INFINITY, f64::max);
        (largest, scores().map(|score| (score - largest).exp()).sum())
    }

    /// Writes exp(score − largest) for the moves out of a state, and returns their sum.
    #[inline]
    pub(super) fn weigh(&self, inputs: &[f64], from: usize, weights: &mut [f64]) -> f64 {
        let column = self.column(from);
        weights.iter_mut().zip(column).for_each(|(out, at)| *out = self.score(inputs, at));
        let largest = weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        weights.iter_mut().for_each(|weight| *weight = (*weight - largest).exp());
        weights.iter().sum()
    }

    /// Writes ln A\[i, j\] for the moves out of a state j.
    #[inline]
    pub(super) fn logs(&self, inputs: &[f64], from: usize, logs: &mut [f64]) {
        let (largest, sum) = self.normalizer(inputs, from);
        let sum = sum.ln();
        let moves = logs.iter_mut().zip(self.column(from));
        moves.for_each(|(log, at)| *log = self.score(inputs, at) - largest - sum);
    }

    /// Upper bound on the magnitude of scores at these inputs: O(p), not O(E p).
    fn bound(&self, inputs: &[f64]) -> f64 {
        let slopes = self.largest_slopes.iter().zip(inputs).map(|(b, u)| b * u.abs());
        self.largest_intercept + slopes.sum::<f64>()
    }

    /// True if an entry is below the range of doubles.
    pub(super) fn leaves_doubles(&self, inputs: &[f64]) -> bool {
        // Least logarithm of an entry, above that of the smallest normal double, −708.4.
        let least = -700.0;
        // score − largest ≥ −2 bound, and the sum has at most `widest` terms of at most 1. So
        // nearly all inputs pass without a look at the moves.
        if -2.0 * self.bound(inputs) - (self.widest as f64).ln() >= least {
            return false;
        }
        (0..self.states_count()).any(|from| {
            let (largest, sum) = self.normalizer(inputs, from);
            let mut scores = self.column(from).map(|at| self.score(inputs, at));
            scores.any(|score| score - largest - sum.ln() < least)
        })
    }

    pub(super) fn states_count(&self) -> usize {
        self.starts.len() - 1
    }

    pub(super) fn check_inputs(&self, inputs: &[f64]) -> Result<(), TransitionError> {
        let (found, expected) = (inputs.len(), self.inputs);
        if found != expected {
            let text = format!("{found} inputs given, expected {expected}");
            return Err(TransitionError::Control(text));
        }
        if let Some(input) = inputs.iter().position(|u| !u.is_finite()) {
            let value = inputs[input];
            let text = format!("input {input} is {value}, expected a finite value");
            return Err(TransitionError::Control(text));
        }
        if !limits::is_log(self.bound(inputs)) {
            // Names the input that contributes most.
            let part = |k: &usize| self.largest_slopes[*k] * inputs[*k].abs();
            let most = (0..self.largest_slopes.len()).max_by(|a, b| part(a).total_cmp(&part(b)));
            let input = most.unwrap_or(0);
            let value = Number(inputs[input]);
            let text =
                format!("input {input} is {value}, with which log-odds of moves may exceed 1e300");
            return Err(TransitionError::Control(text));
        }
        Ok(())
    }
}

// Products, column by column in both directions: the normaliser of a column takes the scores of all
// its moves, and is thus computed only once.

impl Transition for LogitTransition {
    /// The inputs, p numbers.
    type Control = Vec<f64>;

    fn states(&self) -> usize {
        self.states_count()
    }

    fn apply(&self, inputs: &Vec<f64>, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        out.fill(0.0);
        // Columns without mass are skipped: their exponentials are the costly part.
        buffers::with(self.widest, |weights: &mut [f64]| {
            for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 != 0.0) {
                let column = self.column(from);
                let weights = &mut weights[..column.len()];
                let sum = self.weigh(inputs, from, weights);
                for (to, weight) in self.to[column].iter().zip(weights) {
                    out[*to as usize] += *weight / sum * x;
                }
            }
        });
    }

    fn apply_transpose(&self, inputs: &Vec<f64>, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        buffers::with(self.widest, |weights: &mut [f64]| {
            for (from, out) in out.iter_mut().enumerate() {
                let column = self.column(from);
                let weights = &mut weights[..column.len()];
                let sum = self.weigh(inputs, from, weights);
                let moves = self.to[column].iter().zip(weights);
                *out = moves.map(|(to, weight)| *weight / sum * x[*to as usize]).sum();
            }
        });
    }

    fn apply_log(&self, inputs: &Vec<f64>, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        out.fill(f64::NEG_INFINITY);
        buffers::with(self.widest, |logs: &mut [f64]| {
            for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 > f64::NEG_INFINITY) {
                let column = self.column(from);
                let logs = &mut logs[..column.len()];
                self.logs(inputs, from, logs);
                for (to, log) in self.to[column].iter().zip(logs) {
                    let out = &mut out[*to as usize];
                    *out = log::add(*out, *log + x);
                }
            }
        });
    }

    fn apply_transpose_log(&self, inputs: &Vec<f64>, x: &[f64], out: &mut [f64]) {
        check_slices(self.states(), x, out);
        buffers::with(self.widest, |logs: &mut [f64]| {
            for (from, out) in out.iter_mut().enumerate() {
                let column = self.column(from);
                let logs = &mut logs[..column.len()];
                self.logs(inputs, from, logs);
                let terms =
                    self.to[column].iter().zip(logs).map(|(to, log)| *log + x[*to as usize]);
                *out = terms.fold(f64::NEG_INFINITY, log::add);
            }
        });
    }

    /// Returns a factor of 1 if an entry is below the range of doubles, so that inference takes the
    /// step in logarithms and no possible state is lost; otherwise `None`.
    fn evidence(&self, inputs: &Vec<f64>) -> Option<f64> {
        self.leaves_doubles(inputs).then_some(0.0)
    }

    fn needs_logs(&self, inputs: &Vec<f64>) -> bool {
        self.leaves_doubles(inputs)
    }

    fn check_control(&self, inputs: &Vec<f64>) -> Result<(), TransitionError> {
        self.check_inputs(inputs)
    }
}

// Single entries, and states in another order. An entry into a state takes the normaliser of its
// column, so listing a row costs all the columns that it meets.

/// Base-2 logarithm of an entry, on the grid of scores.
fn log2_of(log: f64) -> f64 {
    kernels::on_grid(log * LOG2_E)
}

impl LogitTransition {
    /// Lists the entries out of a state.
    pub(super) fn list(&self, inputs: &[f64], from: usize) -> impl Iterator<Item = (usize, f64)> {
        let (largest, sum) = self.normalizer(inputs, from);
        let entry =
            move |at: usize| (self.to[at] as usize, (self.score(inputs, at) - largest).exp() / sum);
        self.column(from).map(entry).filter(|entry| entry.1 > 0.0)
    }

    /// Moves into a state: pairs (from, number of the move).
    fn row(&self, to: usize) -> impl Iterator<Item = (usize, usize)> {
        let row = self.row_starts[to] as usize..self.row_starts[to + 1] as usize;
        self.rows[row].iter().map(|&(from, at)| (from as usize, at as usize))
    }
}

impl TransitionEntries for LogitTransition {
    fn incoming(&self, inputs: &Vec<f64>, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let entry = move |(from, at): (usize, usize)| {
            let (largest, sum) = self.normalizer(inputs, from);
            (from, (self.score(inputs, at) - largest).exp() / sum)
        };
        self.row(to).map(entry).filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(&self, inputs: &Vec<f64>, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list(inputs, from)
    }

    fn incoming_log2(&self, inputs: &Vec<f64>, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.row(to).map(move |(from, at)| {
            let (largest, sum) = self.normalizer(inputs, from);
            (from, log2_of(self.score(inputs, at) - largest - sum.ln()))
        })
    }

    fn outgoing_log2(&self, inputs: &Vec<f64>, from: usize) -> impl Iterator<Item = (usize, f64)> {
        // No filter: a legal move has a finite logarithm, however small its probability.
        let (largest, sum) = self.normalizer(inputs, from);
        let sum = sum.ln();
        self.column(from)
            .map(move |at| (self.to[at] as usize, log2_of(self.score(inputs, at) - largest - sum)))
    }

    fn max_product(&self, inputs: &Vec<f64>, x: &[f64], out: &mut [f64], predecessor: &mut [u32]) {
        check_slices(self.states(), x, out);
        out.fill(f64::NEG_INFINITY);
        predecessor.fill(0);
        buffers::with(self.widest, |logs: &mut [f64]| {
            // Predecessors come in ascending order, so the lowest wins ties.
            for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 > f64::NEG_INFINITY) {
                let column = self.column(from);
                let logs = &mut logs[..column.len()];
                self.logs(inputs, from, logs);
                for (to, log) in self.to[column].iter().zip(logs) {
                    let (to, value) = (*to as usize, log2_of(*log) + x);
                    if value > out[to] {
                        (out[to], predecessor[to]) = (value, from as u32);
                    }
                }
            }
        });
    }
}

impl ReorderStates for LogitTransition {
    fn reordered(&self, order: &[usize]) -> Self {
        let new = wayfix::internal::positions(order);
        let mut moves = Vec::with_capacity(self.to.len());
        for (from, &old) in order.iter().enumerate() {
            let start = moves.len();
            moves.extend(self.column(old).map(|at| {
                let to = new[self.to[at] as usize] as u32;
                (from as u32, to, self.intercepts[at], self.groups[at])
            }));
            // Targets have new numbers, so each column has to be sorted again.
            moves[start..].sort_unstable_by_key(|m| m.1);
        }
        let slopes = self.slopes.clone();
        // The coefficients are unchanged, and were valid: this does not fail.
        Self::from_parts(order.len(), &moves, slopes, self.inputs, self.ridge)
            .unwrap_or_else(|_| self.clone())
    }
}
