//! Products with the moves of one speed, in loops along the places: the window w(m, v) times the
//! likelihood of the view. A stencil lists shifted vectors, and a pass adds four of them; only the
//! ends of an open route, where several moves stop, go entry by entry.

use std::ops::Range;

use super::geometry::Stencil;
use super::step::Step;
use wayfix::internal::buffers;
use wayfix_kernels::{Eight, LANES, Simd, WithSimd, run};

/// Number of shifted vectors added in one pass.
pub(super) const TERMS: usize = 4;

/// Values of successive places, padded beyond the ends of a loop.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch<'a> {
    /// The first place.
    pub(super) first: isize,
    pub(super) values: &'a [f64],
}

impl<'a> Stretch<'a> {
    fn from(self, place: isize) -> &'a [f64] {
        &self.values[(place - self.first).cast_unsigned()..]
    }
}

impl Step<'_> {
    /// `out =` the sums of a stencil over x at some places, plus a factor times further values.
    fn take(
        &self,
        (speed, stencil): (usize, &Stencil),
        places: Range<usize>,
        x: Stretch<'_>,
        (factor, more): (f64, &[f64]),
        out: &mut [f64],
    ) {
        let window = self.window(speed);
        for (run, taps) in stencil.runs(places.clone()) {
            let inner = run.start - places.start..run.end - places.start;
            let mut terms = [(0.0, &x.values[..0]); TERMS];
            let (mut count, mut some) = (0, false);
            if !more.is_empty() {
                terms[0] = (factor, &more[inner.clone()]);
                count = 1;
            }
            let out = &mut out[inner];
            // Up to TERMS vectors are collected and then written in one pass; the first pass sets
            // `out`, later ones add to it.
            for (first, weight, stays) in taps {
                if count == TERMS {
                    if some {
                        add_combined(out, &terms);
                    } else {
                        combine(out, &terms);
                    }
                    (count, some) = (0, true);
                }
                let factor = window[weight] * self.factors.of(stays);
                terms[count] = (factor, &x.from(first)[..out.len()]);
                count += 1;
            }
            // Without any term, as at the ends of an open route, `combine` writes zeros.
            let terms = &terms[..count];
            if some { add_combined(out, terms) } else { combine(out, terms) }
        }
    }

    /// `out[j] = Σ` over i of window(i → j) e(i, j) `x[i]` at some places, plus a factor times
    /// further values.
    pub(super) fn push(
        &self,
        speed: usize,
        places: Range<usize>,
        x: Stretch<'_>,
        more: (f64, &[f64]),
        out: &mut [f64],
    ) {
        let route = self.route;
        self.take((speed, &route.stencils[speed][0]), places.clone(), x, more, out);
        for end in route.line.ends().filter(|end| places.contains(end)) {
            for i in route.line.sources(route.span_of(speed), end) {
                out[end - places.start] +=
                    self.move_weight(speed, i, end) * x.from(i.cast_signed())[0];
            }
        }
    }

    /// `out[i] = Σ` over j of window(i → j) e(i, j) `x[j]`.
    pub(super) fn pull(&self, speed: usize, x: &[f64], out: &mut [f64]) {
        let route = self.route;
        let stencil = (speed, &route.stencils[speed][1]);
        let places = 0..route.line.places;
        if route.line.closed {
            // Around a loop, taps lead beyond the ends: x is padded with its other end.
            let reach = route.reach();
            buffers::with(x.len() + 2 * reach, |values| {
                let first = -reach.cast_signed();
                for (span, at) in route.line.spans(first, values.len()) {
                    values[at..at + span.len()].copy_from_slice(&x[span]);
                }
                self.take(stencil, places, Stretch { first, values }, (0.0, &[]), out);
            });
        } else {
            self.take(stencil, places, Stretch { first: 0, values: x }, (0.0, &[]), out);
        }
        for end in route.line.ends() {
            for i in route.line.sources(route.span_of(speed), end) {
                out[i] += self.move_weight(speed, i, end) * x[end];
            }
        }
    }
}

/// Sets `out` to the sum of factors times vectors of its length.
pub(crate) fn combine(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(Combine { out, terms, keep: false });
}

/// Adds factors times vectors of its length to `out`.
pub(crate) fn add_combined(out: &mut [f64], terms: &[(f64, &[f64])]) {
    run(Combine { out, terms, keep: true });
}

struct Combine<'a> {
    out: &'a mut [f64],
    terms: &'a [(f64, &'a [f64])],
    /// True to add to what is in `out`.
    keep: bool,
}

impl WithSimd for Combine<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { out, terms, mut keep } = self;
        let (fours, rest) = terms.as_chunks::<TERMS>();
        for terms in fours {
            // Only the first four may overwrite `out`.
            add(s, out, terms, keep);
            keep = true;
        }
        match *rest {
            [a, b, c] => add(s, out, &[a, b, c], keep),
            [a, b] => add(s, out, &[a, b], keep),
            [a] => add(s, out, &[a], keep),
            _ if keep => {}
            _ => out.fill(0.0),
        }
    }
}

#[inline(always)]
fn add<S: Simd, const C: usize>(s: S, out: &mut [f64], terms: &[(f64, &[f64]); C], keep: bool) {
    let count = out.len();
    let factors: [S::V; C] = std::array::from_fn(|c| s.splat(terms[c].0));
    let (outs, out_rest) = out.as_chunks_mut::<LANES>();
    // Cutting every vector to `outs.len()` lets the compiler drop the bounds checks of the loop.
    let whole: [&[Eight]; C] =
        std::array::from_fn(|c| &terms[c].1[..count].as_chunks::<LANES>().0[..outs.len()]);
    for (number, out) in outs.iter_mut().enumerate() {
        let mut sum = if keep { s.load(out) } else { s.splat(0.0) };
        for c in 0..C {
            sum = s.add(sum, s.mul(s.load(&whole[c][number]), factors[c]));
        }
        s.store(sum, out);
    }
    // The same operations in the same order as in the lanes, so that a place's value does not
    // depend on where its block ends.
    for (at, out) in (count - out_rest.len()..).zip(out_rest) {
        *out = if keep { *out } else { 0.0 };
        for (factor, x) in terms {
            *out += factor * x[at];
        }
    }
}
