//! Products with vectors, in loops along the places: first G mixes the speeds, then the window
//! w(m, v) of each new speed, times the likelihood of the view, moves its places (`guide::formulas`,
//! Route). All factors are at least 0, so nothing cancels. Only the ends of an open route, where
//! several moves stop, go entry by entry.

use std::ops::Range;

use super::shape::{Stencil, TERMS, add_linear_combination, set_linear_combination};
use super::step::{OffMapFactors, Step};
use super::{RouteControl, RouteTransition, ViewEvidence, ViewFactors};
use crate::motion::OdometryModel;
use wayfix::Transition;
use wayfix::TransitionError;
use wayfix::internal::buffers;
use wayfix::transition::kit::check_slices;
use wayfix_kernels as kernels;

/// Number of places handled at a time, so that their values stay in the first cache.
const BLOCK: usize = 512;

/// Values of successive places, padded beyond the ends of a loop.
#[derive(Debug, Clone, Copy)]
struct Stretch<'a> {
    /// The first place.
    first: isize,
    values: &'a [f64],
}

impl<'a> Stretch<'a> {
    fn starting_at(self, place: isize) -> &'a [f64] {
        &self.values[(place - self.first).cast_unsigned()..]
    }
}

impl Step<'_> {
    /// `out =` the sums of a stencil over x at some places, plus a factor times further values.
    fn apply_stencil(
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
                        add_linear_combination(out, &terms);
                    } else {
                        set_linear_combination(out, &terms);
                    }
                    (count, some) = (0, true);
                }
                let factor = window[weight] * self.factors.of(stays);
                terms[count] = (factor, &x.starting_at(first)[..out.len()]);
                count += 1;
            }
            // Without any term, as at the ends of an open route, zeros are written.
            let terms = &terms[..count];
            if some {
                add_linear_combination(out, terms);
            } else {
                set_linear_combination(out, terms);
            }
        }
    }

    /// `out[j] = Σ` over i of window(i → j) e(i, j) `x[i]` at some places, plus a factor times
    /// further values.
    fn apply_window(
        &self,
        speed: usize,
        places: Range<usize>,
        x: Stretch<'_>,
        more: (f64, &[f64]),
        out: &mut [f64],
    ) {
        let route = self.route;
        self.apply_stencil((speed, &route.stencils[speed][0]), places.clone(), x, more, out);
        for end in route.shape.ends().filter(|end| places.contains(end)) {
            for i in route.shape.sources(route.span_of(speed), end) {
                out[end - places.start] +=
                    self.move_entry(speed, i, end) * x.starting_at(i.cast_signed())[0];
            }
        }
    }

    /// `out[i] = Σ` over j of window(i → j) e(i, j) `x[j]`.
    fn apply_window_transpose(&self, speed: usize, x: &[f64], out: &mut [f64]) {
        let route = self.route;
        let stencil = (speed, &route.stencils[speed][1]);
        let places = 0..route.shape.places;
        if route.shape.closed {
            // Around a loop, taps lead beyond the ends: x is padded with its other end.
            let reach = route.reach();
            buffers::with(x.len() + 2 * reach, |values| {
                let first = -reach.cast_signed();
                for (span, at) in route.shape.spans(first, values.len()) {
                    values[at..at + span.len()].copy_from_slice(&x[span]);
                }
                self.apply_stencil(stencil, places, Stretch { first, values }, (0.0, &[]), out);
            });
        } else {
            self.apply_stencil(stencil, places, Stretch { first: 0, values: x }, (0.0, &[]), out);
        }
        for end in route.shape.ends() {
            for i in route.shape.sources(route.span_of(speed), end) {
                out[i] += self.move_entry(speed, i, end) * x[end];
            }
        }
    }

    /// `out[j] =` the probability of coming back at j, for probabilities x of the places where
    /// vehicles left.
    fn apply_return(&self, off: &OffMapFactors, x: &[f64], out: &mut [f64]) {
        let total = kernels::sum(x);
        let anywhere = off.back * off.uniform_return * total;
        if off.is_anywhere {
            return out.fill(anywhere);
        }
        buffers::with(x.len(), |shared| {
            for ((shared, x), near) in shared.iter_mut().zip(x).zip(&self.route.near_shares) {
                *shared = off.back * near * x;
            }
            self.route.shape.sum_near(shared, off.within, out);
        });
        out.iter_mut().for_each(|out| *out += anywhere);
    }

    /// `out[i] +=` the sum of x over places where a vehicle that left at i may come back,
    /// times their probabilities.
    fn apply_return_transpose(&self, off: &OffMapFactors, x: &[f64], out: &mut [f64]) {
        let total = kernels::sum(x);
        if off.is_anywhere {
            return out.iter_mut().for_each(|out| *out += off.back * off.uniform_return * total);
        }
        buffers::with(x.len(), |near| {
            self.route.shape.sum_near(x, off.within, near);
            for ((out, near), share) in out.iter_mut().zip(&*near).zip(&self.route.near_shares) {
                *out += off.back * (share * near + off.uniform_return * total);
            }
        });
    }

    /// Calls `work` with `new` and its neighbours, each with the probability of the change to
    /// `new`; returns the probability of changing to `new` from any speed.
    fn changes(&self, new: usize, mut work: impl FnMut(usize, f64)) -> f64 {
        let (k, switching) = (self.route.k(), &self.route.switching);
        let anywhere = self.route.speeds.changes().1 * self.route.speeds.shares()[new];
        for g in new.saturating_sub(1)..(new + 2).min(k) {
            // G without its rank-one term is tridiagonal. Rounding may take the difference below 0.
            work(g, self.not_leaving * (switching[new * k + g] - anywhere).max(0.0));
        }
        self.not_leaving * anywhere
    }

    /// `out =` the belief at speed `new` after the change of speeds, at some places; `all` is the
    /// sum over the speeds before it.
    fn change(&self, new: usize, x: &[f64], all: &[f64], places: Range<usize>, out: &mut [f64]) {
        let n = self.route.shape.places;
        // One term for all speeds together and at most three for the speed and its neighbours:
        // TERMS in all, so that one pass does.
        let mut terms = [(0.0, &all[places.clone()]); TERMS];
        let mut count = 1;
        terms[0].0 = self.changes(new, |g, share| {
            terms[count] = (share, &x[g * n..][places.clone()]);
            count += 1;
        });
        set_linear_combination(out, &terms[..count]);
    }

    /// Computes the product with x, and hands over each block with its first state.
    fn apply_in_blocks(&self, x: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let (n, k) = (self.route.shape.places, self.route.k());
        let (on, left) = x.split_at(k * n);
        let reach = self.route.reach();
        buffers::with_two(n, |all, returned| {
            add_layers(on, n, |_| 1.0, all);
            if let Some(off) = &self.off {
                self.apply_return(off, left, returned);
            }
            // A block of places is finished for all speeds before the next one starts. A move leads
            // at most `reach` places away, so a block needs mixed beliefs with as much padding on
            // either side.
            buffers::with_two(BLOCK.min(n) + 2 * reach, |mixed, out| {
                for start in (0..n).step_by(BLOCK) {
                    let places = start..(start + BLOCK).min(n);
                    // What lies beyond the ends of an open route is left as it is: stencils never
                    // read it.
                    let (mixed, out) = (&mut *mixed, &mut out[..places.len()]);
                    let first = start.cast_signed() - reach.cast_signed();
                    for new in 0..k {
                        for (span, at) in self.route.shape.spans(first, places.len() + 2 * reach) {
                            let mixed = &mut mixed[at..at + span.len()];
                            self.change(new, on, all, span, mixed);
                        }
                        let more = match self.off {
                            Some(_) => &returned[places.clone()],
                            None => &[],
                        };
                        let more = (self.route.speeds.shares()[new], more);
                        self.apply_window(
                            new,
                            places.clone(),
                            Stretch { first, values: mixed },
                            more,
                            out,
                        );
                        take(new * n + start, out);
                    }
                    // A move to off the map keeps the place. It may start at any speed, or off the
                    // map.
                    if let Some(off) = &self.off {
                        let (left, all) = (&left[places.clone()], &all[places]);
                        set_linear_combination(out, &[(off.stay, left), (off.enter, all)]);
                        take(k * n + start, out);
                    }
                }
            });
        });
    }

    /// Lower bound of all factors and entries above 0.
    fn smallest(&self) -> f64 {
        let least = |values: &mut dyn Iterator<Item = f64>| {
            values.filter(|value| *value > 0.0).fold(1.0, f64::min)
        };
        let speeds = 0..self.route.k();
        let shares = least(&mut self.route.speeds.shares().iter().copied());
        let mut changes = 1.0;
        for new in speeds {
            let all =
                self.changes(new, |_, share| changes = least(&mut [changes, share].into_iter()));
            changes = least(&mut [changes, all].into_iter());
        }
        let ViewFactors { standing, moved } = self.factors;
        let seen = least(&mut [standing, moved].into_iter());
        // Entries are products of one factor of each kind, so the product of the least factors is a
        // lower bound.
        let on = changes * seen * least(&mut self.windows.iter().copied());
        let Some(off) = &self.off else { return on };
        let most = 2 * off.within.min(self.route.shape.places) + 1;
        let near = self.route.off_map.map_or(0.0, |off| off.near / most as f64);
        let back = off.back * least(&mut [near, off.uniform_return].into_iter()) * shares;
        least(&mut [on, back, off.enter, off.stay].into_iter())
    }

    fn apply_transpose(&self, x: &[f64], out: &mut [f64]) {
        let (n, k) = (self.route.shape.places, self.route.k());
        let (on, left) = x.split_at(k * n);
        out.fill(0.0);
        buffers::with_two(n, |pulled, all| {
            all.fill(0.0);
            // A' = Σ over new speeds of G'(new, ·) after the transposed window. The rank-one part
            // of G is the same for all old speeds: it is collected in `all` and added to each once.
            for (new, x) in on.chunks_exact(n).enumerate() {
                self.apply_window_transpose(new, x, pulled);
                let anywhere = self.changes(new, |g, share| {
                    add_linear_combination(&mut out[g * n..][..n], &[(share, pulled)]);
                });
                add_linear_combination(all, &[(anywhere, pulled)]);
            }
            for out in out[..k * n].chunks_exact_mut(n) {
                match &self.off {
                    Some(off) => add_linear_combination(out, &[(1.0, all), (off.enter, left)]),
                    None => add_linear_combination(out, &[(1.0, all)]),
                }
            }
            if let Some(off) = &self.off {
                // `all` is free again, for returns from off the map: these take each speed by its
                // share.
                add_layers(on, n, |g| self.route.speeds.shares()[g], all);
                let out = &mut out[k * n..];
                set_linear_combination(out, &[(off.stay, left)]);
                self.apply_return_transpose(off, all, out);
            }
        });
    }
}

