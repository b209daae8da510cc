//! Second half of a step of the filter, formula 2 of the guide: x = p ∘ b, N = Σ x, α = x / N.
//!
//! The invariant is that of `limits`: a possible state is above 0 with all its digits, or the step
//! reports that one may not be ([`Watch`]) and is taken again in another form. The checks that this
//! takes, and those of the sensor's values, are part of the one pass over the product: a pass of
//! their own would read it from memory again.
//!
//! Before a step the values of the sensor are checked: no value from outside reaches a recursion
//! unchecked. One pass finds the [`largest`] and tests that all are valid; only after a failure, a
//! second pass finds the first invalid one.

use std::marker::PhantomData;

use crate::layout::{Product, ProductRows, Sink, SparseRows};
use crate::limits::{LARGEST_LOG, LIFT, TINY};
use crate::simd::{
    Blocks, BlocksMut, LANES, PART, Simd, Splits, WithSimd, kernels, row_block, row_block_ahead,
    run, run_in_parts, store, total,
};

/// `out = p ∘ b` for a prediction p that sums to `lift`.
pub struct ForwardStep<'a> {
    pub prediction: Product<'a>,
    pub lift: f64,
    pub likelihoods: &'a [f64],
    pub watch: Watch,
    pub out: &'a mut [f64],
}

/// Small results that a [`ForwardStep`] reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watch {
    Nothing,
    /// Results with neither factor 0.
    Products,
    /// Results with a prediction that is not 0: likelihoods have been scaled, so that one of 0
    /// may have been positive.
    Predictions,
}

/// Sums and checks of a [`ForwardStep`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForwardSums {
    /// Σ pᵢ bᵢ. NaN or infinite if a likelihood is.
    pub products: f64,
    /// Σ pᵢ.
    pub predicted: f64,
    pub negative_predicted: bool,
    pub negative_likelihood: bool,
    pub largest_likelihood: f64,
    /// True if a result that is [watched](Watch) is below 2^-1000 of the lift.
    pub small: bool,
}

impl ForwardSums {
    /// Sums over no states.
    pub const NONE: Self = Self {
        products: 0.0,
        predicted: 0.0,
        negative_predicted: false,
        negative_likelihood: false,
        largest_likelihood: 0.0,
        small: false,
    };

    /// Sums over the states of both.
    pub fn and(self, other: Self) -> Self {
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

/// Takes the step, on several threads if there are many states.
pub fn forward_step(step: ForwardStep<'_>) -> ForwardSums {
    let ForwardStep { prediction, lift, likelihoods, watch, out } = step;
    match prediction {
        Product::Sparse { matrix, x } => {
            let prediction = SparseRows::all(matrix, x);
            run_in_parts(ForwardRows { prediction, lift, likelihoods, watch, out })
        }
        Product::Computed(prediction) => {
            run_in_parts(ForwardRows { prediction, lift, likelihoods, watch, out })
        }
    }
}

/// A [`ForwardStep`] with one type of product.
pub(crate) struct ForwardRows<'a, P> {
    pub(crate) prediction: P,
    pub(crate) lift: f64,
    pub(crate) likelihoods: &'a [f64],
    pub(crate) watch: Watch,
    pub(crate) out: &'a mut [f64],
}

impl<P: ProductRows> WithSimd for ForwardRows<'_, P> {
    type Output = ForwardSums;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> ForwardSums {
        let Self { prediction, lift, likelihoods, watch, out } = self;
        let n = prediction.rows();
        let zero = s.splat(0.0);
        let mut sink = ForwardSink::<S, P> {
            likelihoods: likelihoods[..n].as_chunks(),
            out: out[..n].as_chunks_mut(),
            // The threshold is 2^-1000 of the lift, below which x may lack digits. A threshold of 0
            // turns the test off: no product is below it.
            least: s.splat(if watch == Watch::Nothing { 0.0 } else { lift / LIFT }),
            // `take` tests min(p, max(b, possible)) > 0: with 1, a likelihood of 0 counts as
            // possible.
            possible: s.splat(if watch == Watch::Predictions { 1.0 } else { 0.0 }),
            products: zero,
            predicted: zero,
            least_predicted: zero,
            least_likelihood: zero,
            largest_likelihood: zero,
            small: false,
            prediction: PhantomData,
        };
        prediction.pass_to(s, &mut sink);
        let largest = s.to_array(sink.largest_likelihood);
        ForwardSums {
            products: total(s.to_array(sink.products)),
            // A known product has the sum of x, as matrix and belief were checked: no sum is
            // computed.
            predicted: if P::KNOWN { lift } else { total(s.to_array(sink.predicted)) },
            negative_predicted: s.any(s.lt(sink.least_predicted, zero)),
            negative_likelihood: s.any(s.lt(sink.least_likelihood, zero)),
            largest_likelihood: largest.into_iter().fold(0.0, |a, b| if b > a { b } else { a }),
            small: sink.small,
        }
    }
}

