//! Uniformisation: exp(Q Δt) x as a sum of powers of a stochastic matrix.
//!
//! With Λ at least the largest exit rate, P = I + Q / Λ is stochastic, and
//! exp(Q Δt) x = Σ_k Pois(k; Λ Δt) P^k x has no negative term (Jensen 1953): rounding is relative,
//! for each state separately. So is the test for the end of the sum. Write v_k for P^k x and w_k
//! for its weight. As P has no negative entry, v ≤ ρ u in each state implies P v ≤ ρ P u. So if
//! v_k ≤ ρ v_{k-1}, then v_m ≤ ρ^(m-k) v_k for all later m, and in each state
//!
//! ```text
//! Σ_{m>k} w_m v_m ≤ w_k v_k r / (1 − r)      r = ρ Λ Δt / (k + 1) < 1
//! ```
//!
//! which must be below 2^-54 of the sum up to k. A state that is first reached at k has no such ρ:
//! the sum goes on until all reachable states are reached, or the weights underflow. And if the
//! ratio of v_k to v_{k-1} is within 1 ± ε in each state, then that of any later v_m to v_k is
//! within (1 ± ε)^(m-k): the rest of the sum is v_k times the rest of the weights, up to a relative
//! ε Λ Δt. With the rounding of a product for ε, the products that are left out would have lost as
//! much by rounding.

use wayfix::Transition;
use wayfix::internal::buffers;
use wayfix_kernels as kernels;

use super::GeneratorTransition;

/// Largest relative error of a state through the terms left out: half a rounding.
pub(super) const TRUNCATION: f64 = f64::EPSILON / 4.0;

/// Number of products after which changes are compared with rounding.
const PRODUCTS_BETWEEN_LOOKS: f64 = 32.0;

/// Bounds (ρ, r / (1 − r)) for a k beyond the mean. The closer r is to 1, the larger is ρ, and the
/// weaker the bound on the rest.
pub(super) fn growth(weights: &Poisson) -> Option<(f64, f64)> {
    // r halfway between Λ Δt / (k + 1), which allows no growth, and 1, which gives no bound.
    let ratio = weights.ratio();
    let r = 0.5 + 0.5 * ratio;
    (ratio < 1.0).then(|| (r / ratio, r / (1.0 - r)))
}

/// True if no state grows by more than ρ.
pub(super) fn grows_at_most(rho: f64, before: &[f64], after: &[f64]) -> bool {
    before.iter().zip(after).all(|(before, after)| *after <= rho * before)
}

/// True if later terms add less than [`TRUNCATION`] to each state.
fn rest_is_small(weights: &Poisson, before: &[f64], after: &[f64], sum: &[f64]) -> bool {
    let Some((rho, factor)) = growth(weights) else { return false };
    let factor = factor * weights.weight();
    // The cheap test first: in a state that hardly changes, v_k is about as large as the sum, so
    // the whole test can pass only if the factor itself is small.
    factor <= TRUNCATION
        && after.iter().zip(sum).all(|(after, sum)| factor * after <= TRUNCATION * sum)
        && grows_at_most(rho, before, after)
}

/// True if every state changes by no more than rounding.
fn has_converged(rounding: f64, before: &[f64], after: &[f64]) -> bool {
    before.iter().zip(after).all(|(before, after)| (after - before).abs() <= rounding * before)
}

impl GeneratorTransition {
    /// exp(Q Δt) x, or exp(Q' Δt) x if `transposed`, where Λ Δt is `mean`.
    pub(super) fn exponential(&self, mean: f64, transposed: bool, x: &[f64], out: &mut [f64]) {
        if mean == 0.0 {
            return out.copy_from_slice(x);
        }
        if !self.try_series(mean, transposed, x, out) {
            let n = x.len();
            buffers::with(n * n, |matrix| {
                self.matrix(mean, matrix);
                multiply(matrix, transposed, x, out);
            });
        }
        if !transposed {
            // exp(Q Δt) keeps the sum, but each product may lose a rounding of it. (The transpose
            // keeps no sum: it keeps the vector of ones.)
            let factor = kernels::sum(x) / kernels::sum(out);
            if factor.is_finite() && factor > 0.0 {
                out.iter_mut().for_each(|out| *out *= factor);
            }
        }
    }

    /// [`exponential`](Self::exponential) by the series; false if a matrix is cheaper.
    pub(super) fn try_series(
        &self,
        mean: f64,
        transposed: bool,
        x: &[f64],
        out: &mut [f64],
    ) -> bool {
        self.series(mean, self.break_even_products(mean), transposed, x, out)
    }

