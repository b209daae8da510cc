//! Single entries, and the step of Viterbi.

use super::super::{TransitionEntries, buffers, check_slices};
use super::step::{Inverse, Step, product};
use super::{RouteControl, RouteTransition};
use crate::kernels::log2;

impl TransitionEntries for RouteTransition {
    fn incoming(&self, control: &RouteControl, to: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let entries = |step: Step<'_>| {
            let row = step.row(to).map(|(from, parts)| (from, product(parts)));
            row.filter(|entry| entry.1 > 0.0).collect::<Vec<_>>()
        };
        self.with_step(control, false, entries).into_iter()
    }

    fn outgoing(&self, control: &RouteControl, from: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(from < self.count(), "there is no state {from}");
        let entries = |step: Step<'_>| {
            let column = step.column(from).map(|(to, parts)| (to, product(parts)));
            column.filter(|entry| entry.1 > 0.0).collect::<Vec<_>>()
        };
        self.with_step(control, false, entries).into_iter()
    }

    fn incoming_log2(
        &self,
        control: &RouteControl,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let entries = |step: Step<'_>| {
            let row = step.row(to).map(|(from, parts)| (from, parts.map(log2).iter().sum::<f64>()));
            row.filter(|entry| entry.1 > f64::NEG_INFINITY).collect::<Vec<_>>()
        };
        self.with_step(control, false, entries).into_iter()
    }

    fn max_product(&self, control: &RouteControl, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.count(), x, out);
        self.with_step(control, true, |step| step.max_product(x, out, from));
    }
}

/// The best way to each place so far: its score, and where it comes from.
struct Best<'a> {
    scores: &'a mut [f64],
    from: &'a mut [u32],
}

impl Best<'_> {
    /// Offers to places ways with these scores. Of equal ones, that from the
    /// lowest state stays, whatever the order.
    fn offer(&mut self, to: usize, ways: impl Iterator<Item = (f64, u32)>) {
        let best = self.scores[to..].iter_mut().zip(&mut self.from[to..]);
        for ((score, from), (value, state)) in best.zip(ways) {
            let better = value > *score || (value == *score && state < *from);
            *score = if better { value } else { *score };
            *from = if better { state } else { *from };
        }
    }
}

impl Step<'_> {
    fn max_product(&self, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        let (tables, n) = (&self.tables, self.tables.route.places);
        out.fill(f64::NEG_INFINITY);
        from.fill(0);
        buffers::with(x.len(), |scores| {
            scores.copy_from_slice(x);
            if let Inverse::Known(inverse) = self.inverse {
                // Along a route 1 / Z is often the same as before.
                let mut last = (1.0, 0.0);
                for (score, &inverse) in scores.iter_mut().zip(inverse) {
                    if inverse != last.0 {
                        last = (inverse, log2(inverse));
                    }
                    *score += last.1;
                }
            }
            buffers::with(n, |mixed| {
                buffers::with(n, |origin| {
                    let mut mixed = Best { scores: mixed, from: origin };
                    for row in tables.rows() {
                        let gears = out.chunks_exact_mut(n).zip(from.chunks_exact_mut(n));
                        for (to, (scores_to, from)) in gears.enumerate() {
                            mixed.scores.fill(f64::NEG_INFINITY);
                            mixed.from.fill(0);
                            for (g, share) in tables.shares(row, to) {
                                let (share, first) = (log2(share), g * n);
                                let scores = scores[first..first + n].iter();
                                let states = first as u32..;
                                mixed.offer(0, scores.map(|x| x + share).zip(states));
                            }
                            let mut best = Best { scores: scores_to, from };
                            self.go(row, to, &mixed, &mut best);
                        }
                    }
                });
            });
        });
    }

    /// Offers to the places of a gear what comes by its window from those with
    /// these scores.
    fn go(&self, row: usize, to: usize, mixed: &Best<'_>, best: &mut Best<'_>) {
        let (tables, route) = (&self.tables, self.tables.route);
        let factors = self.factors.map(|factors| factors.map(log2));
        for (m, &weight) in route.gears[to].moves().zip(tables.row(row, to)) {
            let (alike, moved) = match factors {
                None => (0.0, 0.0),
                Some([standing, ..]) if route.stands(m) => (standing, standing),
                Some([_, alike, moved]) => (alike, moved),
            };
            let weight = log2(weight);
            for (range, start) in route.pieces(m) {
                let ways = mixed.scores[range.clone()].iter().zip(&mixed.from[range.clone()]);
                match &route.views {
                    Some(views) if alike != moved => {
                        let pairs = views.stretches[range].iter().zip(&views.stretches[start..]);
                        let ways = ways.zip(pairs).map(|((x, state), (a, b))| {
                            (x + (weight + if a == b { alike } else { moved }), *state)
                        });
                        best.offer(start, ways);
                    }
                    _ => best.offer(start, ways.map(|(x, state)| (x + (weight + moved), *state))),
                }
            }
        }
        for end in route.ends() {
            for i in route.sources(to, end) {
                let way = log2(route.way(to, tables.row(row, to), i, end));
                let factor = factors.map_or(0.0, |factors| factors[route.kind(i, end)]);
                let value = mixed.scores[i] + (way + factor);
                best.offer(end, std::iter::once((value, mixed.from[i])));
            }
        }
    }
}
