//! Expected moves and times of a step, given both of its ends (Hobolth and Jensen 2011).
//!
//! With weights b before and a after a step of time t, the moves from j to i account for q\[i, j\]
//! ∫ (exp(Q s) b)_j (exp(Q' (t − s)) a)_i ds of a' exp(Q t) b, and the time in j for the same
//! integral with i = j. By uniformisation, with v_k = P^k b and w_m = Pois(m; Λ t), the integral is
//!
//! ```text
//! (1 / Λ) Σ_k v_k(j) z_k(i)      z_k = Σ_{m>k} w_m P'^(m-1-k) a = w_{k+1} a + P' z_{k+1}
//! ```
//!
//! since ∫ Pois(k; Λ s) Pois(l; Λ (t − s)) ds = Pois(k + l + 1; Λ t) / Λ. Long steps are cut into
//! segments, so that only the v_k of one segment are stored, while a is carried back from segment
//! to segment. Where a matrix is cheaper, the integral X is one, too: X(2 t) = A(t) X(t) + X(t)
//! A(t) (Van Loan 1978).

use super::GeneratorTransition;
use super::doubling::{add_matrix_product, double, halvings, multiply};
use super::poisson::Poisson;
use super::series::{CUT, grows_at_most, growth};
use wayfix::Transition;
use wayfix::internal::buffers;
use wayfix_kernels as kernels;
use wayfix_kernels::limits::power;

/// Exponents of two by which b and a are lifted, after the largest a is scaled to 1. Products do
/// not overflow, and any part of a' A b that matters is a normal double.
const LIFTS: (i64, i64) = (500, 400);

/// Mean of a short segment.
const SEGMENT: f64 = 16.0;

impl GeneratorTransition {
    /// Calls `add` with the position of each entry of the chain, and its share of Σ b(j) A\[i, j\]
    /// a(i) scale: the mean over the time of the step of (exp(Q s) b)_j P\[i, j\] (exp(Q' (t − s))
    /// a)_i scale. Returns that sum. For states that no move reaches, a may be NaN.
    pub(super) fn expected(
        &self,
        mean: f64,
        (before, after): (&[f64], &[f64]),
        scale: f64,
        mut add: impl FnMut(usize, f64),
    ) -> f64 {
        // A NaN belongs to a state that is not reached, whose terms are 0 whatever a is.
        let finite = |a: f64| if a.is_finite() { a } else { 0.0 };
        let largest = after.iter().copied().map(finite).fold(0.0, f64::max);
        if largest == 0.0 {
            return 0.0;
        }
        let (b_lift, a_lift) = (power(LIFTS.0), power(LIFTS.1));
        let lowered = power(-LIFTS.0 - LIFTS.1);
        buffers::with_two(before.len(), |b, a| {
            b.iter_mut().zip(before).for_each(|(out, b)| *out = b * b_lift);
            a.iter_mut().zip(after).for_each(|(out, a)| *out = finite(*a) / largest * a_lift);
            buffers::with(self.chain.entries(), |sums| {
                sums.fill(0.0);
                let total = if mean == 0.0 {
                    self.add_pairs(b, a, sums);
                    kernels::dot(a, b)
                } else if mean > self.most_products(mean) {
                    self.by_matrices(mean, b, a, sums)
                } else {
                    self.by_segments(mean, b, a, sums)
                };
                let unlift = |sum: f64| sum * lowered * largest * scale;
                sums.iter().enumerate().for_each(|(at, sum)| add(at, unlift(*sum)));
                unlift(total)
            })
        })
    }

    fn by_segments(&self, mean: f64, b: &[f64], a: &mut [f64], sums: &mut [f64]) -> f64 {
        // √mean segments, with about √mean powers each, store the fewest vectors: O(√mean n). The
        // starts of all segments are computed forward, then the segments are taken from the last.
        let n = b.len();
        let segments = 1 + (mean / mean.sqrt().max(SEGMENT)) as i32;
        let segments = segments.cast_unsigned() as usize;
        let short = mean / segments as f64;
        buffers::with(segments * n, |starts| {
            starts[..n].copy_from_slice(b);
            for number in 1..segments {
                let (known, next) = starts.split_at_mut(number * n);
                let before = &known[(number - 1) * n..];
                self.series(short, f64::INFINITY, false, before, &mut next[..n]);
            }
            for start in starts.chunks_exact(n).rev() {
                self.segment(short, start, a, sums);
            }
        });
        sums.iter_mut().for_each(|sum| *sum /= mean);
        kernels::dot(a, b)
    }

    /// Adds Σ_k v_k(j) P\[i, j\] z_k(i) of a segment, and replaces a by exp(Q' t) a.
    fn segment(&self, mean: f64, b: &[f64], a: &mut [f64], sums: &mut [f64]) {
        let n = b.len();
        // Horner's rule: z_{k-1} = w_k a + P' z_k, from z_{last-1} = w_last a down. At the end z is
        // Σ_m w_m P'^m a = exp(Q' t) a, the value of a at the start of the segment.
        buffers::with_growing(|powers| {
            buffers::with_growing(|weights| {
                self.powers(mean, b, a, powers, weights);
                let last = weights.len() - 1;
                buffers::with_two(n, |z, product| {
                    z.iter_mut().zip(&*a).for_each(|(z, a)| *z = weights[last] * a);
                    for k in (0..last).rev() {
                        self.add_pairs(&powers[k * n..][..n], z, sums);
                        self.chain.apply_transpose(&(), z, product);
                        let terms = z.iter_mut().zip(&*a).zip(&*product);
                        terms.for_each(|((z, a), product)| *z = weights[k] * a + product);
                    }
                    a.copy_from_slice(z);
                });
            });
        });
    }

