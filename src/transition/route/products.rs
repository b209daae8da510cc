//! Products with vectors, in loops along the places.

use super::super::odometry::Odometry;
use super::super::{Transition, buffers, check_slices, log};
use super::step::{Inverse, Step, product};
use super::tables::Tables;
use super::views::Factors;
use super::{RouteControl, RouteTransition};
use crate::error::TransitionError;

impl RouteTransition {
    /// What a weight becomes by the view at another place that looks alike, and
    /// at one that does not; for a move of 0 both are as for standing.
    fn seen(&self, factors: Option<Factors>, weight: f64, m: isize) -> (f64, f64) {
        match factors {
            None => (weight, weight),
            Some([standing, ..]) if self.stands(m) => (weight * standing, weight * standing),
            Some([_, alike, moved]) => (weight * alike, weight * moved),
        }
    }

    /// `out[to] += x[from] · weight` over two ranges of places.
    fn add(
        &self,
        (out, to): (&mut [f64], usize),
        (x, from): (&[f64], usize),
        count: usize,
        (alike, moved): (f64, f64),
    ) {
        let (out, x) = (&mut out[to..to + count], &x[from..from + count]);
        match &self.views {
            Some(views) if alike != moved => {
                let (a, b) = (&views.stretches[to..to + count], &views.stretches[from..]);
                for (((out, x), a), b) in out.iter_mut().zip(x).zip(a).zip(b) {
                    *out += x * if a == b { alike } else { moved };
                }
            }
            _ => out.iter_mut().zip(x).for_each(|(out, x)| *out += x * moved),
        }
    }
}

/// The weight of an entry at an end, of which the sum is made as in [`Step`].
type AtEnd<'a> = &'a mut dyn FnMut(usize, usize, f64);

impl Tables<'_> {
    /// Goes through the weights of ways that lead to the ends: (from, to, weight).
    pub(super) fn at_ends(&self, factors: Option<Factors>, row: usize, to: usize, work: AtEnd<'_>) {
        let route = self.route;
        for end in route.ends() {
            for from in route.sources(to, end) {
                let way = route.way(to, self.row(row, to), from, end);
                work(from, end, way * factors.map_or(1.0, |f| f[route.kind(from, end)]));
            }
        }
    }

    /// `out[j] += Σ` over i of window(i → j) e(i, j) `x[i]`.
    fn push(&self, factors: Option<Factors>, row: usize, to: usize, x: &[f64], out: &mut [f64]) {
        let route = self.route;
        for (m, &weight) in route.gears[to].moves().zip(self.row(row, to)) {
            if weight > 0.0 {
                let weight = route.seen(factors, weight, m);
                for (from, start) in route.pieces(m) {
                    route.add((out, start), (x, from.start), from.len(), weight);
                }
            }
        }
        self.at_ends(factors, row, to, &mut |i, j, weight| out[j] += weight * x[i]);
    }

    /// `out[i] += Σ` over j of window(i → j) e(i, j) `x[j]`.
    fn pull(&self, factors: Option<Factors>, row: usize, to: usize, x: &[f64], out: &mut [f64]) {
        let route = self.route;
        for (m, &weight) in route.gears[to].moves().zip(self.row(row, to)) {
            if weight > 0.0 {
                let weight = route.seen(factors, weight, m);
                for (from, start) in route.pieces(m) {
                    route.add((out, from.start), (x, start), from.len(), weight);
                }
            }
        }
        self.at_ends(factors, row, to, &mut |i, j, weight| out[i] += weight * x[j]);
    }

    /// The product with the transpose, but for 1 / Z; `x` of a gear at a time.
    fn pull_all<'x>(
        &self,
        factors: Option<Factors>,
        x: impl Fn(usize) -> &'x [f64],
        out: &mut [f64],
    ) {
        let n = self.route.places;
        out.fill(0.0);
        buffers::with(n, |pulled| {
            for row in self.rows() {
                for to in 0..self.route.gears() {
                    pulled.fill(0.0);
                    self.pull(factors, row, to, x(to), pulled);
                    for (g, share) in self.shares(row, to) {
                        let out = &mut out[g * n..][..n];
                        out.iter_mut().zip(&*pulled).for_each(|(out, x)| *out += share * x);
                    }
                }
            }
        });
    }

    /// 1 / Z of all states.
    pub(super) fn invert(&self, factors: Factors, out: &mut [f64]) {
        buffers::with(self.route.places, |ones| {
            ones.fill(1.0);
            let ones = &*ones;
            self.pull_all(Some(factors), |_| ones, out);
        });
        out.iter_mut().for_each(|out| *out = 1.0 / *out);
    }

    /// Z of a state, added up as in [`invert`](Self::invert), to the same bits.
    pub(super) fn sum(&self, factors: Factors, g: usize, i: usize) -> f64 {
        let (route, row) = (self.route, self.rows[g] as usize);
        let mut sum = 0.0;
        for to in 0..route.gears() {
            let mut pulled = 0.0;
            for (m, &weight) in route.gears[to].moves().zip(self.row(row, to)) {
                let mut pieces = route.pieces(m).into_iter();
                if let Some((from, start)) = pieces.find(|(from, _)| from.contains(&i)) {
                    pulled += weight * factors[route.kind(i, i - from.start + start)];
                }
            }
            for end in route.ends() {
                let way = route.way(to, self.row(row, to), i, end);
                pulled += way * factors[route.kind(i, end)];
            }
            sum += self.mix[to * route.gears() + g] * pulled;
        }
        sum
    }
}

