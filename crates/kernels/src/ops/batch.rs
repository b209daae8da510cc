//! Steps of eight chains side by side, one in each lane: formulas 2, 3 and 7 of the guide, all
//! lifted.
//!
//! Lanes never mix: each holds a sequence of its own, with its own sum, factor or shift, and if a
//! loss is noticed, its lane alone is given up. The invariants are those of "In lanes" in `limits`:
//! entries are at least 2^-100, likelihoods above 0 at least 2^-900 (`pack` has checked), and α is
//! normal or 0.
//!
//! A vector of states is a slice of vectors of eight, so that a product with [`Lines`] needs no
//! gathers: the lanes have the same index. Each sum runs over the entries of a line in order. Rows
//! are packed and unpacked by a transposition in registers for each eight values of eight rows,
//! instead of 64 moves.

use super::backward::{divided, smoothed};
use crate::layout::{Maxima, RowSums, Sink};
use crate::limits::{LIFT, TINY};
use crate::semiring::{MaxPlus, SumProduct};
use crate::simd::{Eight, LANES, Simd, kernels, row_block_ahead, store};
use crate::vector::Packed;

/// Number of lines of a dense matrix that share the loads of a vector.
const BLOCK: usize = 4;

/// Lines of a matrix: rows for A, columns for A'.
#[derive(Debug, Clone, Copy)]
pub enum Lines<'a> {
    /// Line i has the entries `starts[i]..starts[i + 1]`.
    Sparse { starts: &'a [u32], indices: &'a [u32], values: &'a [f64] },
    /// Entry j of line i is at i s + j, where n s is the number of values.
    Dense { values: &'a [f64] },
    /// Entry j of line i is at j s + i.
    DenseTransposed { values: &'a [f64] },
}

impl<'a> Lines<'a> {
    /// Replaces the values.
    pub fn with_values(self, values: &'a [f64]) -> Self {
        match self {
            Self::Sparse { starts, indices, .. } => Self::Sparse { starts, indices, values },
            Self::Dense { .. } => Self::Dense { values },
            Self::DenseTransposed { .. } => Self::DenseTransposed { values },
        }
    }

    /// All values that are stored.
    pub fn values(self) -> &'a [f64] {
        match self {
            Self::Sparse { values, .. }
            | Self::Dense { values }
            | Self::DenseTransposed { values } => values,
        }
    }

    /// Passes the product of each line with x to a sink, in order.
    #[inline(always)]
    pub(super) fn product<S: Simd, R: RowSums<S>>(
        self,
        s: S,
        ring: R,
        x: &[Packed],
        sink: &mut impl Sink<S, R::Sum>,
    ) {
        match self {
            Self::Sparse { starts, indices, values } => {
                // The end of a line is the start of the next: one load and one check for both.
                let mut start = 0;
                for (i, end) in starts[1..].iter().enumerate() {
                    let end = *end as usize;
                    let mut sum = ring.zero(s);
                    for (j, value) in indices[start..end].iter().zip(&values[start..end]) {
                        let (x, index) = (s.load(&x[*j as usize]), s.load_indices(&[*j; LANES]));
                        // Entry and index are those of all lanes. Sums of products ignore the
                        // index, and the compiler leaves it out.
                        ring.add(s, &mut sum, s.splat(*value), x, index);
                    }
                    start = end;
                    sink.take(s, i, sum);
                }
            }
            // The size of a block is constant in each arm: sums stay in registers.
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

/// Calls a function with each block of four lines, then with each line that is left.
#[inline(always)]
fn in_blocks(lines: usize, mut block: impl FnMut(usize, usize)) {
    let mut i = 0;
    while i < lines {
        let count = if i + BLOCK <= lines { BLOCK } else { 1 };
        block(i, count);
        i += count;
    }
}

/// Passes the products of the B lines that begin with line i, which are stored one after another.
#[inline(always)]
fn dense<S: Simd, R: RowSums<S>, const B: usize>(
    s: S,
    ring: R,
    values: &[f64],
    x: &[Packed],
    i: usize,
    sink: &mut impl Sink<S, R::Sum>,
) {
    // Lines may be padded, up to the stride.
    let (n, stride) = (x.len(), values.len() / x.len());
    // Slices of one length, so that indices below n need no check in the loop.
    let mut lines = [&values[..n]; B];
    for (r, line) in lines.iter_mut().enumerate() {
        *line = &values[(i + r) * stride..][..n];
    }
    let mut sums = [ring.zero(s); B];
    // Each sum runs over j in order, whatever B: blocks change no bit.
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

/// Passes the products of the B lines that begin with line i, whose entries are interleaved.
#[inline(always)]
fn transposed<S: Simd, R: RowSums<S>, const B: usize>(
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
        // `in_blocks` passes i and B with i + B <= n, which is at most the stride.
        let values: &[f64; B] = values[i..].first_chunk().expect("a line is below n");
        for r in 0..B {
            ring.add(s, &mut sums[r], s.splat(values[r]), x, index);
        }
    }
    for (r, sum) in sums.into_iter().enumerate() {
        sink.take(s, i + r, sum);
    }
}

/// Range of the packed values of each lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PackedRange {
    /// Least value, NaN aside.
    pub least: Eight,
    pub largest: Eight,
    /// True if a value is above 0 and below 2^-900.
    pub tiny: [bool; LANES],
}

kernels! {
    /// Packs rows that are at least as long as `out`: value i of lane l is `rows[l][i]`.
    pub fn pack = pack_rows<'a>(
        rows: [&'a [f64]; LANES], out: &'a mut [Packed],
    ) -> PackedRange;

    /// Unpacks values into a row for each lane. Rows beyond the length of `from` stay as they are.
    pub fn unpack = unpack_lanes<'a>(from: &'a [Packed], rows: [&'a mut [f64]; LANES]) -> ();

    /// Unpacks a sequence of vectors into rows of any numbers of whole blocks; with `stream`,
    /// stores past the caches.
    pub fn unpack_rows = unpack_blocks<'a>(
        from: &'a [Packed], rows: [&'a mut [Eight]; LANES], stream: bool,
    ) -> ();
}

#[inline(always)]
fn pack_rows<S: Simd>(s: S, rows: [&[f64]; LANES], out: &mut [Packed]) -> PackedRange {
    let zero = s.splat(0.0);
    let (mut least, mut largest) = (s.splat(f64::INFINITY), zero);
    let mut blocks = [(&[][..], &[][..]); LANES];
    // A row that is too short fails here, before anything is read.
    for l in 0..LANES {
        blocks[l] = rows[l][..out.len()].as_chunks::<LANES>();
    }
    for (number, out) in out.chunks_mut(LANES).enumerate() {
        let mut eight = [zero; LANES];
        for l in 0..LANES {
            eight[l] = row_block_ahead::<S, true>(s, blocks[l], number);
        }
        // `row_block` pads the last block with zeros. `zip` ends with `out`, before the padding.
        for (packed, out) in s.transpose(eight).into_iter().zip(out) {
            least = s.min(packed, least);
            largest = s.max(packed, largest);
            s.store(packed, out);
        }
    }
    let mut tiny = s.lt(zero, zero);
    // Zeros also compare below, and are usually the only hits. Values are read again only after a
    // hit.
    if s.any(s.lt(least, s.splat(TINY))) {
        for packed in &*out {
            tiny = s.or(tiny, s.is_small(s.load(packed), TINY));
        }
    }
    let (least, largest) = (s.to_array(least), s.to_array(largest));
    PackedRange { least, largest, tiny: flags(s.bits(tiny)) }
}

/// Bits of a mask, one for each lane.
#[inline(always)]
pub(super) fn flags(bits: u8) -> [bool; LANES] {
    let mut flags = [false; LANES];
    for (l, flag) in flags.iter_mut().enumerate() {
        *flag = bits >> l & 1 == 1;
    }
    flags
}

#[inline(always)]
fn unpack_lanes<S: Simd>(s: S, from: &[Packed], rows: [&mut [f64]; LANES]) {
    let mut outs = rows.map(|row| row[..from.len()].as_chunks_mut::<LANES>());
    for (number, from) in from.chunks(LANES).enumerate() {
        let mut eight = [s.splat(0.0); LANES];
        for (packed, from) in eight.iter_mut().zip(from) {
            *packed = s.load(from);
        }
        let lanes = s.transpose(eight);
        // The last block may be partial: `store` writes as many as the row has room for.
        for l in 0..LANES {
            store(s, &mut outs[l], number, lanes[l]);
        }
    }
}

#[inline(always)]
fn unpack_blocks<S: Simd>(s: S, from: &[Packed], rows: [&mut [Eight]; LANES], stream: bool) {
    let mut rows = rows.map(<[Eight]>::iter_mut);
    for from in from.as_chunks::<LANES>().0 {
        let mut eight = [s.splat(0.0); LANES];
        for r in 0..LANES {
            eight[r] = s.load(&from[r]);
        }
        let lanes = s.transpose(eight);
        for (row, lane) in rows.iter_mut().zip(lanes) {
            // Sequences of a group end at different steps: the row of a shorter one is full before
            // the others.
            let Some(out) = row.next() else { continue };
            // Results of large groups do not fit into the caches: fetching each line before
            // overwriting it would move twice the bytes.
            if stream {
                s.stream(lane, out);
            } else {
                s.store(lane, out);
            }
        }
    }
    // Another thread may take the results: streamed stores are not ordered otherwise.
    if stream {
        s.fence();
    }
}

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
        // `limits` ("In lanes") shows that x is 0 only where one of its factors is 0. So a state
        // can be lost only here, where a value above 0 becomes 0.
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
    // in once, at the end (section 4 of the guide's formulas).
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
        // Counts are laid out as the values are; those of padding stay 0, as `zip` ends before
        // them.
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
        // The shift is subtracted from the likelihood first, as in `Scores::block`: so even beyond
        // the range of exact sums, scores are those of single sequences to the bit.
        let score = s.add(best.value, s.sub(s.load(&self.likelihoods[i]), self.shifts));
        s.store(score, &mut self.next[i]);
        if let Some(from) = self.from.get_mut(i) {
            s.store_indices(best.index, from);
        }
        self.largest = s.max(score, self.largest);
    }
}
