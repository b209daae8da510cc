//! Element by element on the eight lines at hand, while their product is still in
//! registers: the second half of a step of filter and smoother.

use std::marker::PhantomData;

use super::lanes::{Eight, Kernel, LANES, Lanes, run};
use super::sliced::Sliced;
use super::{LIFT, total};

/// A product with a vector, eight lines after eight.
pub(crate) trait Product: Copy {
    /// Whether it is known to be one of a distribution, with a stochastic matrix.
    const KNOWN: bool;

    /// The number of lines.
    fn lines(self) -> usize;

    /// Hands each eight over; lines beyond the last have 0.
    fn each<L: Lanes>(self, lanes: L, each: &mut impl Each<L>);
}

/// What is done with eight lines of a product. (A closure might not become part
/// of the function that may use the instructions.)
pub(crate) trait Each<L: Lanes> {
    /// Takes those with this number. Implementations are `#[inline(always)]`.
    fn eight(&mut self, lanes: L, number: usize, product: L::V);
}

/// One that has been made.
#[derive(Clone, Copy)]
pub(crate) struct Made<'a>(pub(crate) &'a [f64]);

impl Product for Made<'_> {
    const KNOWN: bool = false;

    #[inline(always)]
    fn lines(self) -> usize {
        self.0.len()
    }

    #[inline(always)]
    fn each<L: Lanes>(self, lanes: L, each: &mut impl Each<L>) {
        let (chunks, rest) = self.0.as_chunks::<LANES>();
        for (number, chunk) in chunks.iter().enumerate() {
            each.eight(lanes, number, lanes.load(chunk));
        }
        if !rest.is_empty() {
            each.eight(lanes, chunks.len(), lanes.load_part(rest));
        }
    }
}

/// One with a sparse matrix.
#[derive(Clone, Copy)]
pub(crate) struct Sparse<'a> {
    pub(crate) matrix: &'a Sliced,
    pub(crate) x: &'a [f64],
}

impl Product for Sparse<'_> {
    const KNOWN: bool = true;

    #[inline(always)]
    fn lines(self) -> usize {
        self.matrix.lines()
    }

    #[inline(always)]
    fn each<L: Lanes>(self, lanes: L, each: &mut impl Each<L>) {
        self.matrix.products(lanes, self.x, each);
    }
}

/// Eight values of a slice, or what is left of them.
#[inline(always)]
fn eight<L: Lanes>(lanes: L, (chunks, rest): (&[Eight], &[f64]), number: usize) -> L::V {
    match chunks.get(number) {
        Some(chunk) => lanes.load(chunk),
        None => lanes.load_part(rest),
    }
}

/// Writes eight values to a slice, or what there is room for.
#[inline(always)]
fn put<L: Lanes>(lanes: L, (chunks, rest): (&mut [Eight], &mut [f64]), number: usize, v: L::V) {
    match chunks.get_mut(number) {
        Some(chunk) => lanes.store(v, chunk),
        None => lanes.store_part(v, rest),
    }
}

/// `out = p ∘ b` for a prediction p that sums to `lift`.
pub(crate) struct Update<'a, P> {
    pub(crate) prediction: P,
    pub(crate) lift: f64,
    pub(crate) likelihoods: &'a [f64],
    /// Whether the likelihoods have been scaled, so that one of 0 may have been
    /// above.
    pub(crate) scaled: bool,
    pub(crate) out: &'a mut [f64],
}

/// What an [`Update`] has seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Updated {
    /// Σ pᵢ bᵢ. NaN or infinite if a likelihood is.
    pub(crate) products: f64,
    /// Σ pᵢ.
    pub(crate) predicted: f64,
    /// Whether a value is below 0.
    pub(crate) negative_predicted: bool,
    pub(crate) negative_likelihood: bool,
    /// The largest bᵢ.
    pub(crate) largest_likelihood: f64,
    /// Whether a result is below 2^-1000 of the lift, though neither of its
    /// factors is 0.
    pub(crate) small: bool,
}

