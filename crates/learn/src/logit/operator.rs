//! Products, column by column in both directions: the normaliser of a column takes the scores of
//! all its moves, and is so computed once.

use super::LogitTransition;
use wayfix::Transition;
use wayfix::TransitionError;
use wayfix::internal::{buffers, check_slices, log};

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
    /// step in logarithms and no possible state is lost; otherwise there is no evidence.
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
