//! Rows and columns of exp(Q Δt), each by a product.

use super::GeneratorTransition;
use super::doubling::multiply;
use wayfix::internal::{best_of, buffers};
use wayfix::{Transition, TransitionEntries};
use wayfix_kernels::limits::LIFT;
use wayfix_kernels::log2;

/// log2 of an entry that was computed from a lifted unit vector. With the lift, entries below the
/// smallest double have a logarithm, and the terms of an entry keep all their digits.
fn log2_of_lifted(entry: f64) -> f64 {
    log2(entry) - LIFT.log2()
}

impl GeneratorTransition {
    /// Lists the entries above 0 of a column, or of a row if `transposed`, times `unit`.
    fn list(
        &self,
        time: f64,
        transposed: bool,
        state: usize,
        unit: f64,
    ) -> impl Iterator<Item = (usize, f64)> + use<> {
        // The iterator outlives this call, so that its values can't be in a lent buffer.
        let mut line = vec![0.0; self.states()];
        buffers::with(line.len(), |x| {
            x.fill(0.0);
            x[state] = unit;
            self.exponential(self.mean_steps(time), transposed, x, &mut line);
        });
        line.into_iter().enumerate().filter(|entry| entry.1 > 0.0)
    }

    fn list_log2(
        &self,
        time: f64,
        transposed: bool,
        state: usize,
    ) -> impl Iterator<Item = (usize, f64)> + use<> {
        let line = self.list(time, transposed, state, LIFT);
        line.map(|(other, entry)| (other, log2_of_lifted(entry)))
    }
}

impl TransitionEntries for GeneratorTransition {
    fn incoming(&self, &time: &f64, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list(time, true, to, 1.0)
    }

    fn outgoing(&self, &time: &f64, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list(time, false, from, 1.0)
    }

    fn incoming_log2(&self, &time: &f64, to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list_log2(time, true, to)
    }

    fn outgoing_log2(&self, &time: &f64, from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.list_log2(time, false, from)
    }

    fn max_product(&self, &time: &f64, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        const NEEDS_MATRIX: u32 = u32::MAX;
        let (n, mean) = (x.len(), self.mean_steps(time));
        buffers::with_two(n, |unit, row| {
            unit.fill(0.0);
            let best = |row: &[f64]| best_of((0..).zip(row.iter().map(|&p| log2_of_lifted(p))), x);
            // Row by row, by the series. A row whose series would cost more than the matrix is
            // marked, and waits.
            for (i, (out, from)) in out.iter_mut().zip(&mut *from).enumerate() {
                unit[i] = LIFT;
                let found = if mean == 0.0 {
                    row.copy_from_slice(unit);
                    true
                } else {
                    self.line(mean, true, unit, row)
                };
                unit[i] = 0.0;
                (*out, *from) = if found { best(row) } else { (0.0, NEEDS_MATRIX) };
            }
            if !from.contains(&NEEDS_MATRIX) {
                return;
            }
            // One matrix for all marked rows. `incoming_log2` makes the same choice for each row,
            // so that both give the same numbers.
            buffers::with(n * n, |matrix| {
                self.matrix(mean, matrix);
                for (i, (out, from)) in out.iter_mut().zip(&mut *from).enumerate() {
                    if *from == NEEDS_MATRIX {
                        unit[i] = LIFT;
                        multiply(matrix, true, unit, row);
                        unit[i] = 0.0;
                        (*out, *from) = best(row);
                    }
                }
            });
        });
    }
}
