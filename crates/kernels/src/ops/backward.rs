//! A backward step of the smoother, formula 3 of the guide ("Two products or three"): with
//! q = γ / α and the ratio r = γ / p,
//!
//! ```text
//! r = q ∘ b / N     q' = A' r     γ' = α ∘ q'
//! ```
//!
//! r and q are lifted by 2^700, and become infinite if they exceed 2^324 unlifted: then Σ γ' is not
//! one, which the caller tests (`limits`, "The way back").

use crate::layout::{Product, ProductRows, Sink, SparseRows};
use crate::limits::BACK_LIFT;
use crate::simd::{
    Blocks, BlocksMut, LANES, Simd, WithSimd, row_block, row_block_ahead, store, total,
};
use crate::simd::{Splits, run_in_parts};

/// `ratio = q ∘ b` times a factor; values whose unlifted form is below the smallest normal double
/// become 0.
struct DivideByPrediction<'a> {
    q: &'a [f64],
    likelihoods: &'a [f64],
    factor: f64,
    ratio: &'a mut [f64],
}

impl WithSimd for DivideByPrediction<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { q, likelihoods, factor, ratio } = self;
        let n = q.len();
        // One length for all: a shorter slice fails here, and none is read beyond its end.
        let (b, q) = (likelihoods[..n].as_chunks::<LANES>(), q.as_chunks::<LANES>());
        let mut ratio = ratio[..n].as_chunks_mut::<LANES>();
        // 1 / N, also divided by the previous sum of γ, so that rounding of the sums does not
        // accumulate.
        let factor = s.splat(factor);
        for block in 0..n.div_ceil(LANES) {
            let v = divided(s, row_block(s, q, block), row_block(s, b, block), factor);
            store(s, &mut ratio, block, v);
        }
    }
}

impl Splits for DivideByPrediction<'_> {
    fn lines(&self) -> usize {
        self.q.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (q, b) = (self.q.split_at(at), self.likelihoods.split_at(at));
        let ratio = self.ratio.split_at_mut(at);
        let factor = self.factor;
        let part = |q, likelihoods, ratio| Self { q, likelihoods, factor, ratio };
        (part(q.0, b.0, ratio.0), part(q.1, b.1, ratio.1))
    }

    fn join((): (), (): ()) {}
}

/// Computes γ / p, lifted, from the lifted q = γ / α: `ratio = q ∘ b` times a factor.
pub fn divide_by_prediction(q: &[f64], likelihoods: &[f64], factor: f64, ratio: &mut [f64]) {
    run_in_parts(DivideByPrediction { q, likelihoods, factor, ratio });
}

/// The second half of a step: `gamma = α ∘ q`, where q is the lifted product of A' with γ / p,
/// and is kept. Returns Σ γᵢ.
pub struct BackwardStep<'a> {
    pub product: Product<'a>,
    pub alpha: &'a [f64],
    pub gamma: &'a mut [f64],
    pub q: &'a mut [f64],
}

/// Takes the step, on several threads if there are many states.
pub fn backward_step(step: BackwardStep<'_>) -> f64 {
    let BackwardStep { product, alpha, gamma, q } = step;
    // Two kernels: the choice between kinds of product is made once, not for each block.
    match product {
        Product::Sparse { matrix, x } => {
            run_in_parts(BackwardRows { product: SparseRows::all(matrix, x), alpha, gamma, q })
        }
        Product::Computed(product) => run_in_parts(BackwardRows { product, alpha, gamma, q }),
    }
}

/// A [`BackwardStep`] with one type of product.
struct BackwardRows<'a, P> {
    product: P,
    alpha: &'a [f64],
    gamma: &'a mut [f64],
    q: &'a mut [f64],
}

impl<P: ProductRows> WithSimd for BackwardRows<'_, P> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> f64 {
        let Self { product, alpha, gamma, q } = self;
        let n = product.rows();
        let mut sink = BackwardSink::<S> {
            alpha: alpha[..n].as_chunks(),
            gamma: gamma[..n].as_chunks_mut(),
            q: q[..n].as_chunks_mut(),
            sum: s.splat(0.0),
        };
        product.pass_to(s, &mut sink);
        total(s.to_array(sink.sum))
    }
}

impl<P: ProductRows> Splits for BackwardRows<'_, P> {
    fn lines(&self) -> usize {
        self.product.rows()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (product, alpha) = (self.product.split(at), self.alpha.split_at(at));
        let (gamma, q) = (self.gamma.split_at_mut(at), self.q.split_at_mut(at));
        let part = |product, alpha, gamma, q| Self { product, alpha, gamma, q };
        (part(product.0, alpha.0, gamma.0, q.0), part(product.1, alpha.1, gamma.1, q.1))
    }

    fn join(a: f64, b: f64) -> f64 {
        // The order of these additions depends only on the number of lines (see `halves` in
        // `simd`).
        a + b
    }
}

struct BackwardSink<'a, S: Simd> {
    alpha: Blocks<'a>,
    gamma: BlocksMut<'a>,
    q: BlocksMut<'a>,
    sum: S::V,
}

impl<S: Simd> Sink<S, S::V> for BackwardSink<'_, S> {
    #[inline(always)]
    fn take(&mut self, s: S, block: usize, q: S::V) {
        let gamma = smoothed(s, row_block_ahead::<S, false>(s, self.alpha, block), q);
        // q is stored as it is, not rounded: the next step needs γ / α where γ itself is too small.
        store(s, &mut self.gamma, block, gamma);
        store(s, &mut self.q, block, q);
        self.sum = s.add(self.sum, gamma);
    }
}

/// q ∘ b times a factor; 0 where the unlifted value is too small.
#[inline(always)]
pub(super) fn divided<S: Simd>(s: S, q: S::V, b: S::V, factor: S::V) -> S::V {
    // b / N first, which is at least 2^-1030 where a state is possible, and of moderate size
    // everywhere; q ∘ b has no such bounds.
    rounded(s, s.mul(q, s.mul(b, factor)))
}

/// γ = α ∘ q, unlifted; 0 where it would be below the smallest normal double, since such numbers
/// take a hundred times as long.
#[inline(always)]
pub(super) fn smoothed<S: Simd>(s: S, alpha: S::V, q: S::V) -> S::V {
    // The lifted product has all its digits, and its unlifted value is normal or becomes 0: the
    // last multiplication is exact.
    s.mul(rounded(s, s.mul(q, alpha)), s.splat(1.0 / BACK_LIFT))
}

/// Rounds lifted values to 0 if they are below the smallest normal double when unlifted.
#[inline(always)]
fn rounded<S: Simd>(s: S, v: S::V) -> S::V {
    // A NaN is not below: it stays, and shows up in the sum.
    s.select(s.lt(v, s.splat(f64::MIN_POSITIVE * BACK_LIFT)), s.splat(0.0), v)
}
