//! exp(Q Δt) as a dense matrix, by doubling a short time: for few states and long gaps.
//!
//! A vector takes Λ Δt products until it stops changing, which may be never where rates are of
//! different orders. The matrix takes log2(Λ Δt) squarings. There are no negative numbers in these
//! either, so that errors stay relative.

use super::GeneratorTransition;
use wayfix::Transition;
use wayfix::internal::buffers;
use wayfix_kernels as kernels;

/// Largest number of states for which matrices are computed.
pub(super) const DENSE_STATES: usize = 512;

/// out = A x or A' x, with A column after column.
pub(super) fn multiply(a: &[f64], transposed: bool, x: &[f64], out: &mut [f64]) {
    let n = x.len();
    if transposed {
        let columns = out.iter_mut().zip(a.chunks_exact(n));
        return columns.for_each(|(out, column)| *out = kernels::dot(column, x));
    }
    out.fill(0.0);
    add_product(a, x, 1.0, out);
}

/// out += factor · A x.
fn add_product(a: &[f64], x: &[f64], factor: f64, out: &mut [f64]) {
    for (column, x) in a.chunks_exact(x.len()).zip(x).filter(|(_, x)| **x != 0.0) {
        let x = factor * x;
        out.iter_mut().zip(column).for_each(|(out, a)| *out += a * x);
    }
}

/// out += factor · A B, of n × n each, column after column.
pub(super) fn add_matrix_product(n: usize, a: &[f64], b: &[f64], factor: f64, out: &mut [f64]) {
    let columns = b.chunks_exact(n).zip(out.chunks_exact_mut(n));
    columns.for_each(|(b, out)| add_product(a, b, factor, out));
}

/// Replaces A(t) by A(2 t) = A(t)², whose columns sum to one.
pub(super) fn double(n: usize, a: &mut [f64]) {
    buffers::with(n * n, |square| {
        square.fill(0.0);
        add_matrix_product(n, a, a, 1.0, square);
        a.copy_from_slice(square);
    });
    normalize_columns(n, a);
}

/// Makes columns sum to one, which they would not stay by themselves. What flows slowly between
/// groups of states that mix fast then has an error of some roundings, however long the time is.
fn normalize_columns(n: usize, a: &mut [f64]) {
    for column in a.chunks_exact_mut(n) {
        let factor = 1.0 / kernels::sum(column);
        column.iter_mut().for_each(|a| *a *= factor);
    }
}

/// The number of doublings of a mean of at most 1 that lead to this one, and that mean.
pub(super) fn halvings(mean: f64) -> (i32, f64) {
    let times = mean.log2().ceil().max(0.0);
    // In two steps: 2^-times alone may be below the doubles.
    let half = (0.5 * times).floor();
    (times as i32, mean * (-half).exp2() * (half - times).exp2())
}

impl GeneratorTransition {
    /// Writes exp(Q t) for a short time t, where Λ t is `mean`, column after column.
    pub(super) fn short_matrix(&self, mean: f64, a: &mut [f64]) {
        let n = self.states();
        buffers::with(n, |unit| {
            unit.fill(0.0);
            for (from, column) in a.chunks_exact_mut(n).enumerate() {
                unit[from] = 1.0;
                self.series(mean, f64::INFINITY, false, unit, column);
                unit[from] = 0.0;
            }
        });
        normalize_columns(n, a);
    }

    /// Writes exp(Q Δt), where Λ Δt is `mean`. O(n³ log2 mean + n E).
    pub(super) fn matrix(&self, mean: f64, a: &mut [f64]) {
        let (times, short) = halvings(mean);
        self.short_matrix(short, a);
        (0..times).for_each(|_| double(self.states(), a));
    }

    /// Number of products that cost as much as the matrix: one that takes them in vain takes twice
    /// the least time.
    pub(super) fn most_products(&self, mean: f64) -> f64 {
        let n = self.states();
        if n > DENSE_STATES {
            return f64::INFINITY;
        }
        let product = (self.chain.entries() + 4 * n) as f64;
        let columns = 32.0 * n as f64;
        64.0 + columns + f64::from(halvings(mean).0) * (n as f64).powi(3) / product
    }
}
