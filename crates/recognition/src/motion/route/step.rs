//! The operator of one step, entry by entry: A_u of section 10 of the guide, Route, as four
//! factors. Products multiply them, decoders add them up as logarithms.

use super::views::Factors;
use super::{RouteControl, RouteTransition};
use wayfix::internal::buffers;

/// Factors of the entries of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) route: &'a RouteTransition,
    /// Weights of the moves of all speeds, with the likelihood of the odometry.
    pub(super) windows: &'a [f64],
    pub(super) factors: Factors,
    /// Probability of not leaving the map.
    pub(super) keep: f64,
    pub(super) off: Option<Off>,
}

/// Factors of entries to and from off the map, including the likelihood of the measurements.
#[derive(Debug, Clone, Copy)]
pub(super) struct Off {
    pub(super) enter: f64,
    pub(super) stay: f64,
    pub(super) back: f64,
    /// Probability of coming back at a given place by the uniform part.
    pub(super) each: f64,
    /// True if the vehicle comes back anywhere, with no preference for near places.
    pub(super) is_anywhere: bool,
    pub(super) within: usize,
}

/// Factors of an entry.
pub(super) type Parts = [f64; 4];

impl RouteTransition {
    /// Calls `work` with the step of a control.
    pub(super) fn with_step<R>(
        &self,
        control: &RouteControl,
        work: impl FnOnce(Step<'_>, &[f64]) -> R,
    ) -> R {
        let width = self.starts[self.k()];
        buffers::with_two(width.max(self.k()), |windows, means| {
            // Odometry depends on the speeds v that a grid speed stands for, so that it weights the
            // nodes of its window. The mean over the nodes is the likelihood of the grid speed.
            let (windows, means) = (&mut windows[..width], &mut means[..self.k()]);
            for (g, window) in self.speeds.windows.iter().enumerate() {
                let out = &mut windows[self.starts[g]..self.starts[g + 1]];
                means[g] = match control.odometry {
                    None => {
                        out.copy_from_slice(&window.weights);
                        1.0
                    }
                    Some(reading) => {
                        let likelihood =
                            |v: f64| self.odometry.relative(reading, v, window.spacing);
                        window.weigh(likelihood, out)
                    }
                };
            }
            let seen = self.views.zip(control.view);
            let factors = seen.map_or(Factors::NONE, |(rates, view)| rates.factors(view).0);
            let keep = self.off_map.map_or(1.0, |off| 1.0 - off.leave);
            // `off_map_likelihood` reads the view's factors but not `off`, so the step can be made
            // without it first.
            let mut step = Step { route: self, windows, factors, keep, off: None };
            let driven = step.off_map_likelihood(control, means);
            step.off = self.off_map.map(|off| Off {
                enter: off.leave * driven,
                stay: (1.0 - off.back) * driven,
                back: off.back * driven,
                each: (1.0 - off.near) / self.line.places as f64,
                is_anywhere: off.near == 0.0,
                within: off.within,
            });
            work(step, means)
        })
    }

    /// Log factor taken out of the entries of a step with evidence.
    pub(super) fn log_factor(&self, control: &RouteControl) -> Option<f64> {
        let seen = self.views.zip(control.view);
        let view = seen.map(|(rates, view)| rates.factors(view).1);
        let driven = control.odometry.map(|_| self.odometry.log_peak());
        (view.is_some() || driven.is_some()).then(|| view.unwrap_or(0.0) + driven.unwrap_or(0.0))
    }
}

impl Step<'_> {
    /// The weights of a speed.
    pub(super) fn window(&self, speed: usize) -> &[f64] {
        &self.windows[self.route.starts[speed]..self.route.starts[speed + 1]]
    }

    /// Factors of the entry between two places at a speed: the weight of the move, and the
    /// likelihood of the view.
    pub(super) fn move_factors(&self, speed: usize, from: usize, to: usize) -> [f64; 2] {
        let (route, window) = (self.route, self.window(speed));
        let weight = route.move_weight(speed, window, from, to);
        if from != to || route.line.closed || !route.line.ends().any(|end| end == to) {
            return [weight, self.factors.of(from == to)];
        }
        // Moves beyond an end stop there. The vehicle may stand or have moved on, so such a move
        // takes the lesser of the two likelihoods; the move of 0 is standing.
        let stay = usize::try_from(-route.span_of(speed).0).ok().and_then(|at| window.get(at));
        let stay = stay.copied().unwrap_or(0.0);
        let Factors { standing, moved } = self.factors;
        [stay * standing + (weight - stay).max(0.0) * standing.min(moved), 1.0]
    }

    /// Product of [`move_factors`](Self::move_factors).
    pub(super) fn move_weight(&self, speed: usize, from: usize, to: usize) -> f64 {
        let [weight, seen] = self.move_factors(speed, from, to);
        weight * seen
    }

    /// Probability of coming back at a place.
    fn returns(&self, off: &Off, left: usize, to: usize) -> f64 {
        let line = self.route.line;
        let near = line.near(left, off.within).any(|place| place == to);
        let share = if near { self.route.near_shares[left] } else { 0.0 };
        share + off.each
    }

    /// Visits the entries out of a state, as states and factors, in ascending order.
    pub(super) fn column(&self, from: usize, mut work: impl FnMut(usize, Parts)) {
        let (route, n, k) = (self.route, self.route.line.places, self.route.k());
        let (g, i) = (from / n, from % n);
        for new in 0..k {
            if g < k {
                let mix = route.switching[new * k + g];
                for j in route.line.targets(route.span_of(new), i) {
                    let [weight, seen] = self.move_factors(new, i, j);
                    work(new * n + j, [self.keep, mix, weight, seen]);
                }
            // Back to any place, so the column is dense.
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

    /// Visits the entries into a state, as states and factors, in ascending order.
    pub(super) fn row(&self, to: usize, mut work: impl FnMut(usize, Parts)) {
        let (route, n, k) = (self.route, self.route.line.places, self.route.k());
        let (new, j) = (to / n, to % n);
        for g in 0..k {
            if new < k {
                let mix = route.switching[new * k + g];
                for i in route.line.sources(route.span_of(new), j) {
                    let [weight, seen] = self.move_factors(new, i, j);
                    work(g * n + i, [self.keep, mix, weight, seen]);
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
