//! Rates from expected moves and times: q\[i, j\] = moves from j to i / time in j, the M-step of
//! Hobolth and Jensen (2011).

use std::collections::BTreeMap;

use wayfix::error::OutOfRange;
use wayfix::internal::buffers;
use wayfix::transition::{LearnTransition, Move, MoveCounts};
use wayfix::{Transition, TransitionError};
use wayfix_kernels as kernels;
use wayfix_kernels::limits::{LIFT, power};

use super::GeneratorTransition;
use super::exponential::Poisson;
use super::exponential::{TRUNCATION, grows_at_most, growth};
use super::exponential::{add_matrix_product, double, halvings, multiply};

/// Expected moves and times in states, for learning a [`GeneratorTransition`].
#[derive(Debug, Clone, PartialEq)]
pub struct GeneratorStatistics {
    /// Number of each legal move, by the state that is left.
    moves: Vec<f64>,
    times: Vec<f64>,
    /// Moves between two observations, by the bits of the time between them (whose order is that of
    /// the times, as these are not negative). Not yet in the sums.
    between: BTreeMap<u64, MoveCounts>,
}

impl GeneratorStatistics {
    /// Expected time in each state, over all steps but those whose moves were counted one by one:
    /// steps of labelled drives, and steps in logarithms.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Expected number of each legal move over the same steps, in the order of
    /// [`triplets`](GeneratorTransition::triplets).
    #[must_use]
    pub fn moves(&self) -> &[f64] {
        &self.moves
    }
}

impl GeneratorTransition {
    /// Adds the expected moves and times of a step, and returns Σ b(j) A\[i, j\] a(i) scale.
    fn add_expected(
        &self,
        sums: &mut GeneratorStatistics,
        time: f64,
        ends: (&[f64], &[f64]),
        scale: f64,
    ) -> f64 {
        let mean = self.mean_steps(time);
        // Entries of the chain come column by column. Each column has one stay; its other entries
        // are the legal moves in the order of `sums.moves`, which `at` counts.
        let (mut at, mut from) = (0, 0);
        self.expected(mean, ends, scale, |entry, share| {
            let columns = self.chain.columns();
            while entry >= columns.starts()[from + 1] as usize {
                from += 1;
            }
            let (to, p) = columns.entry(entry);
            // A share is P[i, j] times the mean of the product of both ends over the time. Without
            // P it is the part of the time spent in j; times Λ Δt it is the number of moves.
            if to == from {
                sums.times[from] += share / p * time;
            } else {
                sums.moves[at] += share * mean;
                at += 1;
            }
        })
    }

    /// Adds the expected moves and times between pairs of known states, each pair weighted by its
    /// count.
    fn add_between(
        &self,
        sums: &mut GeneratorStatistics,
        time: f64,
        counts: &MoveCounts,
    ) -> Result<(), TransitionError> {
        let moves: Vec<Move> = counts.moves().collect();
        for some in moves.chunk_by(|a, b| a.from == b.from) {
            let (n, from) = (self.states(), some[0].from);
            if from >= n {
                return Err(TransitionError::Forbidden { to: some[0].to, from });
            }
            // All moves out of one state are one step: it starts there (b is a unit vector) and
            // ends in each state as often as counted, a(i) = count / A[i, from]. A is lifted, so
            // that tiny entries have all their digits; the last argument takes the lift out.
            buffers::with_two(n, |unit, after| {
                unit.fill(0.0);
                unit[from] = LIFT;
                self.apply(&time, unit, after);
                unit[from] = 1.0;
                let mut moves = some.iter().peekable();
                for (to, after) in after.iter_mut().enumerate() {
                    let weight = moves.next_if(|m| m.to == to).map_or(0.0, |m| m.weight);
                    if weight > 0.0 && *after == 0.0 {
                        return Err(TransitionError::Forbidden { to, from });
                    }
                    *after = if weight > 0.0 { weight / *after } else { 0.0 };
                }
                if let Some(m) = moves.next() {
                    return Err(TransitionError::Forbidden { to: m.to, from });
                }
                self.add_expected(sums, time, (unit, after), LIFT);
                Ok(())
            })?;
        }
        Ok(())
    }
}

impl LearnTransition for GeneratorTransition {
    type Statistics = GeneratorStatistics;

    fn statistics(&self) -> GeneratorStatistics {
        let (moves, times) = (vec![0.0; self.rates.entries()], vec![0.0; self.states()]);
        GeneratorStatistics { moves, times, between: BTreeMap::new() }
    }

    fn merge(&self, sums: &mut GeneratorStatistics, other: &GeneratorStatistics) {
        sums.moves.iter_mut().zip(&other.moves).for_each(|(sum, moves)| *sum += moves);
        sums.times.iter_mut().zip(&other.times).for_each(|(sum, time)| *sum += time);
        for (time, counts) in &other.between {
            sums.between.entry(*time).or_default().merge(counts);
        }
    }