impl<P: Product> Kernel for Update<'_, P> {
    type Output = Updated;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Updated {
        let Self { prediction, lift, likelihoods, scaled, out } = self;
        let n = prediction.lines();
        let (likelihoods, out) = (&likelihoods[..n], &mut out[..n]);
        let zero = lanes.splat(0.0);
        let mut each = UpdateEach::<L, P> {
            likelihoods: likelihoods.as_chunks(),
            out: out.as_chunks_mut(),
            least: lanes.splat(lift / LIFT),
            possible: lanes.splat(if scaled { 1.0 } else { 0.0 }),
            products: zero,
            predicted: zero,
            negative_predicted: lanes.less(zero, zero),
            negative_likelihood: lanes.less(zero, zero),
            largest_likelihood: zero,
            small: false,
            product: PhantomData,
        };
        prediction.each(lanes, &mut each);
        let largest = lanes.to_array(each.largest_likelihood);
        Updated {
            products: total(lanes.to_array(each.products)),
            predicted: if P::KNOWN { lift } else { total(lanes.to_array(each.predicted)) },
            negative_predicted: lanes.any(each.negative_predicted),
            negative_likelihood: lanes.any(each.negative_likelihood),
            largest_likelihood: largest.into_iter().fold(0.0, |a, b| if b > a { b } else { a }),
            small: each.small,
        }
    }
}

struct UpdateEach<'a, L: Lanes, P> {
    likelihoods: (&'a [Eight], &'a [f64]),
    out: (&'a mut [Eight], &'a mut [f64]),
    least: L::V,
    possible: L::V,
    products: L::V,
    predicted: L::V,
    negative_predicted: L::M,
    negative_likelihood: L::M,
    largest_likelihood: L::V,
    small: bool,
    product: PhantomData<P>,
}

impl<L: Lanes, P: Product> Each<L> for UpdateEach<'_, L, P> {
    #[inline(always)]
    fn eight(&mut self, lanes: L, number: usize, p: L::V) {
        let b = eight(lanes, self.likelihoods, number);
        let after = lanes.mul(p, b);
        put(lanes, (&mut *self.out.0, &mut *self.out.1), number, after);
        self.products = lanes.add(self.products, after);
        let zero = lanes.splat(0.0);
        if !P::KNOWN {
            self.predicted = lanes.add(self.predicted, p);
            self.negative_predicted = lanes.or(self.negative_predicted, lanes.less(p, zero));
        }
        self.negative_likelihood = lanes.or(self.negative_likelihood, lanes.less(b, zero));
        self.largest_likelihood = lanes.max(b, self.largest_likelihood);
        let below = lanes.less(after, self.least);
        if lanes.any(below) {
            let possible = lanes.min(p, lanes.max(b, self.possible));
            let possible = lanes.less(zero, possible);
            self.small |= lanes.any(lanes.and(below, possible));
        }
    }
}

/// Makes what sums to `sum` a distribution, in place. Gives whether a value is
/// above 0 and below 2^-900.
pub(crate) struct Settle<'a> {
    pub(crate) x: &'a mut [f64],
    pub(crate) sum: f64,
}

impl Kernel for Settle<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> bool {
        let Self { x, sum } = self;
        let factor = lanes.splat(1.0 / sum);
        let (xs, rest) = x.as_chunks_mut::<LANES>();
        let zero = lanes.splat(0.0);
        let mut tiny = lanes.less(zero, zero);
        for x in xs {
            let v = lanes.mul(lanes.load(x), factor);
            lanes.store(v, x);
            tiny = lanes.or(tiny, is_tiny(lanes, v));
        }
        if !rest.is_empty() {
            let v = lanes.mul(lanes.load_part(rest), factor);
            lanes.store_part(v, rest);
            tiny = lanes.or(tiny, is_tiny(lanes, v));
        }
        lanes.any(tiny)
    }
}

/// 2^-900: from here on the products of a probability with an entry of at least
/// 2^-100 have all their digits without a lift.
const TINY: f64 = f64::from_bits((1023 - 900) << 52);

#[inline(always)]
fn is_tiny<L: Lanes>(lanes: L, v: L::V) -> L::M {
    lanes.and(lanes.less(v, lanes.splat(TINY)), lanes.less(lanes.splat(0.0), v))
}

/// Whether a probability is above 0 and below 2^-900.
pub(crate) fn any_tiny(x: &[f64]) -> bool {
    x.iter().any(|&x| 0.0 < x && x < TINY)
}

