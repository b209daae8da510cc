//! Single entries, and the step of Viterbi.

use super::super::{TransitionEntries, buffers, check_slices};
use super::step::{Inverse, Step, product};
use super::{RouteControl, RouteTransition};
use crate::kernels::log2;

impl TransitionEntries for RouteTransition {
    fn incoming(&self, control: &RouteControl, to: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let mut entries = Vec::new();
        self.with_step(control, false, &mut |step| {
            let row = step.row(to).map(|(from, parts)| (from, product(parts)));
            entries.extend(row.filter(|entry| entry.1 > 0.0));
        });
        entries.into_iter()
    }

    fn outgoing(&self, control: &RouteControl, from: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(from < self.count(), "there is no state {from}");
        let mut entries = Vec::new();
        self.with_step(control, false, &mut |step| {
            let column = step.column(from).map(|(to, parts)| (to, product(parts)));
            entries.extend(column.filter(|entry| entry.1 > 0.0));
        });
        entries.into_iter()
    }

    fn incoming_log2(
        &self,
        control: &RouteControl,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let mut entries = Vec::new();
        self.with_step(control, false, &mut |step| {
            let row = step.row(to).map(|(from, parts)| (from, parts.map(log2).iter().sum::<f64>()));
            entries.extend(row.filter(|entry| entry.1 > f64::NEG_INFINITY));
        });
        entries.into_iter()
    }

    fn max_product(&self, control: &RouteControl, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.count(), x, out);
        self.with_step(control, true, &mut |step| step.max_product(x, out, from));
    }
}

/// The best way to each place so far: its score, and the state that it comes
/// from, as a double that is as wide as the score: vector registers hold both.
struct Best<'a> {
    scores: &'a mut [f64],
    from: &'a mut [f64],
}

/// 2^52, to which states are added: the low bits of the double are the state.
const ZERO: f64 = (1_u64 << 52) as f64;

impl Best<'_> {
    fn clear(&mut self) {
        self.scores.fill(f64::NEG_INFINITY);
        self.from.fill(ZERO);
    }

    /// Offers to places, one after the other, ways with these scores. Of equal
    /// ones, that from the lowest state stays, whatever the order.
    fn offer(&mut self, to: usize, ways: impl Iterator<Item = (f64, f64)>) {
        let best = self.scores[to..].iter_mut().zip(&mut self.from[to..]);
        for ((score, from), (value, state)) in best.zip(ways) {
            let lower = if state < *from { state } else { *from };
            let tied = if value == *score { lower } else { *from };
            *from = if value > *score { state } else { tied };
            *score = if value > *score { value } else { *score };
        }
    }
}

impl Step<'_> {
    fn max_product(&self, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        let (tables, n) = (&self.tables, self.tables.route.places);
        buffers::with(x.len(), |scores| {
            self.divide(x, scores);
            buffers::with_two(n, |mixed, origin| {
                buffers::with(n, |states| {
                    let gears = out.chunks_exact_mut(n).zip(from.chunks_exact_mut(n));
                    for (to, (out, from)) in gears.enumerate() {
                        let mut best = Best { scores: out, from: states };
                        best.clear();
                        for row in tables.rows() {
                            let mut mixed = Best { scores: mixed, from: origin };
                            mixed.clear();
                            for (g, share) in tables.shares(row, to) {
                                let (share, first) = (log2(share), g * n);
                                let scores = scores[first..first + n].iter().map(|x| x + share);
                                mixed.offer(0, scores.zip((first..).map(|i| ZERO + i as f64)));
                            }
                            self.go(row, to, &mixed, &mut best);
                        }
                        for (from, state) in from.iter_mut().zip(&*best.from) {
                            *from = state.to_bits() as u32;
                        }
                    }
                });
            });
        });
    }

    /// Scores with those of 1 / Z.
    fn divide(&self, x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(x);
        if let Inverse::Known(inverse) = self.inverse {
            // Along a route 1 / Z is often the same as before.
            let mut last = (1.0, 0.0);
            for (score, &inverse) in out.iter_mut().zip(inverse) {
                if inverse != last.0 {
                    last = (inverse, log2(inverse));
                }
                *score += last.1;
            }
        }
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
