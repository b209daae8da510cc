//! Products with vectors, in loops along the places: first G mixes the speeds, then the window of
//! each new speed moves its places (guide, section 10, Route). Both factors are at least 0, so
//! nothing cancels.

use std::ops::Range;

use super::super::OdometryModel;
use super::moves::{Stretch, TERMS, add_combined, combine};
use super::step::{Off, Step};
use super::views::{Factors, ViewEvidence};
use super::{RouteControl, RouteTransition};
use wayfix::Transition;
use wayfix::TransitionError;
use wayfix::internal::{buffers, check_slices};
use wayfix_kernels as kernels;

/// Number of places handled at a time, so that their values stay in the first cache.
const BLOCK: usize = 512;

impl Step<'_> {
    /// `out[j] =` the probability of coming back at j, for probabilities x of the places where
    /// vehicles left.
    fn come_back(&self, off: &Off, x: &[f64], out: &mut [f64]) {
        let total = kernels::sum(x);
        let anywhere = off.back * off.each * total;
        if off.is_anywhere {
            return out.fill(anywhere);
        }
        buffers::with(x.len(), |shared| {
            for ((shared, x), near) in shared.iter_mut().zip(x).zip(&self.route.near_shares) {
                *shared = off.back * near * x;
            }
            self.route.line.sum_near(shared, off.within, out);
        });
        out.iter_mut().for_each(|out| *out += anywhere);
    }

    /// `out[i] +=` the sum of x over places where a vehicle that left at i may come back,
    /// times their probabilities.
    fn leave_back(&self, off: &Off, x: &[f64], out: &mut [f64]) {
        let total = kernels::sum(x);
        if off.is_anywhere {
            return out.iter_mut().for_each(|out| *out += off.back * off.each * total);
        }
        buffers::with(x.len(), |near| {
            self.route.line.sum_near(x, off.within, near);
            for ((out, near), share) in out.iter_mut().zip(&*near).zip(&self.route.near_shares) {
                *out += off.back * (share * near + off.each * total);
            }
        });
    }

    /// Calls `work` with `new` and its neighbours, each with the probability of the change to
    /// `new`; returns the probability of changing to `new` from any speed.
    fn changes(&self, new: usize, mut work: impl FnMut(usize, f64)) -> f64 {
        let (k, switching) = (self.route.k(), &self.route.switching);
        let anywhere = self.route.speeds.changes().1 * self.route.speeds.shares()[new];
        for g in new.saturating_sub(1)..(new + 2).min(k) {
            // G less its term of rank one is tridiagonal. The difference may round below 0.
            work(g, self.keep * (switching[new * k + g] - anywhere).max(0.0));
        }
        self.keep * anywhere
    }

    /// `out =` the belief at speed `new` after the change of speeds, at some places; `all` is the
    /// sum over the speeds before it.
    fn change(&self, new: usize, x: &[f64], all: &[f64], places: Range<usize>, out: &mut [f64]) {
        let n = self.route.line.places;
        // One term for all speeds together and at most three for the speed and its neighbours:
        // TERMS in all, so that one pass does.
        let mut terms = [(0.0, &all[places.clone()]); TERMS];
        let mut count = 1;
        terms[0].0 = self.changes(new, |g, share| {
            terms[count] = (share, &x[g * n..][places.clone()]);
            count += 1;
        });
        combine(out, &terms[..count]);
    }

    /// Computes the product with x, and hands over each block with its first state.
    fn apply_in_blocks(&self, x: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let (n, k) = (self.route.line.places, self.route.k());
        let (on, left) = x.split_at(k * n);
        let reach = self.route.reach();
        buffers::with_two(n, |all, returned| {
            add_layers(on, n, |_| 1.0, all);
            if let Some(off) = &self.off {
                self.come_back(off, left, returned);
            }
            // A block of places is finished for all speeds before the next one starts. A move leads
            // at most `reach` places away, so its mixed beliefs are needed with as much padding on
            // either side.
            buffers::with_two(BLOCK.min(n) + 2 * reach, |mixed, out| {
                for start in (0..n).step_by(BLOCK) {
                    let places = start..(start + BLOCK).min(n);
                    // What lies beyond the ends of an open route is left as it is: stencils never
                    // read it.
                    let (mixed, out) = (&mut *mixed, &mut out[..places.len()]);
                    let first = start.cast_signed() - reach.cast_signed();
                    for new in 0..k {
                        for (span, at) in self.route.line.spans(first, places.len() + 2 * reach) {
                            let mixed = &mut mixed[at..at + span.len()];
                            self.change(new, on, all, span, mixed);
                        }
                        let more = match self.off {
                            Some(_) => &returned[places.clone()],
                            None => &[],
                        };
                        let more = (self.route.speeds.shares()[new], more);
                        self.push(new, places.clone(), Stretch { first, values: mixed }, more, out);
                        take(new * n + start, out);
                    }
                    // To off the map at the place itself: from any speed, and from off the map
                    // there.
                    if let Some(off) = &self.off {
                        let (left, all) = (&left[places.clone()], &all[places]);
                        combine(out, &[(off.stay, left), (off.enter, all)]);
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
        let Factors { standing, moved } = self.factors;
        let seen = least(&mut [standing, moved].into_iter());
        // Entries are products of one factor of each kind, so the product of the least of each is a
        // lower bound.
        let on = changes * seen * least(&mut self.windows.iter().copied());
        let Some(off) = &self.off else { return on };
        let most = 2 * off.within.min(self.route.line.places) + 1;
        let near = self.route.off_map.map_or(0.0, |off| off.near / most as f64);
        let back = off.back * least(&mut [near, off.each].into_iter()) * shares;
        least(&mut [on, back, off.enter, off.stay].into_iter())
    }

    fn apply_transpose(&self, x: &[f64], out: &mut [f64]) {
        let (n, k) = (self.route.line.places, self.route.k());
        let (on, left) = x.split_at(k * n);
        out.fill(0.0);
        buffers::with_two(n, |pulled, all| {
            all.fill(0.0);
            // A' = Σ over new speeds of G'(new, ·) after the transposed window. The rank-one part
            // of G is the same for all old speeds: it is collected in `all` and added to each once.
            for (new, x) in on.chunks_exact(n).enumerate() {
                self.pull(new, x, pulled);
                let anywhere = self.changes(new, |g, share| {
                    add_combined(&mut out[g * n..][..n], &[(share, pulled)]);
                });
                add_combined(all, &[(anywhere, pulled)]);
            }
            for out in out[..k * n].chunks_exact_mut(n) {
                match &self.off {
                    Some(off) => add_combined(out, &[(1.0, all), (off.enter, left)]),
                    None => add_combined(out, &[(1.0, all)]),
                }
            }
            if let Some(off) = &self.off {
                // `all` is free again: from off the map, a vehicle comes back at speeds by their
                // shares.
                add_layers(on, n, |g| self.route.speeds.shares()[g], all);
                let out = &mut out[k * n..];
                combine(out, &[(off.stay, left)]);
                self.leave_back(off, all, out);
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
        if number == 0 { combine(out, terms) } else { add_combined(out, terms) }
    }
}

impl RouteTransition {
    /// Sums a belief over speeds into the probability of each place; returns that of off the map.
    pub(crate) fn add_up(&self, belief: &[f64], out: &mut [f64]) -> f64 {
        let n = self.line.places;
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
