//! Products with a dense matrix that is stored by columns, over either semiring.
//!
//! Each sum runs over the columns (or down them) in their order, however many are taken at a
//! time: results do not depend on the sizes of blocks.

use crate::kernels::memory::Aligned;
use crate::kernels::ops::{MaxPlus, Maxima, Semiring, SumProduct, log2_in_place};
use crate::kernels::simd::{BlocksMut, Eight, LANES, Simd, WithSimd, row_block, run, store, total};

/// Number of columns taken side by side.
const COLUMNS: usize = 8;

/// A matrix of n × n by columns, each padded to whole cache lines.
#[derive(Debug, Clone)]
pub(crate) struct Dense {
    states: usize,
    values: Aligned,
}

impl Dense {
    /// Fills a matrix, and its padding, with one value.
    pub(crate) fn filled(states: usize, value: f64) -> Self {
        let values = Aligned::new(states.next_multiple_of(LANES) * states, value);
        Self { states, values }
    }

    /// Returns the logarithms of all entries, to base 2 as decoders add them.
    pub(crate) fn log2(&self) -> Self {
        let mut logs = Self::filled(self.states, f64::NEG_INFINITY);
        for j in 0..self.states {
            logs.column_mut(j).copy_from_slice(self.column(j));
            log2_in_place(logs.column_mut(j));
        }
        logs
    }

    pub(crate) fn states(&self) -> usize {
        self.states
    }

    /// Distance between the beginnings of columns.
    pub(crate) fn stride(&self) -> usize {
        self.states.next_multiple_of(LANES)
    }

    /// All columns, with their padding.
    pub(crate) fn values(&self) -> &[f64] {
        &self.values
    }

    pub(crate) fn column(&self, j: usize) -> &[f64] {
        &self.values[j * self.stride()..][..self.states]
    }

    pub(crate) fn column_mut(&mut self, j: usize) -> &mut [f64] {
        let start = j * self.stride();
        &mut self.values[start..start + self.states]
    }

    /// `out = A x`.
    pub(crate) fn multiply(&self, x: &[f64], out: &mut [f64]) {
        assert!(x.len() == self.states && out.len() == self.states, "one value per state");
        out.fill(0.0);
        run(DenseMultiply { matrix: self, x, out });
    }

    /// `out[i]` = max over j of A\[i, j\] + `x[j]`, for logarithms, and `from[i]` the lowest j
    /// that attains it.
    pub(crate) fn maximize(&self, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        let n = self.states;
        assert!(x.len() == n && out.len() == n && from.len() == n, "one value per state");
        out.fill(f64::NEG_INFINITY);
        from.fill(0);
        run(DenseMaximize { matrix: self, x, out, from });
    }

    /// `out = A' x`.
    pub(crate) fn multiply_transpose(&self, x: &[f64], out: &mut [f64]) {
        run(DenseTranspose { matrix: self, x, out });
    }

    /// Some columns from the first on, in blocks.
    #[inline(always)]
    fn columns<const C: usize>(&self, first: usize) -> [&[Eight]; C] {
        let eights = self.states.div_ceil(LANES);
        let columns = &self.values.as_chunks().0[first * eights..(first + C) * eights];
        std::array::from_fn(|c| &columns[c * eights..(c + 1) * eights])
    }

    /// Adds all columns, each times its x, to sums in memory.
    #[inline(always)]
    fn add_columns<S: Simd, R: Semiring<S>>(
        &self,
        s: S,
        ring: R,
        x: &[f64],
        sums: &mut impl Sums<S, R::Sum>,
    ) {
        let (eights, rest) = x.as_chunks::<COLUMNS>();
        for (number, x) in eights.iter().enumerate() {
            self.add(s, ring, number * COLUMNS, x, sums);
        }
        let first = eights.len() * COLUMNS;
        let (halves, rest) = rest.as_chunks::<{ COLUMNS / 2 }>();
        for x in halves {
            self.add(s, ring, first, x, sums);
        }
        let first = x.len() - rest.len();
        for (number, x) in rest.iter().enumerate() {
            self.add(s, ring, first + number, &[*x], sums);
        }
    }

    #[inline(always)]
    fn add<S: Simd, R: Semiring<S>, const C: usize>(
        &self,
        s: S,
        ring: R,
        first: usize,
        x: &[f64; C],
        sums: &mut impl Sums<S, R::Sum>,
    ) {
        let columns = self.columns::<C>(first);
        let x: [S::V; C] = std::array::from_fn(|c| s.splat(x[c]));
        for number in 0..columns[0].len() {
            let mut sum = sums.load(s, number);
            for c in 0..C {
                let index = s.load_indices(&[(first + c) as u32; LANES]);
                ring.add(s, &mut sum, s.load(&columns[c][number]), x[c], index);
            }
            sums.store(s, number, sum);
        }
    }
}

