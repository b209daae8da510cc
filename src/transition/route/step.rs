//! The operator of one step, entry by entry.

use super::super::buffers;
use super::tables::Tables;
use super::views::{Factors, View, Views};
use super::{RouteControl, RouteTransition};

/// Everything that the entries of a step are products of: A\[(g', j), (g, i)\] =
/// mix\[g', g\] window_g'(i → j) e(i, j) / Z_g(i).
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) tables: Tables<'a>,
    /// e, or `None` for 1.
    pub(super) factors: Option<Factors>,
    pub(super) inverse: Inverse<'a>,
}

/// Where 1 / Z is had from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Inverse<'a> {
    /// It is within `mix`.
    Mixed,
    /// One value for each state.
    Known(&'a [f64]),
    /// To be worked out where it is needed.
    ByNeed,
}

impl RouteTransition {
    /// The step of a control, for whoever wants all of it, or just a few entries.
    pub(super) fn with_step(
        &self,
        control: &RouteControl,
        all: bool,
        work: &mut dyn FnMut(Step<'_>),
    ) {
        let view = self.views.as_ref().zip(control.view.map(View::index));
        let odometry = control.odometry.as_ref();
        self.with_tables(odometry, view.is_none(), &mut |tables| {
            let Some((views, view)) = view else {
                return work(Step { tables, factors: None, inverse: Inverse::Mixed });
            };
            let (sums, factors) = (views.factors[view], Some(views.factors[view]));
            if odometry.is_none() {
                let inverse = Inverse::Known(&views.inverse[view]);
                return work(Step { tables, factors, inverse });
            }
            if !all {
                return work(Step { tables, factors, inverse: Inverse::ByNeed });
            }
            buffers::with(self.count(), |inverse| {
                tables.invert(sums, inverse);
                work(Step { tables, factors, inverse: Inverse::Known(inverse) });
            });
        });
    }

    /// Which of the factors is for the way between two places.
    pub(super) fn kind(&self, from: usize, to: usize) -> usize {
        let alike = |views: &Views| views.stretches[from] == views.stretches[to];
        match &self.views {
            _ if from == to => 0,
            Some(views) if alike(views) => 1,
            _ => 2,
        }
    }
}

impl Step<'_> {
    /// The numbers that make up an entry.
    pub(super) fn parts(&self, from: (usize, usize), to: (usize, usize)) -> [f64; 4] {
        let (route, ((g, i), (new, j))) = (self.tables.route, (from, to));
        let way = route.way(new, self.tables.window(g, new), i, j);
        let factor = self.factors.map_or(1.0, |factors| factors[route.kind(i, j)]);
        [self.tables.mix[new * route.gears() + g], way, factor, self.inverse(g, i)]
    }

    fn inverse(&self, g: usize, i: usize) -> f64 {
        match (self.inverse, self.factors) {
            (Inverse::Known(inverse), _) => inverse[g * self.tables.route.places + i],
            (Inverse::ByNeed, Some(factors)) => 1.0 / self.tables.sum(factors, g, i),
            _ => 1.0,
        }
    }

    /// The entries out of a state, as states and numbers that make them up, in
    /// ascending order.
    pub(super) fn column(&self, from: usize) -> impl Iterator<Item = (usize, [f64; 4])> + Clone {
        let route = self.tables.route;
        let (g, i) = (from / route.places, from % route.places);
        let inverse = self.inverse(g, i);
        let known = Step { inverse: Inverse::Mixed, ..*self };
        (0..route.gears()).flat_map(move |new| {
            route.targets(new, i).map(move |j| {
                let [mix, way, factor, _] = known.parts((g, i), (new, j));
                (new * route.places + j, [mix, way, factor, inverse])
            })
        })
    }

    /// The entries into a state, in the same way.
    pub(super) fn row(&self, to: usize) -> impl Iterator<Item = (usize, [f64; 4])> {
        let route = self.tables.route;
        let (new, j) = (to / route.places, to % route.places);
        (0..route.gears()).flat_map(move |g| {
            route.sources(new, j).map(move |i| (g * route.places + i, self.parts((g, i), (new, j))))
        })
    }
}

/// The probability that is made up of these numbers.
pub(super) fn product([mix, way, factor, inverse]: [f64; 4]) -> f64 {
    mix * inverse * (way * factor)
}
