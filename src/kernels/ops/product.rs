//! Products with a vector, passed on eight rows at a time.

use std::ops::Range;

use super::semiring::Sink;
use crate::kernels::layout::Sliced;
use crate::kernels::parallel::{Splits, run_in_parts};
use crate::kernels::simd::{LANES, Simd, WithSimd};

/// Product with a vector, or some of its rows.
#[derive(Debug, Clone)]
pub(crate) enum Product<'a> {
    /// With a stochastic matrix that is stored, and a distribution.
    Sparse { matrix: &'a Sliced, x: &'a [f64], rows: Range<usize> },
    /// Computed elsewhere, and not known to be that of a distribution.
    Computed(&'a [f64]),
}

impl<'a> Product<'a> {
    pub(crate) fn sparse(matrix: &'a Sliced, x: &'a [f64]) -> Self {
        Self::Sparse { matrix, x, rows: 0..matrix.lines() }
    }

    #[inline(always)]
    pub(super) fn rows(&self) -> usize {
        match self {
            Self::Sparse { rows, .. } => rows.len(),
            Self::Computed(product) => product.len(),
        }
    }

    /// Splits at a multiple of eight.
    pub(super) fn split(self, at: usize) -> (Self, Self) {
        match self {
            Self::Sparse { matrix, x, rows } => {
                let middle = rows.start + at;
                let part = |rows| Self::Sparse { matrix, x, rows };
                (part(rows.start..middle), part(middle..rows.end))
            }
            Self::Computed(product) => {
                let (first, second) = product.split_at(at);
                (Self::Computed(first), Self::Computed(second))
            }
        }
    }

    /// Passes each block to a sink, numbered from the first of these rows.
    #[inline(always)]
    pub(super) fn pass_to<S: Simd>(self, s: S, sink: &mut impl Sink<S, S::V>) {
        match self {
            Self::Sparse { matrix, x, rows } => {
                matrix.product(s, rows.start / LANES..rows.end.div_ceil(LANES), x, sink);
            }
            Self::Computed(product) => {
                let (blocks, rest) = product.as_chunks::<LANES>();
                for (number, block) in blocks.iter().enumerate() {
                    sink.take(s, number, s.load(block));
                }
                if !rest.is_empty() {
                    sink.take(s, blocks.len(), s.load_partial(rest));
                }
            }
        }
    }
}

impl Sliced {
    /// Computes the product with x.
    pub(crate) fn multiply(&self, x: &[f64], out: &mut [f64]) {
        assert_eq!(out.len(), self.lines(), "out must have one value per state");
        run_in_parts(StoreProduct { product: Product::sparse(self, x), out });
    }
}

/// `out` = a product.
pub(in crate::kernels) struct StoreProduct<'a> {
    pub(in crate::kernels) product: Product<'a>,
    pub(in crate::kernels) out: &'a mut [f64],
}

impl WithSimd for StoreProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Product::Sparse { matrix, x, rows } = self.product else { return };
        let blocks = rows.start / LANES..rows.end.div_ceil(LANES);
        matrix.product(s, blocks, x, &mut self.out.as_chunks_mut());
    }
}

impl Splits for StoreProduct<'_> {
    fn lines(&self) -> usize {
        self.out.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (product, (out, out_rest)) = (self.product.split(at), self.out.split_at_mut(at));
        (Self { product: product.0, out }, Self { product: product.1, out: out_rest })
    }

    fn join((): (), (): ()) {}
}