/// Sums in memory, in blocks of eight rows.
trait Sums<S: Simd, T> {
    fn load(&self, s: S, block: usize) -> T;
    fn store(&mut self, s: S, block: usize, sum: T);
}

impl<S: Simd> Sums<S, S::V> for BlocksMut<'_> {
    #[inline(always)]
    fn load(&self, s: S, block: usize) -> S::V {
        row_block(s, (self.0, self.1), block)
    }

    #[inline(always)]
    fn store(&mut self, s: S, block: usize, sum: S::V) {
        store(s, self, block, sum);
    }
}

/// Maxima in memory, with their indices.
struct MaximaMut<'a>(BlocksMut<'a>, (&'a mut [[u32; LANES]], &'a mut [u32]));

impl<S: Simd> Sums<S, Maxima<S>> for MaximaMut<'_> {
    #[inline(always)]
    fn load(&self, s: S, block: usize) -> Maxima<S> {
        let mut last = [0; LANES];
        let indices = self.1.0.get(block).unwrap_or_else(|| {
            last[..self.1.1.len()].copy_from_slice(self.1.1);
            &last
        });
        let index = s.load_indices(indices);
        Maxima { value: self.0.load(s, block), index }
    }

    #[inline(always)]
    fn store(&mut self, s: S, block: usize, sum: Maxima<S>) {
        self.0.store(s, block, sum.value);
        store_indices(s, &mut self.1, block, sum.index);
    }
}

/// Stores indices to a block, or to the rest.
#[inline(always)]
pub(crate) fn store_indices<S: Simd>(
    s: S,
    (blocks, rest): &mut (&mut [[u32; LANES]], &mut [u32]),
    block: usize,
    indices: S::I,
) {
    if let Some(block) = blocks.get_mut(block) {
        s.store_indices(indices, block);
    } else {
        let mut last = [0; LANES];
        s.store_indices(indices, &mut last);
        rest.copy_from_slice(&last[..rest.len()]);
    }
}

pub(in crate::kernels) struct DenseMultiply<'a> {
    pub(in crate::kernels) matrix: &'a Dense,
    pub(in crate::kernels) x: &'a [f64],
    pub(in crate::kernels) out: &'a mut [f64],
}

impl WithSimd for DenseMultiply<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.matrix.add_columns(s, SumProduct, self.x, &mut self.out.as_chunks_mut());
    }
}

pub(in crate::kernels) struct DenseMaximize<'a> {
    pub(in crate::kernels) matrix: &'a Dense,
    pub(in crate::kernels) x: &'a [f64],
    pub(in crate::kernels) out: &'a mut [f64],
    pub(in crate::kernels) from: &'a mut [u32],
}

impl WithSimd for DenseMaximize<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let mut sums = MaximaMut(self.out.as_chunks_mut(), self.from.as_chunks_mut());
        self.matrix.add_columns(s, MaxPlus, self.x, &mut sums);
    }
}

pub(in crate::kernels) struct DenseTranspose<'a> {
    pub(in crate::kernels) matrix: &'a Dense,
    pub(in crate::kernels) x: &'a [f64],
    pub(in crate::kernels) out: &'a mut [f64],
}

impl WithSimd for DenseTranspose<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { matrix, x, out } = self;
        assert!(x.len() == matrix.states && out.len() == matrix.states, "one value per state");
        let (outs, rest) = out.as_chunks_mut::<COLUMNS>();
        for (number, out) in outs.iter_mut().enumerate() {
            *out = dots(s, matrix.columns(number * COLUMNS), x);
        }
        let first = outs.len() * COLUMNS;
        for (number, out) in rest.iter_mut().enumerate() {
            [*out] = dots(s, matrix.columns(first + number), x);
        }
    }
}

/// Dot products of columns with x.
#[inline(always)]
fn dots<S: Simd, const C: usize>(s: S, columns: [&[Eight]; C], x: &[f64]) -> [f64; C] {
    let x = x.as_chunks::<LANES>();
    let mut sums = [s.splat(0.0); C];
    for number in 0..columns[0].len() {
        let x = row_block(s, x, number);
        for c in 0..C {
            sums[c] = s.add(sums[c], s.mul(s.load(&columns[c][number]), x));
        }
    }
    std::array::from_fn(|c| total(s.to_array(sums[c])))
}
