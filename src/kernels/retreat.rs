//! A step of the smoother, back from one time to the one before.

use super::blocks::{Blocks, run_in_blocks};
use super::lanes::{Eight, Kernel, LANES, Lanes};
use super::product::{Each, Part, Product, eight, put};
use super::total;
pub(crate) use crate::range::BACK_LIFT;

/// `ratio = q ∘ b` times a factor; what unlifted is below the smallest normal
/// double becomes 0.
pub(crate) struct Weigh<'a> {
    pub(crate) q: &'a [f64],
    pub(crate) likelihoods: &'a [f64],
    pub(crate) factor: f64,
    pub(crate) ratio: &'a mut [f64],
}

impl Kernel for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { q, likelihoods, factor, ratio } = self;
        let n = q.len();
        let (b, q) = (likelihoods[..n].as_chunks::<LANES>(), q.as_chunks::<LANES>());
        let (ratios, rest) = ratio[..n].as_chunks_mut::<LANES>();
        let (factor, zero) = (lanes.splat(factor), lanes.splat(0.0));
        let least = lanes.splat(f64::MIN_POSITIVE * BACK_LIFT);
        for number in 0..n.div_ceil(LANES) {
            let b = lanes.mul(eight(lanes, b, number), factor);
            let v = lanes.mul(eight(lanes, q, number), b);
            let kept = lanes.select(lanes.less(v, least), zero, v);
            put(lanes, (&mut *ratios, &mut *rest), number, kept);
        }
    }
}

impl Blocks for Weigh<'_> {
    fn lines(&self) -> usize {
        self.q.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (q, likelihoods) = (self.q.split_at(at), self.likelihoods.split_at(at));
        let ratio = self.ratio.split_at_mut(at);
        let first = Self { q: q.0, likelihoods: likelihoods.0, ratio: ratio.0, ..self };
        (first, Self { q: q.1, likelihoods: likelihoods.1, ratio: ratio.1, ..self })
    }

    fn join((): (), (): ()) {}
}

/// The second half of a step back: `gamma = α ∘ q`, where q is the lifted
/// product of A' with γ / p, and is kept. Gives Σ γᵢ.
pub(crate) struct Retreat<'a, P> {
    pub(crate) back: P,
    pub(crate) alpha: &'a [f64],
    pub(crate) gamma: &'a mut [f64],
    pub(crate) q: &'a mut [f64],
}

impl<P: Product> Kernel for Retreat<'_, Part<P>> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> f64 {
        let Self { back, alpha, gamma, q } = self;
        let n = back.lines();
        let mut each = RetreatEach::<L> {
            alpha: alpha[..n].as_chunks(),
            gamma: gamma[..n].as_chunks_mut(),
            q: q[..n].as_chunks_mut(),
            unlift: lanes.splat(1.0 / BACK_LIFT),
            least: lanes.splat(f64::MIN_POSITIVE * BACK_LIFT),
            sum: lanes.splat(0.0),
        };
        back.each(lanes, &mut each);
        total(lanes.to_array(each.sum))
    }
}

impl<P: Product> Blocks for Retreat<'_, Part<P>> {
    fn lines(&self) -> usize {
        self.back.lines()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (back, alpha) = (self.back.split(at), self.alpha.split_at(at));
        let (gamma, q) = (self.gamma.split_at_mut(at), self.q.split_at_mut(at));
        let first = Self { back: back.0, alpha: alpha.0, gamma: gamma.0, q: q.0 };
        (first, Self { back: back.1, alpha: alpha.1, gamma: gamma.1, q: q.1 })
    }

    fn join(a: f64, b: f64) -> f64 {
        a + b
    }
}

struct RetreatEach<'a, L: Lanes> {
    alpha: (&'a [Eight], &'a [f64]),
    gamma: (&'a mut [Eight], &'a mut [f64]),
    q: (&'a mut [Eight], &'a mut [f64]),
    unlift: L::V,
    least: L::V,
    sum: L::V,
}

impl<L: Lanes> Each<L> for RetreatEach<'_, L> {
    #[inline(always)]
    fn eight(&mut self, lanes: L, number: usize, q: L::V) {
        // Made 0 before it is too small: numbers below the smallest normal double
        // take a hundred times as long.
        let v = lanes.mul(q, eight(lanes, self.alpha, number));
        let kept = lanes.select(lanes.less(v, self.least), lanes.splat(0.0), v);
        let kept = lanes.mul(kept, self.unlift);
        put(lanes, (&mut *self.gamma.0, &mut *self.gamma.1), number, kept);
        put(lanes, (&mut *self.q.0, &mut *self.q.1), number, q);
        self.sum = lanes.add(self.sum, kept);
    }
}

/// Does a [`Weigh`].
pub(crate) fn weigh(q: &[f64], likelihoods: &[f64], factor: f64, ratio: &mut [f64]) {
    run_in_blocks(Weigh { q, likelihoods, factor, ratio });
}

/// Does a [`Retreat`].
#[inline]
pub(crate) fn retreat<P: Product>(retreat: Retreat<'_, P>) -> f64 {
    P::retreat(retreat)
}

/// The same, for [`Product::retreat`].
#[inline(always)]
pub(super) fn retreat_with<P: Product>(retreat: Retreat<'_, P>) -> f64 {
    let Retreat { back, alpha, gamma, q } = retreat;
    run_in_blocks(Retreat { back: Part::all(back), alpha, gamma, q })
}
