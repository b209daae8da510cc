//! Eight sequences in lock-step, one a lane: a vector of states is a slice of
//! eights, and a product with a matrix needs no gathers.

use super::LIFT;
use super::abreast::flags;
pub(crate) use super::abreast::{Abreast, gather, scatter, unravel};
use super::lanes::{Eight, Kernel, LANES, Lanes, run};
use super::retreat::BACK_LIFT;

/// How many lines of a dense matrix share the loads of a vector.
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

/// What is done with a line of a product.
trait Each<L: Lanes> {
    /// Takes line i. Implementations are `#[inline(always)]`.
    fn line(&mut self, lanes: L, i: usize, product: L::V);
}

impl<'a> Lines<'a> {
    /// Other values at the same places.
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

    /// Hands over the product of each line with x, in order.
    #[inline(always)]
    fn each<L: Lanes>(self, lanes: L, x: &[Abreast], each: &mut impl Each<L>) {
        let n = x.len();
        match self {
            Self::Sparse { starts, indices, values } => {
                let mut start = 0;
                for (i, end) in starts[1..].iter().enumerate() {
                    let end = *end as usize;
                    let mut sum = lanes.splat(0.0);
                    for (j, value) in indices[start..end].iter().zip(&values[start..end]) {
                        let x = lanes.load(&x[*j as usize]);
                        sum = lanes.add(sum, lanes.mul(lanes.splat(*value), x));
                    }
                    start = end;
                    each.line(lanes, i, sum);
                }
            }
            Self::Dense { values } => {
                let stride = values.len() / n;
                let mut i = 0;
                while i + BLOCK <= n {
                    dense::<L, BLOCK>(lanes, &values[i * stride..], stride, x, i, each);
                    i += BLOCK;
                }
                while i < n {
                    dense::<L, 1>(lanes, &values[i * stride..], stride, x, i, each);
                    i += 1;
                }
            }
            Self::DenseTransposed { values } => {
                let mut i = 0;
                while i + BLOCK <= n {
                    transposed::<L, BLOCK>(lanes, values, x, i, each);
                    i += BLOCK;
                }
                while i < n {
                    transposed::<L, 1>(lanes, values, x, i, each);
                    i += 1;
                }
            }
        }
    }
}

/// Lines from i on, which lie one after another.
#[inline(always)]
fn dense<L: Lanes, const R: usize>(
    lanes: L,
    values: &[f64],
    stride: usize,
    x: &[Abreast],
    i: usize,
    each: &mut impl Each<L>,
) {
    let n = x.len();
    let mut lines = [&values[..n]; R];
    for (r, line) in lines.iter_mut().enumerate() {
        *line = &values[r * stride..][..n];
    }
    let mut sums = [lanes.splat(0.0); R];
    for j in 0..n {
        let x = lanes.load(&x[j]);
        for r in 0..R {
            sums[r] = lanes.add(sums[r], lanes.mul(lanes.splat(lines[r][j]), x));
        }
    }
    for (r, sum) in sums.into_iter().enumerate() {
        each.line(lanes, i + r, sum);
    }
}

/// Lines from i on, whose entries lie beside each other.
#[inline(always)]
fn transposed<L: Lanes, const R: usize>(
    lanes: L,
    values: &[f64],
    x: &[Abreast],
    i: usize,
    each: &mut impl Each<L>,
) {
    let mut sums = [lanes.splat(0.0); R];
    for (x, values) in x.iter().zip(values.chunks_exact(values.len() / x.len())) {
        let x = lanes.load(x);
        let values: &[f64; R] = values[i..].first_chunk().expect("a line is below n");
        for r in 0..R {
            sums[r] = lanes.add(sums[r], lanes.mul(lanes.splat(values[r]), x));
        }
    }
    for (r, sum) in sums.into_iter().enumerate() {
        each.line(lanes, i + r, sum);
    }
}

/// `out = (A x) ∘ b`, or `x ∘ b` without a matrix. Gives its sums.
pub(crate) struct Update<'a> {
    pub(crate) matrix: Option<Lines<'a>>,
    pub(crate) x: &'a [Abreast],
    pub(crate) likelihoods: &'a [Abreast],
    pub(crate) out: &'a mut [Abreast],
}

impl Kernel for Update<'_> {
    type Output = Eight;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Eight {
        let Self { matrix, x, likelihoods, out } = self;
        let n = x.len();
        let (likelihoods, out) = (&likelihoods[..n], &mut out[..n]);
        let mut each = UpdateEach::<L> { likelihoods, out, sum: lanes.splat(0.0) };
        if let Some(matrix) = matrix {
            matrix.each(lanes, x, &mut each);
        } else {
            for (i, x) in x.iter().enumerate() {
                each.line(lanes, i, lanes.load(x));
            }
        }
        lanes.to_array(each.sum)
    }
}

struct UpdateEach<'a, L: Lanes> {
    likelihoods: &'a [Abreast],
    out: &'a mut [Abreast],
    sum: L::V,
}

impl<L: Lanes> Each<L> for UpdateEach<'_, L> {
    #[inline(always)]
    fn line(&mut self, lanes: L, i: usize, p: L::V) {
        let after = lanes.mul(p, lanes.load(&self.likelihoods[i]));
        lanes.store(after, &mut self.out[i]);
        self.sum = lanes.add(self.sum, after);
    }
}

/// Makes what sums to `sums` distributions in `out`, and lifted ones in place. What
/// would be below the smallest normal double becomes 0. Gives in which lanes
/// something did.
struct Settle<'a> {
    pub(crate) x: &'a mut [Abreast],
    pub(crate) out: &'a mut [Abreast],
    pub(crate) sums: Eight,
}