    /// Appends v_k and w_k, until what is left out is below [`CUT`] of a' exp(Q t) b.
    fn powers(
        &self,
        mean: f64,
        b: &[f64],
        a: &[f64],
        powers: &mut Vec<f64>,
        weights: &mut Vec<f64>,
    ) {
        let n = b.len();
        let most = kernels::sum(b) * a.iter().copied().fold(0.0, f64::max);
        let mut poisson = Poisson::new(mean);
        powers.extend_from_slice(b);
        weights.push(poisson.weight());
        let mut total = poisson.weight() * kernels::dot(a, b);
        loop {
            let known = powers.len();
            powers.resize(known + n, 0.0);
            let (before, after) = powers.split_at_mut(known);
            let before = &before[known - n..];
            self.chain.apply(&(), before, after);
            poisson.advance();
            let weight = poisson.weight();
            weights.push(weight);
            let reached = kernels::dot(a, after);
            total += weight * reached;
            let ratio = poisson.ratio();
            // P keeps the sum of v_k, so that a' v_m is at most `most` for all m, and the weights
            // fall at least geometrically.
            let surely = ratio < 1.0 && weight * ratio / (1.0 - ratio) * most <= CUT * total;
            // Or the bound on the growth of v_k (see `series.rs`), applied to a' v_m.
            let rest_is_small = || {
                growth(&poisson).is_some_and(|(rho, factor)| {
                    factor * weight * reached <= CUT * total && grows_at_most(rho, before, after)
                })
            };
            if poisson.is_over() || surely || rest_is_small() {
                return;
            }
        }
    }

    /// sums\[i, j\] += v(j) P\[i, j\] z(i).
    fn add_pairs(&self, v: &[f64], z: &[f64], sums: &mut [f64]) {
        // `sums` has the order of the chain's columns. Origins without weight are skipped.
        let mut at = 0;
        for (from, v) in v.iter().enumerate() {
            let column = self.chain.columns().line(from);
            let end = self.chain.columns().starts()[from + 1] as usize;
            if *v > 0.0 {
                let sums = sums[at..end].iter_mut().zip(column);
                sums.for_each(|(sum, (to, p))| *sum += v * (p * z[to]));
            }
            at = end;
        }
    }

    /// The same sums by doubling: O(n³ log2 mean).
    fn by_matrices(&self, mean: f64, b: &[f64], a: &[f64], sums: &mut [f64]) -> f64 {
        let n = b.len();
        let (times, short) = halvings(mean);
        buffers::with_two(n * n, |moves, integral| {
            self.short_matrix(short, moves);
            self.short_integral(short, b, a, integral);
            buffers::with(n * n, |twice| {
                for _ in 0..times {
                    // X(2 t) = A X + X A for the integral; for the mean over the time each half
                    // counts one half.
                    twice.fill(0.0);
                    add_matrix_product(n, moves, integral, 0.5, twice);
                    add_matrix_product(n, integral, moves, 0.5, twice);
                    integral.copy_from_slice(twice);
                    double(n, moves);
                }
            });
            let columns = (0..n)
                .flat_map(|from| self.chain.columns().line(from).map(move |(to, p)| (from, to, p)));
            for (sum, (from, to, p)) in sums.iter_mut().zip(columns) {
                *sum = p * integral[to * n + from];
            }
            buffers::with(n, |out| {
                multiply(moves, false, b, out);
                kernels::dot(out, a)
            })
        })
    }

    /// Writes the mean of (exp(Q s) b)_j (exp(Q' (t − s)) a)_i over a short time t at row j and
    /// column i.
    fn short_integral(&self, mean: f64, b: &[f64], a: &[f64], integral: &mut [f64]) {
        let n = b.len();
        integral.fill(0.0);
        buffers::with_growing(|powers| {
            buffers::with_growing(|weights| {
                let mut poisson = Poisson::new(mean);
                powers.extend_from_slice(b);
                weights.push(poisson.weight());
                // No bound on a single number ends this sum, since all pairs of states are needed:
                // it goes on to the end of the weights, which is not far for a short time.
                while !poisson.is_over() {
                    let known = powers.len();
                    powers.resize(known + n, 0.0);
                    let (before, after) = powers.split_at_mut(known);
                    self.chain.apply(&(), &before[known - n..], after);
                    poisson.advance();
                    weights.push(poisson.weight());
                }
                let last = weights.len() - 1;
                buffers::with_two(n, |z, product| {
                    z.iter_mut().zip(a).for_each(|(z, a)| *z = weights[last] * a);
                    for k in (0..last).rev() {
                        let v = &powers[k * n..][..n];
                        for (column, z) in integral.chunks_exact_mut(n).zip(&*z) {
                            let z = z / mean;
                            column.iter_mut().zip(v).for_each(|(sum, v)| *sum += v * z);
                        }
                        self.chain.apply_transpose(&(), z, product);
                        let terms = z.iter_mut().zip(a).zip(&*product);
                        terms.for_each(|((z, a), product)| *z = weights[k] * a + product);
                    }
                });
            });
        });
    }
}
