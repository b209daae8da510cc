//! Element by element on the eight lines at hand, while their product is still in
//! registers: the second half of a step of filter and smoother.

use super::blocks::{Blocks, run_in_blocks};
use super::lanes::{Eight, Kernel, LANES, Lanes};
use super::product::{Each, Part, Product};
use super::{LIFT, total};

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
    /// The least pᵢ, or 0 if all are above; that of the likelihoods.
    pub(crate) least_predicted: f64,
    pub(crate) least_likelihood: f64,
    /// The largest bᵢ.
    pub(crate) largest_likelihood: f64,
    /// Whether a result is below 2^-1000 of the lift, though neither of its
    /// factors is 0.
    pub(crate) small: bool,
}

impl<P: Product> Kernel for Update<'_, Part<P>> {
    type Output = Updated;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Updated {
        let Self { prediction, lift, likelihoods, scaled, out } = self;
        let n = prediction.lines();
        let (likelihoods, out) = (&likelihoods[..n], &mut out[..n]);
        let zero = lanes.splat(0.0);
        let mut each = UpdateEach::<L> {
            likelihoods: likelihoods.as_chunks(),
            out: out.as_chunks_mut(),
            least: lanes.splat(lift / LIFT),
            possible: lanes.splat(if scaled { 1.0 } else { 0.0 }),
            products: zero,
            predicted: zero,
            least_predicted: zero,
            least_likelihood: zero,
            largest_likelihood: zero,
            small: false,
        };
        prediction.each(lanes, &mut each);
        let fold = |v, f: fn(f64, f64) -> f64| lanes.to_array(v).into_iter().fold(0.0, f);
        Updated {
            products: total(lanes.to_array(each.products)),
            predicted: total(lanes.to_array(each.predicted)),
            least_predicted: fold(each.least_predicted, f64::min),
            least_likelihood: fold(each.least_likelihood, f64::min),
            largest_likelihood: fold(each.largest_likelihood, f64::max),
            small: each.small,
        }
    }
}

impl<P: Product> Blocks for Update<'_, Part<P>> {
    fn lines(&self) -> usize {
        self.prediction.lines()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let prediction = self.prediction.split(at);
        let (likelihoods, out) = (self.likelihoods.split_at(at), self.out.split_at_mut(at));
        let first =
            Self { prediction: prediction.0, likelihoods: likelihoods.0, out: out.0, ..self };
        (first, Self { prediction: prediction.1, likelihoods: likelihoods.1, out: out.1, ..self })
    }

    fn join(a: Updated, b: Updated) -> Updated {
        Updated {
            products: a.products + b.products,
            predicted: a.predicted + b.predicted,
            least_predicted: a.least_predicted.min(b.least_predicted),
            least_likelihood: a.least_likelihood.min(b.least_likelihood),
            largest_likelihood: a.largest_likelihood.max(b.largest_likelihood),
            small: a.small | b.small,
        }
    }
}

struct UpdateEach<'a, L: Lanes> {
    likelihoods: (&'a [Eight], &'a [f64]),
    out: (&'a mut [Eight], &'a mut [f64]),
    least: L::V,
    possible: L::V,
    products: L::V,
    predicted: L::V,
    least_predicted: L::V,
    least_likelihood: L::V,
    largest_likelihood: L::V,
    small: bool,
}

impl<L: Lanes> Each<L> for UpdateEach<'_, L> {
    #[inline(always)]
    fn eight(&mut self, lanes: L, number: usize, p: L::V) {
        let b = eight(lanes, self.likelihoods, number);
        let after = lanes.mul(p, b);
        put(lanes, (&mut *self.out.0, &mut *self.out.1), number, after);
        self.products = lanes.add(self.products, after);
        self.predicted = lanes.add(self.predicted, p);
        self.least_predicted = lanes.min(p, self.least_predicted);
        self.least_likelihood = lanes.min(b, self.least_likelihood);
        self.largest_likelihood = lanes.max(b, self.largest_likelihood);
        let below = lanes.less(after, self.least);
        if lanes.any(below) {
            let possible = lanes.min(p, lanes.max(b, self.possible));
            let possible = lanes.less(lanes.splat(0.0), possible);
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

impl Blocks for Settle<'_> {
    fn lines(&self) -> usize {
        self.x.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (x, rest) = self.x.split_at_mut(at);
        (Self { x, ..self }, Self { x: rest, ..self })
    }

    fn join(a: bool, b: bool) -> bool {
        a | b
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

impl Blocks for SettleAndLift<'_> {
    fn lines(&self) -> usize {
        self.x.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (x, out) = (self.x.split_at_mut(at), self.out.split_at_mut(at));
        (Self { x: x.0, out: out.0, ..self }, Self { x: x.1, out: out.1, ..self })
    }

    fn join(a: bool, b: bool) -> bool {
        a | b
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
            least: lanes.splat(f64::MIN_POSITIVE),
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
        let v = lanes.mul(lanes.mul(q, eight(lanes, self.alpha, number)), self.unlift);
        let kept = lanes.select(lanes.less(v, self.least), lanes.splat(0.0), v);
        put(lanes, (&mut *self.gamma.0, &mut *self.gamma.1), number, kept);
        put(lanes, (&mut *self.q.0, &mut *self.q.1), number, q);
        self.sum = lanes.add(self.sum, kept);
    }
}

/// Does an [`Update`].
pub(crate) fn update(update: Update<'_, impl Product>) -> Updated {
    let Update { prediction, lift, likelihoods, scaled, out } = update;
    let prediction = Part::all(prediction);
    run_in_blocks(Update { prediction, lift, likelihoods, scaled, out })
}

/// Does a [`Settle`].
pub(crate) fn settle(x: &mut [f64], sum: f64) -> bool {
    run_in_blocks(Settle { x, sum })
}

/// Does a [`SettleAndLift`].
pub(crate) fn settle_and_lift(x: &mut [f64], out: &mut [f64], sum: f64) -> bool {
    run_in_blocks(SettleAndLift { x, out, sum })
}

/// Does a [`Weigh`].
pub(crate) fn weigh(q: &[f64], likelihoods: &[f64], factor: f64, ratio: &mut [f64]) {
    run_in_blocks(Weigh { q, likelihoods, factor, ratio });
}

/// Does a [`Retreat`].
pub(crate) fn retreat(back: impl Product, alpha: &[f64], gamma: &mut [f64], q: &mut [f64]) -> f64 {
    run_in_blocks(Retreat { back: Part::all(back), alpha, gamma, q })
}