impl Step<'_> {
    fn apply(&self, x: &[f64], out: &mut [f64]) {
        let (tables, n) = (&self.tables, self.tables.route.places);
        out.fill(0.0);
        let mixed = |x: &[f64], out: &mut [f64]| {
            buffers::with(n, |mixed| {
                for row in tables.rows() {
                    for (to, out) in out.chunks_exact_mut(n).enumerate() {
                        mixed.fill(0.0);
                        for (g, share) in tables.shares(row, to) {
                            let x = &x[g * n..][..n];
                            mixed.iter_mut().zip(x).for_each(|(out, x)| *out += share * x);
                        }
                        tables.push(self.factors, row, to, mixed, out);
                    }
                }
            });
        };
        match self.inverse {
            Inverse::Known(inverse) => buffers::with(x.len(), |scaled| {
                for ((out, x), inverse) in scaled.iter_mut().zip(x).zip(inverse) {
                    *out = x * inverse;
                }
                mixed(scaled, out);
            }),
            _ => mixed(x, out),
        }
    }

    fn apply_transpose(&self, x: &[f64], out: &mut [f64]) {
        let n = self.tables.route.places;
        // By a power of two, so that none of the factors is above 1: large x
        // would not bear it.
        let largest = self.factors.map_or(1.0, |factors| factors.into_iter().fold(1.0, f64::max));
        let lift = largest.log2().ceil().exp2();
        let factors = self.factors.map(|factors| factors.map(|factor| factor / lift));
        self.tables.pull_all(factors, |to| &x[to * n..][..n], out);
        if let Inverse::Known(inverse) = self.inverse {
            out.iter_mut().zip(inverse).for_each(|(out, inverse)| *out *= inverse * lift);
        }
    }
}

impl Transition for RouteTransition {
    type Control = RouteControl;

    fn states(&self) -> usize {
        self.count()
    }

    fn apply(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        self.with_step(control, true, &mut |step| step.apply(x, out));
    }

    fn apply_transpose(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        self.with_step(control, true, &mut |step| step.apply_transpose(x, out));
    }

    fn apply_log(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        out.fill(f64::NEG_INFINITY);
        self.with_step(control, true, &mut |step| {
            for (from, &x) in x.iter().enumerate() {
                for (to, parts) in step.column(from) {
                    out[to] = log::add(out[to], product(parts).ln() + x);
                }
            }
        });
    }

    fn apply_transpose_log(&self, control: &RouteControl, x: &[f64], out: &mut [f64]) {
        check_slices(self.count(), x, out);
        self.with_step(control, true, &mut |step| {
            for (from, out) in out.iter_mut().enumerate() {
                let column = step.column(from).map(|(to, parts)| (to, product(parts)));
                *out = log::sum(column.filter(|entry| entry.1 > 0.0), x);
            }
        });
    }

    fn check_control(&self, control: &RouteControl) -> Result<(), TransitionError> {
        control.odometry.as_ref().map_or(Ok(()), Odometry::check)
    }
}