/// `out = Σ` over the layers of x, of n values each, times their factors.
fn add_layers(x: &[f64], n: usize, factor: impl Fn(usize) -> f64, out: &mut [f64]) {
    for (number, layers) in x.chunks(TERMS * n).enumerate() {
        let mut terms = [(0.0, &x[..0]); TERMS];
        let mut count = 0;
        for layer in layers.chunks_exact(n) {
            terms[count] = (factor(number * TERMS + count), layer);
            count += 1;
        }
        let terms = &terms[..count];
        if number == 0 {
            set_linear_combination(out, terms);
        } else {
            add_linear_combination(out, terms);
        }
    }
}

impl RouteTransition {
    /// Sums a belief over speeds into the probability of each place; returns that of off the map.
    pub(crate) fn marginalize_places(&self, belief: &[f64], out: &mut [f64]) -> f64 {
        let n = self.shape.places;
        let (on, off) = belief.split_at(self.k() * n);
        add_layers(on, n, |_| 1.0, out);
        kernels::sum(off)
    }
}

impl Transition for RouteTransition {
    type Control = RouteControl;

    fn states(&self) -> usize {
        self.count()
    }

    fn apply(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        self.apply_in_blocks(control, x, &mut |first, values| {
            out[first..first + values.len()].copy_from_slice(values);
        });
    }

    fn apply_in_blocks(
        &self,
        control: &RouteControl,
        x: &[f64],
        take: &mut dyn FnMut(usize, &[f64]),
    ) {
        self.with_step(control, |step, _| step.apply_in_blocks(x, take));
    }

    fn smallest_entry(&self, control: &RouteControl) -> f64 {
        self.with_step(control, |step, _| step.smallest())
    }

    fn apply_transpose(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        self.with_step(control, |step, _| step.apply_transpose(x, out));
    }

    fn evidence(&self, control: &RouteControl) -> Option<f64> {
        self.log_factor(control)
    }

    fn check_control(&self, control: &RouteControl) -> Result<(), TransitionError> {
        control.odometry.map_or(Ok(()), OdometryModel::check_reading)?;
        control.view.map_or(Ok(()), ViewEvidence::check)?;
        control.before.map_or(Ok(()), |before| before.check())
    }
}