    fn counts<'s>(
        &self,
        sums: &'s mut GeneratorStatistics,
        time: &f64,
    ) -> Option<&'s mut MoveCounts> {
        // −0 and 0 are the same time.
        Some(sums.between.entry(time.abs().to_bits()).or_default())
    }

    fn add_step(
        &self,
        sums: &mut GeneratorStatistics,
        &time: &f64,
        before: &[f64],
        after: &[f64],
        scale: f64,
    ) -> Option<f64> {
        Some(self.add_expected(sums, time, (before, after), scale))
    }

    /// A rate that underflows relative to the largest becomes 0, which makes the move illegal.
    fn maximize(
        &self,
        statistics: &GeneratorStatistics,
        pseudo_count: f64,
    ) -> Result<Self, TransitionError> {
        let found = (statistics.times.len(), statistics.moves.len());
        if found != (self.states(), self.rates.entries()) {
            let what = "the number of states and moves in the statistics";
            let expected = "as many as the operator has";
            return Err(OutOfRange::new(what, (found.0 + found.1) as f64, expected).into());
        }
        let mut sums = statistics.clone();
        for (time, counts) in &statistics.between {
            self.add_between(&mut sums, f64::from_bits(*time), counts)?;
        }
        let mut rates = Vec::with_capacity(sums.moves.len());
        let mut largest: f64 = 0.0;
        let mut moves = sums.moves.iter();
        for (from, time) in sums.times.iter().enumerate() {
            let mut exit = 0.0;
            for ((to, old), moves) in self.rates.line(from).zip(&mut moves) {
                let rate =
                    if *time < f64::MIN_POSITIVE { old } else { (moves + pseudo_count) / time };
                exit += rate;
                rates.push((to, from, rate));
            }
            largest = largest.max(exit);
        }
        // Rates that `from_triplets` would refuse, below 2.2e-308 of Λ, become 0.
        let least = largest * crate::generator::MARGIN * f64::MIN_POSITIVE * (1.0 + f64::EPSILON);
        rates.iter_mut().filter(|entry| entry.2 < least).for_each(|entry| entry.2 = 0.0);
        Self::from_triplets(self.states(), rates)
    }

    fn log_prior(&self, pseudo_count: f64) -> f64 {
        if pseudo_count == 0.0 {
            return 0.0;
        }
        pseudo_count * self.triplets().map(|entry| entry.2.ln()).sum::<f64>()
    }

    fn free_parameters(&self) -> usize {
        self.rates.entries()
    }
}

/// Rates of the legal moves.
impl wayfix::inference::FreeParameters for GeneratorTransition {
    fn displaced(
        &self,
        by: &mut wayfix::inference::Displacement<'_>,
    ) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let moved = self.triplets().map(|(to, from, rate)| (to, from, by.positive(rate)));
        let moved: Vec<_> = moved.collect();
        Ok(Self::from_triplets(self.states(), moved)?)
    }
}

// Expected moves and times of a step, given both of its ends (Hobolth and Jensen 2011).
//
// With weights b before and a after a step of time t, the moves from j to i account for q\[i, j\]
// ∫ (exp(Q s) b)_j (exp(Q' (t − s)) a)_i ds of a' exp(Q t) b, and the time in j for the same
// integral with i = j. By uniformisation, with v_k = P^k b and w_m = Pois(m; Λ t), the integral is
//
// ```text
// (1 / Λ) Σ_k v_k(j) z_k(i)      z_k = Σ_{m>k} w_m P'^(m-1-k) a = w_{k+1} a + P' z_{k+1}
// ```
//
// since ∫ Pois(k; Λ s) Pois(l; Λ (t − s)) ds = Pois(k + l + 1; Λ t) / Λ. Long steps are cut into
// segments, so that only the v_k of one segment are stored, while a is carried back from segment to
// segment. Where a matrix is cheaper, the integral X is also a matrix: X(2 t) = A(t) X(t) + X(t)
// A(t) (Van Loan 1978).

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
                } else if mean > self.break_even_products(mean) {
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

    /// Appends v_k and w_k, until what is left out is below [`TRUNCATION`] of a' exp(Q t) b.
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
            // P keeps the sum of v_k, so a' v_m is at most `most` for all m, and the weights fall
            // at least geometrically.
            let surely = ratio < 1.0 && weight * ratio / (1.0 - ratio) * most <= TRUNCATION * total;
            // Or the bound on the growth of v_k (see `series.rs`), applied to a' v_m.
            let rest_is_small = || {
                growth(&poisson).is_some_and(|(rho, factor)| {
                    factor * weight * reached <= TRUNCATION * total
                        && grows_at_most(rho, before, after)
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