impl Kernel for Settle<'_> {
    type Output = [bool; LANES];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> [bool; LANES] {
        let Self { x, out, sums } = self;
        let (factor, lift) = (lanes.load(&sums.map(|sum| 1.0 / sum)), lanes.splat(LIFT));
        let least = lanes.load(&sums.map(|sum| f64::MIN_POSITIVE * sum));
        let zero = lanes.splat(0.0);
        let mut lost = lanes.less(zero, zero);
        for (x, out) in x.iter_mut().zip(out) {
            let v = lanes.load(x);
            let below = lanes.less(v, least);
            lost = lanes.or(lost, lanes.and(below, lanes.less(zero, v)));
            let v = lanes.mul(lanes.select(below, zero, v), factor);
            lanes.store(v, out);
            lanes.store(lanes.mul(v, lift), x);
        }
        flags(lanes, lost)
    }
}

/// A step back: `ratio = q ∘ b` times a factor, then `q` = A' times that, and
/// `gamma = α ∘ q`, or α in lanes with the factor 0. Gives Σ γᵢ.
pub(crate) struct Retreat<'a> {
    /// The columns.
    pub(crate) matrix: Lines<'a>,
    pub(crate) likelihoods: &'a [Abreast],
    pub(crate) factors: Eight,
    pub(crate) alpha: &'a [Abreast],
    pub(crate) q: &'a mut [Abreast],
    pub(crate) ratio: &'a mut [Abreast],
    pub(crate) gamma: &'a mut [Abreast],
}

impl Kernel for Retreat<'_> {
    type Output = Eight;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Eight {
        let Self { matrix, likelihoods, factors, alpha, q, ratio, gamma } = self;
        let (factors, zero) = (lanes.load(&factors), lanes.splat(0.0));
        let least = lanes.splat(f64::MIN_POSITIVE * BACK_LIFT);
        for ((ratio, q), b) in ratio.iter_mut().zip(&*q).zip(likelihoods) {
            let v = lanes.mul(lanes.load(q), lanes.mul(lanes.load(b), factors));
            lanes.store(lanes.select(lanes.less(v, least), zero, v), ratio);
        }
        let n = ratio.len();
        let mut each = RetreatEach::<L> {
            alpha: &alpha[..n],
            q: &mut q[..n],
            gamma: &mut gamma[..n],
            goes: lanes.less(zero, factors),
            unlift: lanes.splat(1.0 / BACK_LIFT),
            least,
            sum: zero,
        };
        matrix.each(lanes, ratio, &mut each);
        lanes.to_array(each.sum)
    }
}

struct RetreatEach<'a, L: Lanes> {
    alpha: &'a [Abreast],
    q: &'a mut [Abreast],
    gamma: &'a mut [Abreast],
    goes: L::M,
    unlift: L::V,
    least: L::V,
    sum: L::V,
}

impl<L: Lanes> Each<L> for RetreatEach<'_, L> {
    #[inline(always)]
    fn line(&mut self, lanes: L, j: usize, q: L::V) {
        // Made 0 before it is too small, as for one sequence.
        let alpha = lanes.load(&self.alpha[j]);
        let v = lanes.mul(q, alpha);
        let kept = lanes.select(lanes.less(v, self.least), lanes.splat(0.0), v);
        let kept = lanes.mul(kept, self.unlift);
        lanes.store(q, &mut self.q[j]);
        lanes.store(lanes.select(self.goes, kept, alpha), &mut self.gamma[j]);
        self.sum = lanes.add(self.sum, kept);
    }
}

/// Adds α(j) times the ratio at i to the count of each entry i of each line j.
struct Count<'a> {
    /// The columns.
    matrix: Lines<'a>,
    alpha: &'a [Abreast],
    ratio: &'a [Abreast],
    counts: &'a mut [Abreast],
}

impl Kernel for Count<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { matrix, alpha, ratio, counts } = self;
        match matrix {
            Lines::Sparse { starts, indices, .. } => {
                for (alpha, line) in alpha.iter().zip(starts.windows(2)) {
                    let (alpha, line) = (lanes.load(alpha), line[0] as usize..line[1] as usize);
                    for (i, count) in indices[line.clone()].iter().zip(&mut counts[line]) {
                        let more = lanes.mul(alpha, lanes.load(&ratio[*i as usize]));
                        lanes.store(lanes.add(lanes.load(count), more), count);
                    }
                }
            }
            Lines::Dense { .. } | Lines::DenseTransposed { .. } => {
                let stride = counts.len() / ratio.len();
                for (alpha, line) in alpha.iter().zip(counts.chunks_exact_mut(stride)) {
                    let alpha = lanes.load(alpha);
                    for (ratio, count) in ratio.iter().zip(line) {
                        let more = lanes.mul(alpha, lanes.load(ratio));
                        lanes.store(lanes.add(lanes.load(count), more), count);
                    }
                }
            }
        }
    }
}

/// [`Count`] with the instructions chosen.
pub(crate) fn count(
    matrix: Lines<'_>,
    alpha: &[Abreast],
    ratio: &[Abreast],
    counts: &mut [Abreast],
) {
    run(Count { matrix, alpha, ratio, counts });
}

/// [`Update`] with the instructions chosen.
pub(crate) fn update(work: Update<'_>) -> Eight {
    run(work)
}

/// [`Settle`] with the instructions chosen.
pub(crate) fn settle(x: &mut [Abreast], out: &mut [Abreast], sums: Eight) -> [bool; LANES] {
    run(Settle { x, out, sums })
}

/// [`Retreat`] with the instructions chosen.
pub(crate) fn retreat(work: Retreat<'_>) -> Eight {
    run(work)
}
