//! One sequence under a model of up to eight states, one state in each lane: formulas 2, 3 and 7 of
//! the guide, many steps in a call, with the vector in a register.
//!
//! Vectors are not normalised at each step, but scaled by powers of two where they leave the middle
//! range of `limits` ("Few states"), and checked after each step: values above 0 are at least
//! 2^-300, likelihoods and entries 2^-200, so that no product loses a digit. Otherwise the call
//! ends, and the caller takes the sequence step by step.
//!
//! Lanes beyond the last state have entries of 0 (−∞ for scores), and stay so.

use crate::limits::{LEAST_FACTOR, LEAST_IN_CHAIN, MIDDLE_RANGE, exponent, power};
use crate::simd::{Eight, LANES, Simd, kernels, total};
use crate::vector::Packed;

/// Lines of a matrix, or of its logarithms, padded with 0 or −∞.
pub(super) type PaddedLines = [Packed; LANES];

/// A vector of a recursion, times 2^exponent.
#[derive(Debug, Clone, Copy)]
pub struct ChainState {
    pub values: Eight,
    pub exponent: i64,
}

impl ChainState {
    pub fn new(value: f64) -> Self {
        Self { values: [value; LANES], exponent: 0 }
    }

    /// Brings x back to the middle range if its largest value is beyond.
    #[inline(always)]
    fn rescale<S: Simd>(&mut self, s: S, x: &mut S::V) {
        let (low, high) = (s.splat(MIDDLE_RANGE[0]), s.splat(MIDDLE_RANGE[1]));
        // Two comparisons of all lanes; to find the largest value across them takes longer than the
        // rest of a step.
        if !s.any(s.lt(low, *x)) || s.any(s.lt(high, *x)) {
            let sum = total(s.to_array(*x));
            // A vector of zeros, or with an infinity or a NaN, has no scale to take out: it stays
            // as it is, and ends the call.
            if sum.is_normal() {
                let by = exponent(sum);
                self.exponent += by;
                *x = s.mul(*x, s.splat(power(-by)));
            }
        }
    }
}

/// The product of a matrix with x.
#[inline(always)]
fn product<S: Simd>(s: S, columns: &PaddedLines, x: S::V) -> S::V {
    let mut terms = s.broadcast_lanes(x);
    for (term, column) in terms.iter_mut().zip(columns) {
        *term = s.mul(s.load(column), *term);
    }
    // In pairs: a step waits for three additions, not for seven.
    let [a, b, c, d, e, f, g, h] = terms;
    s.add(s.add(s.add(a, b), s.add(c, d)), s.add(s.add(e, f), s.add(g, h)))
}

/// True if a likelihood or a value of the result is above 0, and so small that products may lose
/// digits.
#[inline(always)]
fn is_out_of_range<S: Simd>(s: S, b: S::V, x: S::V) -> bool {
    s.any(s.or(s.is_small(b, LEAST_FACTOR), s.is_small(x, LEAST_IN_CHAIN)))
}

kernels! {
    /// Takes x forward through some steps over the columns of a matrix. Writes the beliefs, in rows
    /// with a value for each state, and p(y_k | y_1 … y_{k-1}) up to scales of the likelihoods, or
    /// neither. Returns false if the range is too wide, or nothing is possible.
    pub fn chain_forward = forward<'a>(
        columns: &'a PaddedLines, state: &'a mut ChainState, states: usize, likelihoods: &'a [f64],
        rows: &'a mut [f64], normalizers: &'a mut [f64],
    ) -> bool;

    /// Takes r backward through some steps over the rows of a matrix, from r after the last, and
    /// turns beliefs into posteriors. Returns false if the range is too wide.
    pub fn chain_backward = backward<'a>(
        lines: &'a PaddedLines, state: &'a mut ChainState, states: usize, likelihoods: &'a [f64],
        rows: &'a mut [f64],
    ) -> bool;

    /// Takes scores through some steps over the logarithms of the columns, with backpointers; whole
    /// numbers are taken out. Returns false if nothing is possible.
    pub fn chain_decode = decode<'a>(
        columns: &'a PaddedLines, state: &'a mut ChainState, states: usize, likelihoods: &'a [f64],
        from: &'a mut [ChainPointers],
    ) -> bool;
}

