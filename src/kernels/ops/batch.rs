//! Steps of eight chains side by side, one in each lane: a vector of states is a slice of vectors
//! of eight, and a product with a matrix needs no gathers.

use super::backward::smoothed;
use super::packing::flags;
use super::semiring::{MaxPlus, Maxima, Semiring, Sink, SumProduct};
use crate::kernels::layout::Packed;
use crate::kernels::simd::{Eight, LANES, Simd, WithSimd, run};
use crate::range::{BACK_LIFT, LIFT};

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

/// `out = (A x) ∘ b`, or `x ∘ b` without a matrix.
pub(crate) struct BatchForward<'a> {
    pub(crate) matrix: Option<Lines<'a>>,
    pub(crate) x: &'a [Packed],
    pub(crate) likelihoods: &'a [Packed],
    pub(crate) out: &'a mut [Packed],
}

impl WithSimd for BatchForward<'_> {
    type Output = Eight;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Eight {
        let Self { matrix, x, likelihoods, out } = self;
        let n = x.len();
        let (likelihoods, out) = (&likelihoods[..n], &mut out[..n]);
        let mut sink = BatchForwardSink::<S> { likelihoods, out, sum: s.splat(0.0) };
        if let Some(matrix) = matrix {
            matrix.product(s, SumProduct, x, &mut sink);
        } else {
            for (i, x) in x.iter().enumerate() {
                sink.take(s, i, s.load(x));
            }
        }
        s.to_array(sink.sum)
    }
}

struct BatchForwardSink<'a, S: Simd> {
    likelihoods: &'a [Packed],
    out: &'a mut [Packed],
    sum: S::V,
}

impl<S: Simd> Sink<S, S::V> for BatchForwardSink<'_, S> {
    #[inline(always)]
    fn take(&mut self, s: S, i: usize, p: S::V) {
        let after = s.mul(p, s.load(&self.likelihoods[i]));
        s.store(after, &mut self.out[i]);
        self.sum = s.add(self.sum, after);
    }
}

/// Makes what sums to `sums` distributions in `out`, with 0 for what would be below the smallest
/// normal double, and lifted ones in place. Returns the lanes in which something became 0.
struct BatchNormalize<'a> {
    x: &'a mut [Packed],
    out: &'a mut [Packed],
    sums: Eight,
}

impl WithSimd for BatchNormalize<'_> {
    type Output = [bool; LANES];

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> [bool; LANES] {
        let Self { x, out, sums } = self;
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
}

/// A step back: `ratio = q ∘ b` times a factor, then `q` = A' times that, and `gamma = α ∘ q`, or
/// α in lanes with the factor 0.
pub(crate) struct BatchBackward<'a> {
    /// The columns.
    pub(crate) matrix: Lines<'a>,
    pub(crate) likelihoods: &'a [Packed],
    pub(crate) factors: Eight,
    pub(crate) alpha: &'a [Packed],
    pub(crate) q: &'a mut [Packed],
    pub(crate) ratio: &'a mut [Packed],
    pub(crate) gamma: &'a mut [Packed],
}

impl WithSimd for BatchBackward<'_> {
    type Output = Eight;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Eight {
        let Self { matrix, likelihoods, factors, alpha, q, ratio, gamma } = self;
        let (factors, zero) = (s.load(&factors), s.splat(0.0));
        let least = s.splat(f64::MIN_POSITIVE * BACK_LIFT);
        for ((ratio, q), b) in ratio.iter_mut().zip(&*q).zip(likelihoods) {
            let v = s.mul(s.load(q), s.mul(s.load(b), factors));
            s.store(s.select(s.lt(v, least), zero, v), ratio);
        }
        let n = ratio.len();
        let (alpha, q, gamma) = (&alpha[..n], &mut q[..n], &mut gamma[..n]);
        let continues = s.lt(zero, factors);
        let mut sink = BatchBackwardSink::<S> { alpha, q, gamma, continues, sum: zero };
        matrix.product(s, SumProduct, ratio, &mut sink);
        s.to_array(sink.sum)
    }
}

