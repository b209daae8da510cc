//! Single entries, and states in another order. An entry into a state takes the normaliser of its
//! column, so that listing a row costs all the columns that it meets.

use std::f64::consts::LOG2_E;

use super::LogitTransition;
use wayfix::ReorderStates;
use wayfix::internal::{buffers, check_slices};
use wayfix::{Transition, TransitionEntries};
use wayfix_kernels as kernels;

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
            // Predecessors come in ascending order, so that the lowest wins ties.
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
            // Targets have new numbers: columns must ascend again.
            moves[start..].sort_unstable_by_key(|m| m.1);
        }
        let slopes = self.slopes.clone();
        // The coefficients are unchanged, and were valid: this does not fail.
        Self::from_parts(order.len(), &moves, slopes, self.inputs, self.ridge)
            .unwrap_or_else(|_| self.clone())
    }
}