    /// Computes Σ_k Pois(k; mean) P^k x, or with P' if `transposed`; false if this takes more
    /// products than `most`.
    pub(super) fn series(
        &self,
        mean: f64,
        most: f64,
        transposed: bool,
        x: &[f64],
        out: &mut [f64],
    ) -> bool {
        // Invariant at the head of the loop: before = P^k x, and out = Σ of the terms up to k.
        buffers::with_two(x.len(), |before, after| {
            let mut weights = Poisson::new(mean);
            let (mut before, mut after) = (before, after);
            before.copy_from_slice(x);
            out.iter_mut().zip(x).for_each(|(out, x)| *out = weights.weight() * x);
            let mut k = 0.0;
            while k < most {
                k += 1.0;
                if transposed {
                    self.chain.apply_transpose(&(), before, after);
                } else {
                    self.chain.apply(&(), before, after);
                }
                weights.advance();
                let weight = weights.weight();
                if weight > 0.0 {
                    out.iter_mut().zip(&*after).for_each(|(out, x)| *out += weight * x);
                }
                if weights.is_over() || rest_is_small(&weights, before, after, out) {
                    return true;
                }
                if k % PRODUCTS_BETWEEN_LOOKS == 0.0 && has_converged(self.rounding, before, after)
                {
                    let rest = weights.rest();
                    out.iter_mut().zip(&*after).for_each(|(out, x)| *out += rest * x);
                    return true;
                }
                (before, after) = (after, before);
            }
            false
        })
    }
}

// Weights of the Poisson distribution, relative to the largest, so that e^−mean never underflows.

/// Mean above which no weight is computed: that many products are never taken.
const FAR: f64 = (1_u64 << 36) as f64;

/// Weights e^−mean mean^k / k! for k = 0, 1, …. Before the largest, those below 2.2e-308 of it are
/// 0; after it, they are 0 below 2.2e-308 if neighbours differ by less than a factor of 2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Poisson {
    mean: f64,
    k: f64,
    /// Weight of k over the largest.
    weight: f64,
    /// The first k with a weight, and that weight.
    first_weight: (f64, f64),
    /// Sum of all weights over the largest.
    total: f64,
}

impl Poisson {
    /// Computes the total weight, and where weights begin: O(√mean) steps for means above 700, and
    /// O(mean) below.
    pub(super) fn new(mean: f64) -> Self {
        if mean > FAR {
            return Self {
                mean,
                k: 0.0,
                weight: 0.0,
                first_weight: (f64::INFINITY, 0.0),
                total: 1.0,
            };
        }
        // Outwards from the mode, where the weight is set to 1, by w_{k-1} = w_k k / mean and
        // w_{k+1} = w_k mean / (k + 1): weights fall on both sides, so the sums are accurate.
        let mode = mean.floor();
        let (mut first, mut total) = ((mode, 1.0), 1.0);
        while first.0 > 0.0 {
            let before = first.1 * first.0 / mean;
            if before < f64::MIN_POSITIVE {
                break;
            }
            first = (first.0 - 1.0, before);
            total += before;
        }
        let (mut k, mut weight) = (mode, 1.0);
        while weight > f64::EPSILON / 64.0 * total {
            k += 1.0;
            weight *= mean / k;
            total += weight;
        }
        let weight = if first.0 == 0.0 { first.1 } else { 0.0 };
        Self { mean, k: 0.0, weight, first_weight: first, total }
    }

    /// Probability of k.
    pub(super) fn weight(&self) -> f64 {
        self.weight / self.total
    }

    /// Moves to the next k.
    pub(super) fn advance(&mut self) {
        self.k += 1.0;
        // Weights before the first are 0, so the recursion has to be started there.
        if self.k <= self.first_weight.0 {
            self.weight = if self.k == self.first_weight.0 { self.first_weight.1 } else { 0.0 };
            return;
        }
        let ratio = self.mean / self.k;
        self.weight *= ratio;
        // A subnormal times a ratio near 1 may round to itself forever.
        if self.weight < f64::MIN_POSITIVE && ratio > 0.5 {
            self.weight = 0.0;
        }
    }

    /// True if this weight and all later ones are 0.
    pub(super) fn is_over(&self) -> bool {
        self.weight == 0.0 && self.k >= self.first_weight.0
    }

    /// Sum of the weights after k.
    pub(super) fn rest(mut self) -> f64 {
        if self.k < self.first_weight.0 {
            return 1.0;
        }
        let mut sum = 0.0;
        loop {
            self.advance();
            // The sum can end only beyond the mode: up to it weights grow, and none is small
            // compared with the sum of all earlier ones.
            if self.weight <= f64::EPSILON / 64.0 * sum || self.is_over() {
                return sum / self.total;
            }
            sum += self.weight;
        }
    }

    /// The ratio q in a bound on later weights: with w for that of k, they are at most w q, w q², …
    /// Below 1 only beyond the mean.
    pub(super) fn ratio(&self) -> f64 {
        self.mean / (self.k + 1.0)
    }
}

// exp(Q Δt) as a dense matrix, by doubling a short time: for few states and long gaps.
//
// A vector takes Λ Δt products unless it stops changing before, which it may never do if rates
// differ by orders of magnitude. The matrix takes log2(Λ Δt) squarings. These have no negative
// numbers either, so errors stay relative.

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
    pub(super) fn break_even_products(&self, mean: f64) -> f64 {
        let n = self.states();
        if n > DENSE_STATES {
            return f64::INFINITY;
        }
        // In units of a product with P, which takes E multiplications and some work for each state:
        // n columns of a short series, and n³ multiplications for each squaring.
        let product = (self.chain.entries() + 4 * n) as f64;
        let columns = 32.0 * n as f64;
        64.0 + columns + f64::from(halvings(mean).0) * (n as f64).powi(3) / product
    }
}