#[inline(always)]
fn forward<S: Simd>(
    s: S,
    columns: &PaddedLines,
    state: &mut ChainState,
    states: usize,
    likelihoods: &[f64],
    rows: &mut [f64],
    normalizers: &mut [f64],
) -> bool {
    let mut x = s.load(&state.values);
    let mut rows = rows.chunks_exact_mut(states).zip(normalizers);
    let mut sum = total(state.values);
    for b in likelihoods.chunks_exact(states) {
        let b = s.load_partial(b);
        // The recursion takes x unnormalised: it need not wait for the sum and the division below,
        // which run in parallel with the next product.
        x = s.mul(product(s, columns, x), b);
        if let Some((row, normalizer)) = rows.next() {
            let after = total(s.to_array(x));
            *normalizer = after / sum;
            s.store_partial(s.mul(x, s.splat(1.0 / after)), row);
            let exponent = state.exponent;
            state.rescale(s, &mut x);
            // The next normaliser divides by the sum of x as it is now: a rescaling changes that
            // sum.
            sum = if state.exponent == exponent { after } else { total(s.to_array(x)) };
        } else {
            state.rescale(s, &mut x);
        }
        if is_out_of_range(s, b, x) {
            return false;
        }
    }
    // A NaN or an infinity of any step stays in the vector to the end, and shows up in its sum.
    state.values = s.to_array(x);
    let sum = total(state.values);
    sum > 0.0 && sum.is_finite()
}

#[inline(always)]
fn backward<S: Simd>(
    s: S,
    lines: &PaddedLines,
    state: &mut ChainState,
    states: usize,
    likelihoods: &[f64],
    rows: &mut [f64],
) -> bool {
    let mut r = s.load(&state.values);
    let steps = likelihoods.chunks_exact(states).zip(rows.chunks_exact_mut(states));
    for (b, row) in steps.rev() {
        // α ∘ β up to a factor, which the division by the sum removes.
        let posterior = s.mul(s.load_partial(row), r);
        let sum = total(s.to_array(posterior));
        s.store_partial(s.mul(posterior, s.splat(1.0 / sum)), row);
        let b = s.load_partial(b);
        r = product(s, lines, s.mul(r, b));
        state.rescale(s, &mut r);
        // A NaN compares false, but shows up in the sum.
        if is_out_of_range(s, b, r) || sum.is_nan() || sum <= 0.0 {
            return false;
        }
    }
    state.values = s.to_array(r);
    true
}

/// Backpointers of a step: bit i of each byte is a bit of the best predecessor of state i.
pub type ChainPointers = [u8; 3];

#[inline(always)]
fn decode<S: Simd>(
    s: S,
    columns: &PaddedLines,
    state: &mut ChainState,
    states: usize,
    likelihoods: &[f64],
    from: &mut [ChainPointers],
) -> bool {
    let mut scores = s.load(&state.values);
    // Score j in all lanes is added to column j: a step takes a sum and a maximum for each state,
    // and no reduction across lanes.
    for (b, from) in likelihoods.chunks_exact(states).zip(from) {
        let x = s.broadcast_lanes(scores);
        let mut best = s.add(s.load(&columns[0]), x[0]);
        let mut bits = [0; 3];
        for j in 1..states.min(LANES) {
            best = keep_better(s, best, s.add(s.load(&columns[j]), x[j]), j, &mut bits);
        }
        *from = bits;
        scores = s.add(best, s.load_partial(b));
        // A whole number is taken out at every step, as in the general routine, so that scores are
        // the same to the bit even beyond the range of exact sums.
        let largest = s.to_array(scores).into_iter().fold(f64::NEG_INFINITY, f64::max);
        if largest == f64::NEG_INFINITY {
            return false;
        }
        let whole = largest.floor();
        scores = s.sub(scores, s.splat(whole));
        state.exponent += whole as i64;
    }
    state.values = s.to_array(scores);
    true
}

/// Larger of two scores in each lane; where it is that of predecessor j, `bits` become those of j.
/// The lowest of several that attain the maximum stays.
#[inline(always)]
pub(super) fn keep_better<S: Simd, const B: usize>(
    s: S,
    best: S::V,
    score: S::V,
    j: usize,
    bits: &mut [u8; B],
) -> S::V {
    // Equal scores leave the bits of the lower predecessor, which came first. A bit for each lane
    // in place of an index: B bytes a step instead of 32, and no blend of indices.
    let higher = s.bits(s.lt(best, score));
    for (bit, bits) in bits.iter_mut().enumerate() {
        let set = if j >> bit & 1 == 1 { higher } else { 0 };
        *bits = *bits & !higher | set;
    }
    s.max(score, best)
}