/// Makes what sums to `sum` a distribution, and lifts it: `x` becomes the
/// lifted one, `out` the distribution. What would be below the smallest normal
/// double becomes 0. Gives whether a value is above 0 and below 2^-900.
pub(crate) struct SettleAndLift<'a> {
    pub(crate) x: &'a mut [f64],
    pub(crate) out: &'a mut [f64],
    pub(crate) sum: f64,
}

impl Kernel for SettleAndLift<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> bool {
        let Self { x, out, sum } = self;
        let out = &mut out[..x.len()];
        let (factor, lift) = (lanes.splat(1.0 / sum), lanes.splat(LIFT));
        let (least, zero) = (lanes.splat(f64::MIN_POSITIVE * sum), lanes.splat(0.0));
        let mut tiny = lanes.less(zero, zero);
        let (xs, x_rest) = x.as_chunks_mut::<LANES>();
        let (outs, out_rest) = out.as_chunks_mut::<LANES>();
        for (x, out) in xs.iter_mut().zip(outs) {
            let v = lanes.load(x);
            let v = lanes.mul(lanes.select(lanes.less(v, least), zero, v), factor);
            lanes.store(v, out);
            lanes.store(lanes.mul(v, lift), x);
            tiny = lanes.or(tiny, is_tiny(lanes, v));
        }
        if !x_rest.is_empty() {
            let v = lanes.load_part(x_rest);
            let v = lanes.mul(lanes.select(lanes.less(v, least), zero, v), factor);
            lanes.store_part(v, out_rest);
            lanes.store_part(lanes.mul(v, lift), x_rest);
            tiny = lanes.or(tiny, is_tiny(lanes, v));
        }
        lanes.any(tiny)
    }
}

/// 2^700: lifts γ / p and γ / α, on the way back.
pub(crate) const BACK_LIFT: f64 = f64::from_bits((1023 + 700) << 52);

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

/// The second half of a step back: `gamma = α ∘ q`, where q is the lifted
/// product of A' with γ / p, and is kept. Gives Σ γᵢ.
pub(crate) struct Retreat<'a, P> {
    pub(crate) back: P,
    pub(crate) alpha: &'a [f64],
    pub(crate) gamma: &'a mut [f64],
    pub(crate) q: &'a mut [f64],
}

impl<P: Product> Kernel for Retreat<'_, P> {
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
            least: lanes.splat(f64::MIN_POSITIVE),
            sum: lanes.splat(0.0),
        };
        back.each(lanes, &mut each);
        total(lanes.to_array(each.sum))
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
        let v = lanes.mul(lanes.mul(q, eight(lanes, self.alpha, number)), self.unlift);
        let kept = lanes.select(lanes.less(v, self.least), lanes.splat(0.0), v);
        put(lanes, (&mut *self.gamma.0, &mut *self.gamma.1), number, kept);
        put(lanes, (&mut *self.q.0, &mut *self.q.1), number, q);
        self.sum = lanes.add(self.sum, kept);
    }
}

/// [`Update`] with the instructions chosen.
#[inline]
pub(crate) fn update(update: Update<'_, impl Product>) -> Updated {
    run(update)
}

/// [`Settle`] with the instructions chosen.
#[inline]
pub(crate) fn settle(x: &mut [f64], sum: f64) -> bool {
    run(Settle { x, sum })
}

/// [`SettleAndLift`] with the instructions chosen.
#[inline]
pub(crate) fn settle_and_lift(x: &mut [f64], out: &mut [f64], sum: f64) -> bool {
    run(SettleAndLift { x, out, sum })
}

/// [`Weigh`] with the instructions chosen.
#[inline]
pub(crate) fn weigh(q: &[f64], likelihoods: &[f64], factor: f64, ratio: &mut [f64]) {
    run(Weigh { q, likelihoods, factor, ratio });
}

/// [`Retreat`] with the instructions chosen.
#[inline]
pub(crate) fn retreat(back: impl Product, alpha: &[f64], gamma: &mut [f64], q: &mut [f64]) -> f64 {
    run(Retreat { back, alpha, gamma, q })
}
