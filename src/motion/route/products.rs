//! Products with vectors, in loops along the places.

use super::super::OdometryModel;
use super::stencil::Stencil;
use super::step::{Off, Step};
use super::views::ViewEvidence;
use super::{RouteControl, RouteTransition};
use crate::error::TransitionError;
use crate::kernels;
use crate::transition::{Transition, buffers, check_slices};

/// As many vectors as are added in one pass.
const TERMS: usize = 4;

impl Step<'_> {
    /// `out =` what a stencil takes from x, and a factor times what else there is.
    fn take(
        &self,
        speed: usize,
        stencil: &Stencil,
        x: &[f64],
        (factor, more): (f64, &[f64]),
        out: &mut [f64],
    ) {
        let window = self.window(speed);
        for (places, taps) in stencil.runs() {
            let mut terms = [(0.0, &x[..0]); TERMS];
            let (mut count, mut some) = (0, false);
            if !more.is_empty() {
                terms[0] = (factor, &more[places.clone()]);
                count = 1;
            }
            let out = &mut out[places];
            for (first, weight, class) in taps {
                if count == TERMS {
                    if some {
                        kernels::add_combined(out, &terms);
                    } else {
                        kernels::combine(out, &terms);
                    }
                    (count, some) = (0, true);
                }
                let factor = window[weight] * self.factors.of(class);
                terms[count] = (factor, &x[first..first + out.len()]);
                count += 1;
            }
            let terms = &terms[..count];
            if some { kernels::add_combined(out, terms) } else { kernels::combine(out, terms) }
        }
    }

    /// `out[j] = Σ` over i of window(i → j) e(i, j) `x[i]`, and a factor times more.
    fn push(&self, speed: usize, x: &[f64], more: (f64, &[f64]), out: &mut [f64]) {
        let route = self.route;
        self.take(speed, &route.stencils[speed][0], x, more, out);
        for end in route.line.ends() {
            for i in route.line.sources(route.span_of(speed), end) {
                let way = route.way(speed, self.window(speed), i, end);
                out[end] += way * self.seen(i, end) * x[i];
            }
        }
    }

    /// `out[i] = Σ` over j of window(i → j) e(i, j) `x[j]`.
    fn pull(&self, speed: usize, x: &[f64], out: &mut [f64]) {
        let route = self.route;
        self.take(speed, &route.stencils[speed][1], x, (0.0, &[]), out);
        for end in route.line.ends() {
            for i in route.line.sources(route.span_of(speed), end) {
                let way = route.way(speed, self.window(speed), i, end);
                out[i] += way * self.seen(i, end) * x[end];
            }
        }
    }

    /// `out[j] =` the probabilities of coming back at j, for x of where vehicles left.
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

    /// Shares of which a speed is mixed: the one that stays, of each neighbour, and of
    /// what goes to any speed.
    fn changes(&self, new: usize, mut work: impl FnMut(usize, f64)) -> f64 {
        let (k, switching) = (self.route.k(), &self.route.switching);
        let anywhere = self.route.speeds.changes().1 * self.route.speeds.shares()[new];
        for g in new.saturating_sub(1)..(new + 2).min(k) {
            work(g, self.keep * (switching[new * k + g] - anywhere).max(0.0));
        }
        self.keep * anywhere
    }

    /// `out =` the belief at a speed after a change, from that before; of `all`, the sum
    /// over speeds.
    fn change(&self, new: usize, x: &[f64], all: &[f64], out: &mut [f64]) {
        let n = self.route.line.places;
        let mut terms = [(0.0, all); TERMS];
        let mut count = 1;
        terms[0].0 = self.changes(new, |g, share| {
            terms[count] = (share, &x[g * n..][..n]);
            count += 1;
        });
        kernels::combine(out, &terms[..count]);
    }

    fn apply(&self, x: &[f64], out: &mut [f64]) {
        let (n, k) = (self.route.line.places, self.route.k());
        let (on, left) = x.split_at(k * n);
        buffers::with_two(n, |all, returned| {
            add_layers(on, n, |_| 1.0, all);
            if let Some(off) = &self.off {
                self.come_back(off, left, returned);
                let out = &mut out[k * n..];
                kernels::combine(out, &[(off.stay, left), (off.enter, all)]);
            }
            buffers::with(n, |mixed| {
                let returned = if self.off.is_some() { &*returned } else { &[] };
                for (new, out) in out[..k * n].chunks_exact_mut(n).enumerate() {
                    self.change(new, on, all, mixed);
                    let share = self.route.speeds.shares()[new];
                    self.push(new, mixed, (share, returned), out);
                }
            });
        });
    }

    fn apply_transpose(&self, x: &[f64], out: &mut [f64]) {
        let (n, k) = (self.route.line.places, self.route.k());
        let (on, left) = x.split_at(k * n);
        out.fill(0.0);
        buffers::with_two(n, |pulled, all| {
            all.fill(0.0);
            for (new, x) in on.chunks_exact(n).enumerate() {
                self.pull(new, x, pulled);
                let anywhere = self.changes(new, |g, share| {
                    kernels::add_combined(&mut out[g * n..][..n], &[(share, pulled)]);
                });
                kernels::add_combined(all, &[(anywhere, pulled)]);
            }
            for out in out[..k * n].chunks_exact_mut(n) {
                match &self.off {
                    Some(off) => kernels::add_combined(out, &[(1.0, all), (off.enter, left)]),
                    None => kernels::add_combined(out, &[(1.0, all)]),
                }
            }
            if let Some(off) = &self.off {
                add_layers(on, n, |g| self.route.speeds.shares()[g], all);
                let out = &mut out[k * n..];
                kernels::combine(out, &[(off.stay, left)]);
                self.leave_back(off, all, out);
            }
        });
    }
}

/// `out = Σ` of layers of n values, each times its factor.
fn add_layers(x: &[f64], n: usize, factor: impl Fn(usize) -> f64, out: &mut [f64]) {
    for (number, layers) in x.chunks(TERMS * n).enumerate() {
        let mut terms = [(0.0, &x[..0]); TERMS];
        let mut count = 0;
        for layer in layers.chunks_exact(n) {
            terms[count] = (factor(number * TERMS + count), layer);
            count += 1;
        }
        let terms = &terms[..count];
        if number == 0 { kernels::combine(out, terms) } else { kernels::add_combined(out, terms) }
    }
}

impl Transition for RouteTransition {
    type Control = RouteControl;

    fn states(&self) -> usize {
        self.count()
    }

    fn apply(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        self.with_step(control, |step| step.apply(x, out));
    }

    fn apply_transpose(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        self.with_step(control, |step| step.apply_transpose(x, out));
    }

    fn evidence(&self, control: &RouteControl) -> Option<f64> {
        self.log_factor(control)
    }

    fn check_control(&self, control: &RouteControl) -> Result<(), TransitionError> {
        control.odometry.map_or(Ok(()), OdometryModel::check_reading)?;
        control.view.map_or(Ok(()), ViewEvidence::check)
    }
}
