//! Products of a matrix with eight vectors at once, one in each lane: A x and A' x of formulas 2 and
//! 3 of the guide, and max-products of formula 7, for chains side by side.
//!
//! A vector of states is a slice of vectors of eight, so that a product needs no gathers: the lanes
//! have the same index. Each sum runs over the entries of a line in order.

use crate::layout::{RowSums, Sink};
use crate::memory::Packed;
use crate::simd::{LANES, Simd};

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
