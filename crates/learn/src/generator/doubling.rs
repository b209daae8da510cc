//! exp(Q Δt) as a dense matrix, by doubling a short time: for few states and long gaps.
//!
//! A vector takes Λ Δt products unless it stops changing before, which it may never do if rates
//! differ by orders of magnitude. The matrix takes log2(Λ Δt) squarings. These have no negative
//! numbers either, so that errors stay relative.

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

/// Replaces A(t) by A(2 t) = A(t)², with columns normalised.
pub(super) fn double(n: usize, a: &mut [f64]) {
    buffers::with(n * n, |square| {
        square.fill(0.0);
        add_matrix_product(n, a, a, 1.0, square);
        a.copy_from_slice(square);
    });
    normalize_columns(n, a);
}

/// Makes columns sum to one. Rounding alone would double at each squaring, and destroy slow flows
/// between groups of states that mix fast; normalised, these have an error of some roundings,
/// however long the time is.
fn normalize_columns(n: usize, a: &mut [f64]) {
    for column in a.chunks_exact_mut(n) {
        let factor = 1.0 / kernels::sum(column);
        column.iter_mut().for_each(|a| *a *= factor);
    }
}

/// Splits a mean into a mean of at most 1 and the number of doublings that lead from it to this
/// one; returns (doublings, that mean).
pub(super) fn halvings(mean: f64) -> (i32, f64) {
    let times = mean.log2().ceil().max(0.0);
    // In two steps: 2^-times alone may underflow.
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

    /// Number of products that cost as much as the matrix. A series that is abandoned after that
    /// many has at most doubled the time.
    pub(super) fn most_products(&self, mean: f64) -> f64 {
        let n = self.states();
        if n > DENSE_STATES {
            return f64::INFINITY;
        }
        // In units of a product with P, of E multiplications and some work a state: n columns of a
        // short series, and n³ multiplications for each squaring.
        let product = (self.chain.entries() + 4 * n) as f64;
        let columns = 32.0 * n as f64;
        64.0 + columns + f64::from(halvings(mean).0) * (n as f64).powi(3) / product
    }
}
