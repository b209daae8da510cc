//! Products A x and A' x of formulas 2 and 3 of the guide, passed on eight rows at a time, so that
//! what follows a product in a step needs no pass of its own.
//!
//! Blocks come in the order of rows. Parts begin at multiples of [`PART`](crate::parallel),
//! which are multiples of eight and of windows.

use super::row_sums::Sink;
use crate::layout::Sliced;
use crate::parallel::{Splits, run_in_parts};
use crate::simd::{LANES, Simd, WithSimd};

/// Product with a vector, for a step of the filter or the smoother.
#[derive(Debug, Clone, Copy)]
pub enum Product<'a> {
    /// Product of a stored stochastic matrix with a distribution.
    Sparse { matrix: &'a Sliced, x: &'a [f64] },
    /// Product that was computed elsewhere, and need not sum to one.
    Computed(&'a [f64]),
}

/// Rows of a product that a kernel takes. (A kernel is generic over this rather than holding the
/// enum: less to copy for a step of few states.)
pub(crate) trait ProductRows: Copy + Send {
    /// True if the product is known to be that of a distribution.
    const KNOWN: bool;

    fn rows(self) -> usize;

    /// Splits at a multiple of eight.
    fn split(self, at: usize) -> (Self, Self);

    /// Passes each block to a sink, numbered from the first of these rows.
    fn pass_to<S: Simd>(self, s: S, sink: &mut impl Sink<S, S::V>);
}

/// Product of some rows of a sparse matrix with x.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SparseRows<'a> {
    matrix: &'a Sliced,
    x: &'a [f64],
    /// The first row, a multiple of eight, and the end.
    first: usize,
    end: usize,
}

impl<'a> SparseRows<'a> {
    #[inline(always)]
    pub(crate) fn all(matrix: &'a Sliced, x: &'a [f64]) -> Self {
        Self { matrix, x, first: 0, end: matrix.lines() }
    }
}

impl ProductRows for SparseRows<'_> {
    const KNOWN: bool = true;

    #[inline(always)]
    fn rows(self) -> usize {
        self.end - self.first
    }

    fn split(self, at: usize) -> (Self, Self) {
        // Both parts read all of x: only rows are divided.
        let middle = self.first + at;
        (Self { end: middle, ..self }, Self { first: middle, ..self })
    }

    #[inline(always)]
    fn pass_to<S: Simd>(self, s: S, sink: &mut impl Sink<S, S::V>) {
        // The end is rounded up: lanes beyond the last row have no entries, and sinks do not store
        // them.
        self.matrix.product(s, self.first / LANES..self.end.div_ceil(LANES), self.x, sink);
    }
}

impl ProductRows for &[f64] {
    const KNOWN: bool = false;

    #[inline(always)]
    fn rows(self) -> usize {
        self.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        self.split_at(at)
    }

    #[inline(always)]
    fn pass_to<S: Simd>(self, s: S, sink: &mut impl Sink<S, S::V>) {
        // Not known to sum to one: the sink sums it and looks for negative values.
        let (blocks, rest) = self.as_chunks::<LANES>();
        for (number, block) in blocks.iter().enumerate() {
            sink.take(s, number, s.load(block));
        }
        // Only the last part can have a rest: the length of any other is a multiple of eight.
        if !rest.is_empty() {
            sink.take(s, blocks.len(), s.load_partial(rest));
        }
    }
}

impl Sliced {
    /// Computes the product with x.
    pub fn multiply(&self, x: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.lines(), "out must have one value per state");
        // `product` checks the length of x, this assertion that of the result.
        run_in_parts(StoreProduct { product: SparseRows::all(self, x), out });
    }
}

/// `out` = a product.
struct StoreProduct<'a, P> {
    product: P,
    out: &'a mut [f64],
}

impl<P: ProductRows> WithSimd for StoreProduct<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.product.pass_to(s, &mut self.out.as_chunks_mut());
    }
}

impl<P: ProductRows> Splits for StoreProduct<'_, P> {
    fn lines(&self) -> usize {
        self.out.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (product, (out, out_rest)) = (self.product.split(at), self.out.split_at_mut(at));
        (Self { product: product.0, out }, Self { product: product.1, out: out_rest })
    }

    fn join((): (), (): ()) {}
}