struct ForwardSink<'a, S: Simd, P> {
    likelihoods: Blocks<'a>,
    out: BlocksMut<'a>,
    least: S::V,
    possible: S::V,
    products: S::V,
    predicted: S::V,
    least_predicted: S::V,
    least_likelihood: S::V,
    largest_likelihood: S::V,
    small: bool,
    prediction: PhantomData<P>,
}

impl<S: Simd, P: ProductRows> Sink<S, S::V> for ForwardSink<'_, S, P> {
    #[inline(always)]
    fn take(&mut self, s: S, block: usize, p: S::V) {
        let b = row_block_ahead::<S, true>(s, self.likelihoods, block);
        let after = s.mul(p, b);
        store(s, &mut self.out, block, after);
        // A NaN or an infinite value among p and b stays in this sum, so it needs no separate test.
        self.products = s.add(self.products, after);
        if !P::KNOWN {
            self.predicted = s.add(self.predicted, p);
            self.least_predicted = s.min(p, self.least_predicted);
        }
        // The running value comes second: min and max return it if the other value is NaN, so a NaN
        // does not hide a negative value found before.
        self.least_likelihood = s.min(b, self.least_likelihood);
        self.largest_likelihood = s.max(b, self.largest_likelihood);
        let below = s.lt(after, self.least);
        // Zeros also compare below, and are usually the only hits. The branch looks at their
        // factors.
        if s.any(below) {
            let possible = s.lt(s.splat(0.0), s.min(p, s.max(b, self.possible)));
            self.small |= s.any(s.and(below, possible));
        }
    }
}

impl<P: ProductRows> Splits for ForwardRows<'_, P> {
    fn lines(&self) -> usize {
        self.prediction.rows()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let Self { prediction, lift, likelihoods, watch, out } = self;
        let (p, b, out) = (prediction.split(at), likelihoods.split_at(at), out.split_at_mut(at));
        let part =
            |prediction, likelihoods, out| Self { prediction, lift, likelihoods, watch, out };
        (part(p.0, b.0, out.0), part(p.1, b.1, out.1))
    }

    fn join(a: ForwardSums, b: ForwardSums) -> ForwardSums {
        // Each part reports a known sum as that of the whole product: adding both would double it.
        let both = a.and(b);
        if P::KNOWN { ForwardSums { predicted: a.predicted, ..both } } else { both }
    }
}

/// Divides x by its sum. With `out`, writes the distribution there instead, with 0 for values that
/// would be below the smallest normal double, and lifts x. Returns true if a value is above 0 and
/// below 2^-900.
pub(crate) struct Normalize<'a, const LIFTED: bool> {
    pub(crate) x: &'a mut [f64],
    pub(crate) out: &'a mut [f64],
    pub(crate) sum: f64,
}

impl<const LIFTED: bool> WithSimd for Normalize<'_, LIFTED> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Self { x, out, sum } = self;
        // One division for all. 1 / sum is normal, or lacks one bit at 2^-1023 (`limits`).
        let (factor, lift) = (s.splat(1.0 / sum), s.splat(LIFT));
        let (least, zero) = (s.splat(f64::MIN_POSITIVE * sum), s.splat(0.0));
        let mut tiny = s.lt(zero, zero);
        let blocks = x.len().div_ceil(LANES);
        let (mut x, mut out) = (x.as_chunks_mut(), out.as_chunks_mut());
        for block in 0..blocks {
            let mut v = row_block(s, (x.0, x.1), block);
            if LIFTED {
                // Compare before scaling: a result below 2^-1022 takes a hundred times as long to
                // compute.
                v = s.mul(s.select(s.lt(v, least), zero, v), factor);
                store(s, &mut out, block, v);
                store(s, &mut x, block, s.mul(v, lift));
            } else {
                // A plain step reported no small x, so each x is 0 or at least 2^-1000. Divided by
                // the sum it stays normal; with evidence it may reach 2^-1023, which costs one
                // rounding (`limits`, "A plain step").
                v = s.mul(v, factor);
                store(s, &mut x, block, v);
            }
            tiny = s.or(tiny, s.is_small(v, TINY));
        }
        s.any(tiny)
    }
}

impl<const LIFTED: bool> Splits for Normalize<'_, LIFTED> {
    fn lines(&self) -> usize {
        self.x.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        // `out` is empty for a result in place, and so are both of its parts.
        let (x, out) = (self.x.split_at_mut(at), self.out.split_at_mut(at.min(self.out.len())));
        (Self { x: x.0, out: out.0, ..self }, Self { x: x.1, out: out.1, ..self })
    }

    fn join(a: bool, b: bool) -> bool {
        a | b
    }
}

/// Normalises a row in place, and appends it to others.
struct NormalizeOnto<'a> {
    x: &'a mut [f64],
    sum: f64,
    rows: &'a mut Vec<f64>,
}

