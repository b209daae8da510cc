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

use super::GeneratorTransition;
use super::poisson::Poisson;
use wayfix::Transition;
use wayfix::internal::buffers;
use wayfix_kernels as kernels;

/// Largest relative error of a state through the terms left out: half a rounding.
pub(super) const CUT: f64 = f64::EPSILON / 4.0;

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

/// True if later terms add less than [`CUT`] to each state.
fn rest_is_small(weights: &Poisson, before: &[f64], after: &[f64], sum: &[f64]) -> bool {
    let Some((rho, factor)) = growth(weights) else { return false };
    let factor = factor * weights.weight();
    // The cheap test first: in a state that hardly changes, v_k is about as large as the sum, so
    // that the whole test can pass only if the factor itself is small.
    factor <= CUT
        && after.iter().zip(sum).all(|(after, sum)| factor * after <= CUT * sum)
        && grows_at_most(rho, before, after)
}

/// True if every state changes by no more than rounding.
fn is_still(rounding: f64, before: &[f64], after: &[f64]) -> bool {
    before.iter().zip(after).all(|(before, after)| (after - before).abs() <= rounding * before)
}

impl GeneratorTransition {
    /// exp(Q Δt) x, or exp(Q' Δt) x if `transposed`, where Λ Δt is `mean`.
    pub(super) fn exponential(&self, mean: f64, transposed: bool, x: &[f64], out: &mut [f64]) {
        if mean == 0.0 {
            return out.copy_from_slice(x);
        }
        if !self.line(mean, transposed, x, out) {
            let n = x.len();
            buffers::with(n * n, |matrix| {
                self.matrix(mean, matrix);
                super::doubling::multiply(matrix, transposed, x, out);
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
    pub(super) fn line(&self, mean: f64, transposed: bool, x: &[f64], out: &mut [f64]) -> bool {
        self.series(mean, self.most_products(mean), transposed, x, out)
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
                if k % PRODUCTS_BETWEEN_LOOKS == 0.0 && is_still(self.rounding, before, after) {
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
