//! The operator of one step, entry by entry.

use super::views::Factors;
use super::{RouteControl, RouteTransition};
use crate::transition::buffers;

/// Everything that the entries of a step are products of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) route: &'a RouteTransition,
    /// The weights of the moves of all speeds, with the likelihood of the odometry.
    pub(super) windows: &'a [f64],
    pub(super) factors: Factors,
    /// The probability of not leaving the map.
    pub(super) keep: f64,
    pub(super) off: Option<Off>,
}

/// Entries that have to do with off the map, with the likelihood of what was measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct Off {
    pub(super) enter: f64,
    pub(super) stay: f64,
    pub(super) back: f64,
    /// The probability of coming back at each place, near or not.
    pub(super) each: f64,
    /// True if it never comes back near.
    pub(super) is_anywhere: bool,
    pub(super) within: usize,
}

/// The parts of an entry, which is their product.
pub(super) type Parts = [f64; 4];

impl RouteTransition {
    /// The step of a control.
    pub(super) fn with_step<R>(
        &self,
        control: &RouteControl,
        work: impl FnOnce(Step<'_>) -> R,
    ) -> R {
        let width = self.starts[self.k()];
        buffers::with(width, |windows| {
            // The likelihood of the odometry off the map.
            let mut driven = 1.0;
            match control.odometry {
                None => {
                    for (g, window) in self.speeds.windows.iter().enumerate() {
                        windows[self.starts[g]..self.starts[g + 1]]
                            .copy_from_slice(&window.weights);
                    }
                }
                Some(reading) => {
                    driven = 0.0;
                    for (g, window) in self.speeds.windows.iter().enumerate() {
                        let likelihood =
                            |v: f64| self.odometry.relative(reading, v, window.spacing);
                        let out = &mut windows[self.starts[g]..self.starts[g + 1]];
                        driven += self.speeds.shares()[g] * window.weigh(likelihood, out);
                    }
                }
            }
            let seen = self.views.as_ref().zip(control.view);
            let factors = seen.map_or(Factors::NONE, |(views, view)| views.rates.factors(view).0);
            let standing = self.standing_share();
            let driven = driven * (standing * factors.standing + (1.0 - standing) * factors.moved);
            let off = self.off_map.map(|off| Off {
                enter: off.leave * driven,
                stay: (1.0 - off.back) * driven,
                back: off.back * driven,
                each: (1.0 - off.near) / self.line.places as f64,
                is_anywhere: off.near == 0.0,
                within: off.within,
            });
            let keep = self.off_map.map_or(1.0, |off| 1.0 - off.leave);
            work(Step { route: self, windows, factors, keep, off })
        })
    }

    /// Share of the time for which the vehicle stands.
    fn standing_share(&self) -> f64 {
        let speeds = self.speeds.values().iter().zip(self.speeds.shares());
        speeds.filter(|(v, _)| **v == 0.0).map(|(_, share)| share).sum()
    }

    /// The logarithm that is divided out of the entries of a step with evidence.
    pub(super) fn log_factor(&self, control: &RouteControl) -> Option<f64> {
        let seen = self.views.as_ref().zip(control.view);
        let view = seen.map(|(views, view)| views.rates.factors(view).1);
        let driven = control.odometry.map(|_| self.odometry.log_peak());
        (view.is_some() || driven.is_some()).then(|| view.unwrap_or(0.0) + driven.unwrap_or(0.0))
    }
}

impl Step<'_> {
    /// The weights of a speed.
    pub(super) fn window(&self, speed: usize) -> &[f64] {
        &self.windows[self.route.starts[speed]..self.route.starts[speed + 1]]
    }

    /// The likelihood of the view for a way.
    pub(super) fn seen(&self, from: usize, to: usize) -> f64 {
        self.factors.of(self.route.class(from, to))
    }

    /// The probability of coming back at a place.
    fn returns(&self, off: &Off, left: usize, to: usize) -> f64 {
        let line = self.route.line;
        let near = line.near(left, off.within).any(|place| place == to);
        let share = if near { self.route.near_shares[left] } else { 0.0 };
        share + off.each
    }

    /// The entries out of a state, as states and parts, in ascending order.
    pub(super) fn column(&self, from: usize, mut work: impl FnMut(usize, Parts)) {
        let (route, n, k) = (self.route, self.route.line.places, self.route.k());
        let (g, i) = (from / n, from % n);
        for new in 0..k {
            if g < k {
                let mix = route.switching[new * k + g];
                for j in route.line.targets(route.span_of(new), i) {
                    let way = route.way(new, self.window(new), i, j);
                    work(new * n + j, [self.keep, mix, way, self.seen(i, j)]);
                }
            } else if let Some(off) = &self.off {
                for j in 0..n {
                    let share = route.speeds.shares()[new];
                    work(new * n + j, [off.back, share, self.returns(off, i, j), 1.0]);
                }
            }
        }
        if let Some(off) = &self.off {
            let into = if g < k { off.enter } else { off.stay };
            work(k * n + i, [into, 1.0, 1.0, 1.0]);
        }
    }

    /// The entries into a state, in the same way.
    pub(super) fn row(&self, to: usize, mut work: impl FnMut(usize, Parts)) {
        let (route, n, k) = (self.route, self.route.line.places, self.route.k());
        let (new, j) = (to / n, to % n);
        for g in 0..k {
            if new < k {
                let mix = route.switching[new * k + g];
                for i in route.line.sources(route.span_of(new), j) {
                    let way = route.way(new, self.window(new), i, j);
                    work(g * n + i, [self.keep, mix, way, self.seen(i, j)]);
                }
            } else if let Some(off) = &self.off {
                work(g * n + j, [off.enter, 1.0, 1.0, 1.0]);
            }
        }
        if let Some(off) = &self.off {
            if new == k {
                return work(to, [off.stay, 1.0, 1.0, 1.0]);
            }
            for i in 0..n {
                let share = route.speeds.shares()[new];
                work(k * n + i, [off.back, share, self.returns(off, i, j), 1.0]);
            }
        }
    }
}
