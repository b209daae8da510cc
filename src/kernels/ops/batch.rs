//! Steps of eight chains side by side, one in each lane: a vector of states is a slice of vectors
//! of eight, and a product with a matrix needs no gathers.

use super::backward::{divided, smoothed};
use super::packing::flags;
use super::semiring::{MaxPlus, Maxima, Semiring, Sink, SumProduct};
use crate::kernels::layout::Packed;
use crate::kernels::simd::{Eight, LANES, Simd, kernels};
use crate::limits::LIFT;

/// Number of lines of a dense matrix that share the loads of a vector.
const BLOCK: usize = 4;

/// Lines of a matrix: rows for A, columns for A'.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Lines<'a> {
    /// Line i has the entries from `starts[i]` to `starts[i + 1]`.
    Sparse { starts: &'a [u32], indices: &'a [u32], values: &'a [f64] },
    /// Entry j of line i is at i s + j, where n s is the number of values.
    Dense { values: &'a [f64] },
    /// Entry j of line i is at j s + i.
    DenseTransposed { values: &'a [f64] },
}

impl<'a> Lines<'a> {
    /// Replaces the values.
    pub(crate) fn with_values(self, values: &'a [f64]) -> Self {
        match self {
            Self::Sparse { starts, indices, .. } => Self::Sparse { starts, indices, values },
            Self::Dense { .. } => Self::Dense { values },
            Self::DenseTransposed { .. } => Self::DenseTransposed { values },
        }
    }

    /// All values that are stored.
    pub(crate) fn values(self) -> &'a [f64] {
        match self {
            Self::Sparse { values, .. }
            | Self::Dense { values }
            | Self::DenseTransposed { values } => values,
        }
    }

    /// Passes the product of each line with x to a sink, in order.
    #[inline(always)]
    fn product<S: Simd, R: Semiring<S>>(
        self,
        s: S,
        ring: R,
        x: &[Packed],
        sink: &mut impl Sink<S, R::Sum>,
    ) {
        match self {
            Self::Sparse { starts, indices, values } => {
                let mut start = 0;
                for (i, end) in starts[1..].iter().enumerate() {
                    let end = *end as usize;
                    let mut sum = ring.zero(s);
                    for (j, value) in indices[start..end].iter().zip(&values[start..end]) {
                        let (x, index) = (s.load(&x[*j as usize]), s.load_indices(&[*j; LANES]));
                        ring.add(s, &mut sum, s.splat(*value), x, index);
                    }
                    start = end;
                    sink.take(s, i, sum);
                }
            }
            Self::Dense { values } => in_blocks(x.len(), |i, count| match count {
                BLOCK => dense::<S, R, BLOCK>(s, ring, values, x, i, sink),
                _ => dense::<S, R, 1>(s, ring, values, x, i, sink),
            }),
            Self::DenseTransposed { values } => in_blocks(x.len(), |i, count| match count {
                BLOCK => transposed::<S, R, BLOCK>(s, ring, values, x, i, sink),
                _ => transposed::<S, R, 1>(s, ring, values, x, i, sink),
            }),
        }
    }
}

/// Calls with the first line of each block of four, and of each line that is left.
#[inline(always)]
fn in_blocks(lines: usize, mut block: impl FnMut(usize, usize)) {
    let mut i = 0;
    while i < lines {
        let count = if i + BLOCK <= lines { BLOCK } else { 1 };
        block(i, count);
        i += count;
    }
}

/// Passes the products of lines from i on, which are stored one after another.
#[inline(always)]
fn dense<S: Simd, R: Semiring<S>, const B: usize>(
    s: S,
    ring: R,
    values: &[f64],
    x: &[Packed],
    i: usize,
    sink: &mut impl Sink<S, R::Sum>,
) {
    let (n, stride) = (x.len(), values.len() / x.len());
    let mut lines = [&values[..n]; B];
    for (r, line) in lines.iter_mut().enumerate() {
        *line = &values[(i + r) * stride..][..n];
    }
    let mut sums = [ring.zero(s); B];
    for j in 0..n {
        let (x, index) = (s.load(&x[j]), s.load_indices(&[j as u32; LANES]));
        for r in 0..B {
            ring.add(s, &mut sums[r], s.splat(lines[r][j]), x, index);
        }
    }
    for (r, sum) in sums.into_iter().enumerate() {
        sink.take(s, i + r, sum);
    }
}

/// Passes the products of lines from i on, whose entries are stored beside each other.
#[inline(always)]
fn transposed<S: Simd, R: Semiring<S>, const B: usize>(
    s: S,
    ring: R,
    values: &[f64],
    x: &[Packed],
    i: usize,
    sink: &mut impl Sink<S, R::Sum>,
) {
    let mut sums = [ring.zero(s); B];
    for ((x, values), j) in x.iter().zip(values.chunks_exact(values.len() / x.len())).zip(0..) {
        let (x, index) = (s.load(x), s.load_indices(&[j; LANES]));
        let values: &[f64; B] = values[i..].first_chunk().expect("a line is below n");
        for r in 0..B {
            ring.add(s, &mut sums[r], s.splat(values[r]), x, index);
        }
    }
    for (r, sum) in sums.into_iter().enumerate() {
        sink.take(s, i + r, sum);
    }
}

kernels! {
    /// `out = (A x) ∘ b`, or `x ∘ b` without a matrix. Returns the sums of `out`.
    pub(crate) fn batch_forward = forward<'a>(
        matrix: Option<Lines<'a>>, x: &'a [Packed], likelihoods: &'a [Packed],
        out: &'a mut [Packed],
    ) -> Eight;

    /// Makes what sums to `sums` distributions in `out`, with 0 for what would be below the smallest
    /// normal double, and lifted ones in place. Returns the lanes in which something became 0.
    pub(crate) fn batch_normalize = normalize<'a>(
        x: &'a mut [Packed], out: &'a mut [Packed], sums: Eight,
    ) -> [bool; LANES];

    /// First half of a step back: `ratio = q ∘ b` times a factor.
    pub(crate) fn batch_ratio = divide<'a>(
        q: &'a [Packed], likelihoods: &'a [Packed], factors: Eight, ratio: &'a mut [Packed],
    ) -> ();

    /// Adds α(j) times the ratio at i to the count of each entry i of each column j.
    pub(crate) fn count_moves = count<'a>(
        columns: Lines<'a>, alpha: &'a [Packed], ratio: &'a [Packed], counts: &'a mut [Packed],
    ) -> ();

    /// Second half of a step back, over the columns: `q` = A' times the ratio, and α becomes
    /// γ = α ∘ q, but in lanes with the factor 0. Returns Σ γᵢ.
    pub(crate) fn batch_backward = backward<'a>(
        columns: Lines<'a>, factors: Eight, ratio: &'a [Packed], alpha: &'a mut [Packed],
        q: &'a mut [Packed],
    ) -> Eight;

    /// A step of Viterbi, by the logarithms of the rows; without them nothing moves: `next` = max
    /// over j of log2 A\[i, j\] + `x[j]`, plus the likelihood of i, which is to be lowered by the
    /// shift of its lane; `from[i]` the lowest j that attains it. Returns the largest of `next`.
    pub(crate) fn batch_max = maximize<'a>(
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
    let (likelihoods, out) = (&likelihoods[..n], &mut out[..n]);
    let mut sink = ForwardSink::<S> { likelihoods, out, sum: s.splat(0.0) };
    if let Some(matrix) = matrix {
        matrix.product(s, SumProduct, x, &mut sink);
    } else {
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
    let mut lost = s.lt(zero, zero);
    for (x, out) in x.iter_mut().zip(out) {
        let v = s.load(x);
        let below = s.lt(v, least);
        lost = s.or(lost, s.and(below, s.lt(zero, v)));
        let v = s.mul(s.select(below, zero, v), factor);
        s.store(v, out);
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
        let score = s.add(best.value, s.sub(s.load(&self.likelihoods[i]), self.shifts));
        s.store(score, &mut self.next[i]);
        if let Some(from) = self.from.get_mut(i) {
            s.store_indices(best.index, from);
        }
        self.largest = s.max(score, self.largest);
    }
}