struct BatchBackwardSink<'a, S: Simd> {
    alpha: &'a [Packed],
    q: &'a mut [Packed],
    gamma: &'a mut [Packed],
    continues: S::M,
    sum: S::V,
}

impl<S: Simd> Sink<S, S::V> for BatchBackwardSink<'_, S> {
    #[inline(always)]
    fn take(&mut self, s: S, j: usize, q: S::V) {
        let alpha = s.load(&self.alpha[j]);
        let gamma = smoothed(s, alpha, q);
        s.store(q, &mut self.q[j]);
        s.store(s.select(self.continues, gamma, alpha), &mut self.gamma[j]);
        self.sum = s.add(self.sum, gamma);
    }
}

/// Adds α(j) times the ratio at i to the count of each entry i of each column j.
struct CountMoves<'a> {
    columns: Lines<'a>,
    alpha: &'a [Packed],
    ratio: &'a [Packed],
    counts: &'a mut [Packed],
}

impl WithSimd for CountMoves<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { columns, alpha, ratio, counts } = self;
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
}

/// A step of Viterbi: `next` = max over j of `log2` A\[i, j\] + `x[j]`, plus the likelihood of i;
/// `from[i]` the lowest j that attains it.
pub(crate) struct BatchMax<'a> {
    /// Logarithms of the rows; without them nothing moves.
    pub(crate) log2: Option<Lines<'a>>,
    pub(crate) x: &'a [Packed],
    pub(crate) likelihoods: &'a [Packed],
    /// Amounts by which the likelihoods of each lane are to be lowered.
    pub(crate) shifts: Eight,
    pub(crate) next: &'a mut [Packed],
    pub(crate) from: &'a mut [[u32; LANES]],
}

impl WithSimd for BatchMax<'_> {
    type Output = Eight;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Eight {
        let Self { log2, x, likelihoods, shifts, next, from } = self;
        let n = x.len();
        let (likelihoods, next) = (&likelihoods[..n], &mut next[..n]);
        let (shifts, largest) = (s.load(&shifts), s.splat(f64::NEG_INFINITY));
        let mut sink = BatchMaxSink::<S> { likelihoods, shifts, next, from, largest };
        if let Some(log2) = log2 {
            log2.product(s, MaxPlus, x, &mut sink);
        } else {
            for (i, x) in x.iter().enumerate() {
                sink.take(s, i, Maxima { value: s.load(x), index: s.iota(0) });
            }
        }
        s.to_array(sink.largest)
    }
}

struct BatchMaxSink<'a, S: Simd> {
    likelihoods: &'a [Packed],
    shifts: S::V,
    next: &'a mut [Packed],
    from: &'a mut [[u32; LANES]],
    largest: S::V,
}

impl<S: Simd> Sink<S, Maxima<S>> for BatchMaxSink<'_, S> {
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

/// Runs [`BatchForward`], and returns the sums of `out`.
pub(crate) fn batch_forward(step: BatchForward<'_>) -> Eight {
    run(step)
}

/// Makes what sums to `sums` distributions in `out`, and lifted ones in place. Returns the lanes
/// in which something became 0.
pub(crate) fn batch_normalize(x: &mut [Packed], out: &mut [Packed], sums: Eight) -> [bool; LANES] {
    run(BatchNormalize { x, out, sums })
}

/// Runs [`BatchBackward`], and returns Σ γᵢ.
pub(crate) fn batch_backward(step: BatchBackward<'_>) -> Eight {
    run(step)
}

/// Adds α(j) times the ratio at i to the count of each entry i of each column j.
pub(crate) fn count_moves(
    columns: Lines<'_>,
    alpha: &[Packed],
    ratio: &[Packed],
    counts: &mut [Packed],
) {
    run(CountMoves { columns, alpha, ratio, counts });
}

/// Runs [`BatchMax`], and returns the largest of `next`.
pub(crate) fn batch_max(step: BatchMax<'_>) -> Eight {
    run(step)
}
