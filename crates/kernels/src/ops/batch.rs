//! Steps of eight chains side by side, one in each lane: formulas 2, 3 and 7 of the guide, all
//! lifted.
//!
//! Lanes never mix: each holds a sequence of its own, with its own sum, factor or shift, and if a
//! loss is noticed, its lane alone is given up. The invariants are those of "In lanes" in `limits`:
//! entries are at least 2^-100, likelihoods above 0 at least 2^-900 (`pack` has checked), and α is
//! normal or 0.

use super::backward::{divided, smoothed};
use super::lines::Lines;
use super::packing::flags;
use crate::layout::{Maxima, Sink};
use crate::limits::LIFT;
use crate::memory::Packed;
use crate::semiring::{MaxPlus, SumProduct};
use crate::simd::{Eight, LANES, Simd, kernels};

kernels! {
    /// `out = (A x) ∘ b`, or `x ∘ b` without a matrix. Returns the sums of `out`.
    pub fn batch_forward = forward<'a>(
        matrix: Option<Lines<'a>>, x: &'a [Packed], likelihoods: &'a [Packed],
        out: &'a mut [Packed],
    ) -> Eight;

    /// Divides vectors by their sums, `sums`: writes the distributions to `out`, with 0 for values
    /// that would be below the smallest normal double, and lifts them in place. Returns the lanes
    /// where a value became 0.
    pub fn batch_normalize = normalize<'a>(
        x: &'a mut [Packed], out: &'a mut [Packed], sums: Eight,
    ) -> [bool; LANES];

    /// First half of a step back: `ratio = q ∘ b` times a factor.
    pub fn batch_ratio = divide<'a>(
        q: &'a [Packed], likelihoods: &'a [Packed], factors: Eight, ratio: &'a mut [Packed],
    ) -> ();

    /// Adds α(j) times the ratio at i to the count of each entry i of each column j.
    pub fn count_moves = count<'a>(
        columns: Lines<'a>, alpha: &'a [Packed], ratio: &'a [Packed], counts: &'a mut [Packed],
    ) -> ();

    /// Second half of a step back, over the columns: `q` = A' times the ratio, and α becomes
    /// γ = α ∘ q, except in lanes with the factor 0. Returns Σ γᵢ.
    pub fn batch_backward = backward<'a>(
        columns: Lines<'a>, factors: Eight, ratio: &'a [Packed], alpha: &'a mut [Packed],
        q: &'a mut [Packed],
    ) -> Eight;

    /// A step of Viterbi, with the logarithms of the rows, or without a move if there are none:
    /// `next` = max over j of log2 A\[i, j\] + `x[j]`, plus the likelihood of i minus the shift of
    /// its lane; `from[i]` the lowest j that attains it. Returns the largest of `next`.
    pub fn batch_max = maximize<'a>(
        log2: Option<Lines<'a>>, x: &'a [Packed], likelihoods: &'a [Packed], shifts: Eight,
        next: &'a mut [Packed], from: &'a mut [[u32; LANES]],
    ) -> Eight;
}

#[inline(always)]
fn forward<S: Simd>(
    s: S,
    matrix: Option<Lines<'_>>,
    x: &[Packed],
    likelihoods: &[Packed],
    out: &mut [Packed],
) -> Eight {
    let n = x.len();
    // One length for all slices: indices below n need no check in the sink.
    let (likelihoods, out) = (&likelihoods[..n], &mut out[..n]);
    let mut sink = ForwardSink::<S> { likelihoods, out, sum: s.splat(0.0) };
    if let Some(matrix) = matrix {
        matrix.product(s, SumProduct, x, &mut sink);
    } else {
        // A prior at the first observation: nothing moves before it.
        for (i, x) in x.iter().enumerate() {
            sink.take(s, i, s.load(x));
        }
    }
    s.to_array(sink.sum)
}

struct ForwardSink<'a, S: Simd> {
    likelihoods: &'a [Packed],
    out: &'a mut [Packed],
    sum: S::V,
}

impl<S: Simd> Sink<S, S::V> for ForwardSink<'_, S> {
    #[inline(always)]
    fn take(&mut self, s: S, i: usize, p: S::V) {
        let after = s.mul(p, s.load(&self.likelihoods[i]));
        s.store(after, &mut self.out[i]);
        self.sum = s.add(self.sum, after);
    }
}

#[inline(always)]
fn normalize<S: Simd>(s: S, x: &mut [Packed], out: &mut [Packed], sums: Eight) -> [bool; LANES] {
    let sums = s.load(&sums);
    let (factor, lift) = (s.div(s.splat(1.0), sums), s.splat(LIFT));
    let (least, zero) = (s.mul(s.splat(f64::MIN_POSITIVE), sums), s.splat(0.0));
    // An empty mask: 0 is below 0 in no lane.
    let mut lost = s.lt(zero, zero);
    for (x, out) in x.iter_mut().zip(out) {
        let v = s.load(x);
        let below = s.lt(v, least);
        // `limits` ("In lanes") shows that x is 0 only where a factor of it is. So a state can be
        // lost only here, where a value above 0 becomes 0.
        lost = s.or(lost, s.and(below, s.lt(zero, v)));
        let v = s.mul(s.select(below, zero, v), factor);
        s.store(v, out);
        // Exact: v is normal or 0, and 2^1000 v is in range.
        s.store(s.mul(v, lift), x);
    }
    flags(s.bits(lost))
}

