//! What a step makes of the gears, whatever the place.

use super::super::buffers;
use super::super::odometry::Odometry;
use super::RouteTransition;

/// Below this, odometry is not believed.
const LEAST: f64 = 1e-250;

/// The numerators of A but for e, as G w o = s `mix` `windows`, with a scale s
/// for each column. In both the largest number is 1: nothing that counts
/// underflows, and Z is at least 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tables<'a> {
    pub(super) route: &'a RouteTransition,
    /// Row by row: `mix[to * k + from]`.
    pub(super) mix: &'a [f64],
    /// The weights of all gears by odometry, and then k times more for gears in
    /// which it is not believed.
    pub(super) windows: &'a [f64],
    /// Which of these each old gear goes by.
    pub(super) rows: &'a [u32],
}

impl RouteTransition {
    /// The tables of a step; if it is without a view, `normalised`, A = `mix`
    /// `windows`. Compiled once, whatever the work.
    pub(super) fn with_tables(
        &self,
        odometry: Option<&Odometry>,
        normalised: bool,
        work: &mut dyn FnMut(Tables<'_>),
    ) {
        let (k, width) = (self.gears(), self.width());
        buffers::with((k + 1) * width, |windows| {
            buffers::with_two(k * k, |mix, peaks| {
                buffers::with(k, |rows| {
                    self.tabulate(odometry, windows, mix, &mut peaks[..k], rows);
                    if normalised {
                        let route = self;
                        let tables = Tables { route, mix, windows, rows };
                        let sum = |to, from| tables.window(from, to).iter().sum::<f64>();
                        for (at, out) in peaks.iter_mut().enumerate() {
                            let from = at % k;
                            let parts = (0..k).map(|to| mix[to * k + from] * sum(to, from));
                            *out = mix[at] / parts.sum::<f64>();
                        }
                        mix.copy_from_slice(peaks);
                    }
                    work(Tables { route: self, mix, windows, rows });
                });
            });
        });
    }

    /// The number of weights of all gears.
    pub(super) fn width(&self) -> usize {
        self.starts[self.gears()]
    }

    fn tabulate(
        &self,
        odometry: Option<&Odometry>,
        windows: &mut [f64],
        mix: &mut [f64],
        peaks: &mut [f64],
        rows: &mut [u32],
    ) {
        let (shared, own) = windows.split_at_mut(self.width());
        let Some(odometry) = odometry else {
            self.weigh(shared, peaks, |_| 1.0);
            (0..self.gears()).for_each(|from| _ = self.mix(from, mix, peaks));
            rows.fill(0);
            return;
        };
        self.weigh(shared, peaks, |m| odometry.probability(m));
        for (from, row) in rows.iter_mut().enumerate() {
            let most = self.mix(from, mix, peaks);
            *row = if most < LEAST { from as u32 + 1 } else { 0 };
        }
        for (from, window) in own.chunks_exact_mut(self.width()).enumerate() {
            if rows[from] > 0 {
                let (distance, least) = self.nearest(from, odometry.distance);
                self.weigh(window, peaks, |m| f64::from((m - distance).abs() == least));
                self.mix(from, mix, peaks);
            }
        }
    }

    /// The windows w o of all gears, each divided by its largest weight.
    fn weigh(&self, out: &mut [f64], peaks: &mut [f64], odometry: impl Fn(f64) -> f64) {
        for (g, (gear, peak)) in self.gears.iter().zip(peaks).enumerate() {
            let out = &mut out[self.starts[g]..self.starts[g + 1]];
            for ((out, weight), m) in out.iter_mut().zip(gear.weights()).zip(gear.moves()) {
                *out = if *weight > 0.0 { weight * odometry(m as f64) } else { 0.0 };
            }
            *peak = out.iter().copied().fold(0.0, f64::max);
            if *peak > 0.0 {
                out.iter_mut().for_each(|out| *out /= *peak);
            }
        }
    }

    /// The column of `mix` for windows with these largest weights; returns the
    /// largest numerator.
    fn mix(&self, from: usize, mix: &mut [f64], peaks: &[f64]) -> f64 {
        let k = self.gears();
        let switches = || self.switching[from..].iter().step_by(k).zip(peaks);
        let peak = switches().filter(|way| *way.0 > 0.0).map(|way| *way.1).fold(0.0, f64::max);
        if peak == 0.0 {
            return 0.0;
        }
        // In this order, nothing underflows that is not far below the largest.
        let most = switches().map(|(g, p)| g * (p / peak)).fold(0.0, f64::max);
        for (to, (g, p)) in switches().enumerate() {
            mix[to * k + from] = g * (p / peak) / most;
        }
        peak * most
    }

    /// A distance within the moves from a gear, to which the same of them are
    /// nearest as to the one given, and how near.
    fn nearest(&self, from: usize, distance: f64) -> (f64, f64) {
        let k = self.gears();
        let moves = || {
            let reached = (0..k).filter(|to| self.switching[to * k + from] > 0.0);
            reached.flat_map(|to| {
                let gear = &self.gears[to];
                let moves = gear.moves().zip(gear.weights());
                moves.filter(|way| *way.1 > 0.0).map(|way| way.0 as f64)
            })
        };
        let lowest = moves().fold(f64::INFINITY, f64::min);
        let distance = distance.max(lowest).min(moves().fold(f64::NEG_INFINITY, f64::max));
        let near = moves().map(|m| (m - distance).abs()).fold(f64::INFINITY, f64::min);
        (distance, near)
    }
}

impl Tables<'_> {
    /// The weights of the new gear, for an old one.
    pub(super) fn window(&self, from: usize, to: usize) -> &[f64] {
        self.row(self.rows[from] as usize, to)
    }

    /// The weights of the new gear in a row of windows.
    pub(super) fn row(&self, row: usize, to: usize) -> &[f64] {
        let (start, starts) = (row * self.route.width(), &self.route.starts);
        &self.windows[start + starts[to]..start + starts[to + 1]]
    }

    /// The rows of windows that are gone by, from the lowest on.
    pub(super) fn rows(&self) -> impl Iterator<Item = usize> {
        (0..=self.rows.len()).filter(|row| self.rows.contains(&(*row as u32)))
    }

    /// The old gears that go by a row, with their share of the new one.
    pub(super) fn shares(&self, row: usize, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let shares = self.mix[to * self.rows.len()..].iter().zip(self.rows).enumerate();
        shares
            .filter(move |(_, (p, of))| **of as usize == row && **p > 0.0)
            .map(|(g, (p, _))| (g, *p))
    }
}