impl WithSimd for NormalizeOnto<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Self { x, sum, rows } = self;
        rows.reserve(x.len());
        // Each block is copied while it is in a register. A copy of the whole row, by the platform,
        // took a quarter of a step on a large map (Zen 4).
        let (blocks, rest) = x.as_chunks_mut::<LANES>();
        let mut tiny = false;
        for block in blocks {
            tiny |= Normalize::<false> { x: block, out: &mut [], sum }.run(s);
            // The length is known here, so the copy takes no call.
            rows.extend_from_slice(block);
        }
        tiny |= Normalize::<false> { x: rest, out: &mut [], sum }.run(s);
        rows.extend_from_slice(rest);
        tiny
    }
}

/// Divides a vector by its sum, `sum`, in place, and appends it to rows, if there are any. Returns
/// true if a value is above 0 and below 2^-900.
#[inline]
pub fn normalize_in_place(x: &mut [f64], sum: f64, rows: Option<&mut Vec<f64>>) -> bool {
    match rows {
        Some(rows) if x.len() <= PART => run(NormalizeOnto { x, sum, rows }),
        rows => {
            let tiny = run_in_parts(Normalize::<false> { x, out: &mut [], sum });
            // Threads share the states of a larger model, but not a vector that grows.
            if let Some(rows) = rows {
                rows.extend_from_slice(x);
            }
            tiny
        }
    }
}

/// Divides a vector by its sum, `sum`: writes the distribution to `out`, and lifts it in place.
pub fn normalize_and_lift(x: &mut [f64], out: &mut [f64], sum: f64) -> bool {
    // One length for both: parts are split at the same lines.
    let out = &mut out[..x.len()];
    run_in_parts(Normalize::<true> { x, out, sum })
}

/// Condition that values have to meet.
#[derive(Debug, Clone, Copy)]
pub enum Valid {
    /// Finite, and at least 0.
    Likelihoods,
    /// At most 1e300 in size, or −∞.
    Logs,
}

impl Valid {
    pub fn is(self, x: f64) -> bool {
        match self {
            Self::Likelihoods => (0.0..=f64::MAX).contains(&x),
            Self::Logs => x.abs() <= LARGEST_LOG || x == f64::NEG_INFINITY,
        }
    }

    /// Name of a value, in errors.
    pub fn kind(self) -> &'static str {
        match self {
            Self::Likelihoods => "likelihood",
            Self::Logs => "log-likelihood",
        }
    }

    /// Condition, in errors.
    pub fn expected(self) -> &'static str {
        match self {
            Self::Likelihoods => "a finite value of at least 0",
            Self::Logs => "a value from -1e300 to 1e300, or negative infinity",
        }
    }

    /// Range of valid values, in the form of [`within`].
    #[inline(always)]
    pub(super) fn bounds<S: Simd>(self, s: S) -> [S::V; 3] {
        // `lt` is the only comparison that all instruction sets share: closed bounds become open
        // ones, a double further out. Beyond the largest double that is infinity.
        let [least, most, other] = self.range();
        [s.splat(least.next_down()), s.splat(most.next_up()), s.splat(other)]
    }

    /// Least and largest valid values, and one further valid value.
    fn range(self) -> [f64; 3] {
        match self {
            Self::Likelihoods => [0.0, f64::MAX, 0.0],
            Self::Logs => [-LARGEST_LOG, LARGEST_LOG, f64::NEG_INFINITY],
        }
    }
}

kernels! {
    /// Largest value, and true if all are valid.
    fn checked_largest = checked<'a>(x: &'a [f64], valid: Valid) -> (f64, bool);
}

#[inline(always)]
fn checked<S: Simd>(s: S, x: &[f64], valid: Valid) -> (f64, bool) {
    let (bounds, [.., other]) = (valid.bounds(s), valid.range());
    let (blocks, rest) = x.as_chunks::<LANES>();
    // Padding that is valid, and never the largest: 0 or −∞.
    let mut last = [other; LANES];
    last[..rest.len()].copy_from_slice(rest);
    let mut largest = bounds[2];
    // Every lane starts as true: `largest` holds `other`, which is not NaN and so equals itself.
    let mut valid = s.eq(largest, largest);
    for block in blocks.iter().chain([&last]) {
        let x = s.load(block);
        // A NaN leaves the largest as it is, and is not within the bounds.
        largest = s.max(x, largest);
        valid = s.and(valid, within(s, x, bounds));
    }
    let largest = s.to_array(largest);
    (largest.into_iter().fold(other, |a, b| if b > a { b } else { a }), s.all(valid))
}

/// Between the first two bounds, exclusive, or equal to the third; never NaN.
#[inline(always)]
pub(super) fn within<S: Simd>(s: S, x: S::V, [below, above, other]: [S::V; 3]) -> S::M {
    s.or(s.and(s.lt(below, x), s.lt(x, above)), s.eq(x, other))
}

/// Returns the largest value (0 or −∞ if there are none), or the index of the first invalid one.
pub fn largest(x: &[f64], valid: Valid) -> Result<f64, usize> {
    let (largest, all) = checked_largest(x, valid);
    if all {
        return Ok(largest);
    }
    // Only an error costs a second pass, which finds its index.
    Err(x.iter().position(|&x| !valid.is(x)).unwrap_or(0))
}