#[inline(always)]
fn divide<S: Simd>(
    s: S,
    q: &[Packed],
    likelihoods: &[Packed],
    factors: Eight,
    ratio: &mut [Packed],
) {
    let factors = s.load(&factors);
    for ((ratio, q), b) in ratio.iter_mut().zip(q).zip(likelihoods) {
        s.store(divided(s, s.load(q), s.load(b), factors), ratio);
    }
}

#[inline(always)]
fn backward<S: Simd>(
    s: S,
    columns: Lines<'_>,
    factors: Eight,
    ratio: &[Packed],
    alpha: &mut [Packed],
    q: &mut [Packed],
) -> Eight {
    let (n, zero) = (ratio.len(), s.splat(0.0));
    // Lanes that have ended before this step, or were given up, have the factor 0. Their ratio is
    // 0, and α must stay: at its end a sequence has γ_T = α_T.
    let continues = s.lt(zero, s.load(&factors));
    let (alpha, q) = (&mut alpha[..n], &mut q[..n]);
    let mut sink = BackwardSink::<S> { alpha, q, continues, sum: zero };
    columns.product(s, SumProduct, ratio, &mut sink);
    s.to_array(sink.sum)
}

struct BackwardSink<'a, S: Simd> {
    alpha: &'a mut [Packed],
    q: &'a mut [Packed],
    continues: S::M,
    sum: S::V,
}

impl<S: Simd> Sink<S, S::V> for BackwardSink<'_, S> {
    #[inline(always)]
    fn take(&mut self, s: S, j: usize, q: S::V) {
        let alpha = s.load(&self.alpha[j]);
        let gamma = smoothed(s, alpha, q);
        // In place: α of this step is not read again on the way back.
        s.store(q, &mut self.q[j]);
        s.store(s.select(self.continues, gamma, alpha), &mut self.alpha[j]);
        self.sum = s.add(self.sum, gamma);
    }
}

#[inline(always)]
fn count<S: Simd>(
    s: S,
    columns: Lines<'_>,
    alpha: &[Packed],
    ratio: &[Packed],
    counts: &mut [Packed],
) {
    // α(j) A[i, j] γ(i) / p(i) without A[i, j], which is constant over the steps and is multiplied
    // in once, at the end (formula 4 of the guide).
    if let Lines::Sparse { starts, indices, .. } = columns {
        for (alpha, line) in alpha.iter().zip(starts.windows(2)) {
            let (alpha, line) = (s.load(alpha), line[0] as usize..line[1] as usize);
            let counts = indices[line.clone()].iter().zip(&mut counts[line]);
            for (i, count) in counts {
                let more = s.mul(alpha, s.load(&ratio[*i as usize]));
                s.store(s.add(s.load(count), more), count);
            }
        }
    } else {
        // Counts are laid out as the values are; those of padding stay 0, as `zip` ends before them.
        let stride = counts.len() / ratio.len();
        for (alpha, counts) in alpha.iter().zip(counts.chunks_exact_mut(stride)) {
            let alpha = s.load(alpha);
            for (ratio, count) in ratio.iter().zip(counts) {
                s.store(s.add(s.load(count), s.mul(alpha, s.load(ratio))), count);
            }
        }
    }
}

#[inline(always)]
fn maximize<S: Simd>(
    s: S,
    log2: Option<Lines<'_>>,
    x: &[Packed],
    likelihoods: &[Packed],
    shifts: Eight,
    next: &mut [Packed],
    from: &mut [[u32; LANES]],
) -> Eight {
    let n = x.len();
    let (likelihoods, next) = (&likelihoods[..n], &mut next[..n]);
    let (shifts, largest) = (s.load(&shifts), s.splat(f64::NEG_INFINITY));
    let mut sink = MaxSink::<S> { likelihoods, shifts, next, from, largest };
    if let Some(log2) = log2 {
        log2.product(s, MaxPlus, x, &mut sink);
    } else {
        for (i, x) in x.iter().enumerate() {
            sink.take(s, i, Maxima { value: s.load(x), index: s.iota(0) });
        }
    }
    s.to_array(sink.largest)
}

struct MaxSink<'a, S: Simd> {
    likelihoods: &'a [Packed],
    shifts: S::V,
    next: &'a mut [Packed],
    from: &'a mut [[u32; LANES]],
    largest: S::V,
}

impl<S: Simd> Sink<S, Maxima<S>> for MaxSink<'_, S> {
    #[inline(always)]
    fn take(&mut self, s: S, i: usize, best: Maxima<S>) {
        // The shift is subtracted from the likelihood first, as in `Scores::block`: beyond the range
        // of exact sums, too, scores are those of single sequences to the bit.
        let score = s.add(best.value, s.sub(s.load(&self.likelihoods[i]), self.shifts));
        s.store(score, &mut self.next[i]);
        if let Some(from) = self.from.get_mut(i) {
            s.store_indices(best.index, from);
        }
        self.largest = s.max(score, self.largest);
    }
}
