//! Element by element on the eight lines at hand, while their product is still in
//! registers: the second half of a step of filter and smoother.

use std::marker::PhantomData;

use super::blocks::{Blocks, run_in_blocks};
use super::lanes::{Eight, Kernel, LANES, Lanes};
use super::product::{Each, Part, Product, eight, put};
use super::{LIFT, total};

/// `out = p ∘ b` for a prediction p that sums to `lift`.
pub(crate) struct Update<'a, P> {
    pub(crate) prediction: P,
    pub(crate) lift: f64,
    pub(crate) likelihoods: &'a [f64],
    pub(crate) watch: Watch,
    pub(crate) out: &'a mut [f64],
}

/// Which small results are told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Watch {
    /// None.
    Nothing,
    /// Those of which neither factor is 0.
    Products,
    /// Those of which the prediction is not 0: likelihoods have been scaled, so that
    /// one of 0 may have been above.
    Predictions,
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
    /// Whether a result that is [watched](Watch) is below 2^-1000 of the lift.
    pub(crate) small: bool,
}

impl Updated {
    /// Sums over no states.
    pub(crate) const NONE: Self = Self {
        products: 0.0,
        predicted: 0.0,
        negative_predicted: false,
        negative_likelihood: false,
        largest_likelihood: 0.0,
        small: false,
    };

    /// Sums over the states of both.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            products: self.products + other.products,
            predicted: self.predicted + other.predicted,
            negative_predicted: self.negative_predicted | other.negative_predicted,
            negative_likelihood: self.negative_likelihood | other.negative_likelihood,
            largest_likelihood: self.largest_likelihood.max(other.largest_likelihood),
            small: self.small | other.small,
        }
    }
}

impl<P: Product> Kernel for Update<'_, Part<P>> {
    type Output = Updated;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Updated {
        let Self { prediction, lift, likelihoods, watch, out } = self;
        let n = prediction.lines();
        let (likelihoods, out) = (&likelihoods[..n], &mut out[..n]);
        let zero = lanes.splat(0.0);
        let mut each = UpdateEach::<L, P> {
            likelihoods: likelihoods.as_chunks(),
            out: out.as_chunks_mut(),
            least: lanes.splat(if watch == Watch::Nothing { 0.0 } else { lift / LIFT }),
            possible: lanes.splat(if watch == Watch::Predictions { 1.0 } else { 0.0 }),
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
        let both = a.and(b);
        if P::KNOWN { Updated { predicted: a.predicted, ..both } } else { both }
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

pub(crate) use crate::range::TINY;

#[inline(always)]
pub(super) fn is_tiny<L: Lanes>(lanes: L, v: L::V) -> L::M {
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

/// Does an [`Update`].
#[inline]
pub(crate) fn update<P: Product>(update: Update<'_, P>) -> Updated {
    P::update(update)
}

/// The same, for [`Product::update`].
#[inline(always)]
pub(super) fn update_with<P: Product>(update: Update<'_, P>) -> Updated {
    let Update { prediction, lift, likelihoods, watch, out } = update;
    let prediction = Part::all(prediction);
    run_in_blocks(Update { prediction, lift, likelihoods, watch, out })
}

/// Does a [`Settle`].
pub(crate) fn settle(x: &mut [f64], sum: f64) -> bool {
    run_in_blocks(Settle { x, sum })
}

/// Does a [`SettleAndLift`].
pub(crate) fn settle_and_lift(x: &mut [f64], out: &mut [f64], sum: f64) -> bool {
    run_in_blocks(SettleAndLift { x, out, sum })
}
