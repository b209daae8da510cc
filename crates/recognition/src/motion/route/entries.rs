//! Single entries of A_u, and the step of Viterbi. G has rank one but for neighbours on the grid of
//! speeds; yet maxima do not factor as sums do, so Viterbi takes k² passes over the places.

use super::step::{Off, Step};
use super::{RouteControl, RouteTransition};
use wayfix::TransitionEntries;
use wayfix::internal::{buffers, check_slices};
use wayfix_kernels::log2;

impl TransitionEntries for RouteTransition {
    fn incoming(&self, control: &RouteControl, to: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.row(to, |from, parts| entries.push((from, parts.into_iter().product())));
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > 0.0)
    }

    fn outgoing(&self, control: &RouteControl, from: usize) -> impl Iterator<Item = (usize, f64)> {
        assert!(from < self.count(), "there is no state {from}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.column(from, |to, parts| entries.push((to, parts.into_iter().product())));
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > 0.0)
    }

    fn incoming_log2(
        &self,
        control: &RouteControl,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        assert!(to < self.count(), "there is no state {to}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.row(to, |from, parts| entries.push((from, parts.into_iter().map(log2).sum())));
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > f64::NEG_INFINITY)
    }

    fn outgoing_log2(
        &self,
        control: &RouteControl,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        assert!(from < self.count(), "there is no state {from}");
        let mut entries = Vec::new();
        self.with_step(control, |step, _| {
            step.column(from, |to, parts| entries.push((to, parts.into_iter().map(log2).sum())));
        });
        entries.into_iter().filter(|entry: &(usize, f64)| entry.1 > f64::NEG_INFINITY)
    }

    fn max_product(&self, control: &RouteControl, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.count(), x, out);
        self.with_step(control, |step, _| step.max_product(x, out, from));
    }
}

impl Step<'_> {
    fn max_product(&self, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        let (n, k) = (self.route.line.places, self.route.k());
        buffers::with_two(n, |returned, left| {
            let mut returned = Best { scores: returned, from: left };
            returned.clear();
            if let Some(off) = &self.off {
                self.best_return(off, &x[k * n..], &mut returned);
            }
            buffers::with_two(n, |mixed, origin| {
                let mut mixed = Best { scores: mixed, from: origin };
                // For each new speed: first the best old speed at each place, then the best move
                // from there. The factor of G depends on the speeds alone and that of the move on
                // the places, so the two maxima separate.
                buffers::with(n, |states| {
                    for new in 0..k {
                        let mut best = Best { scores: &mut out[new * n..][..n], from: states };
                        best.clear();
                        mixed.clear();
                        for g in 0..k {
                            let share = log2(self.route.switching[new * k + g]) + log2(self.keep);
                            let scores = x[g * n..][..n].iter().map(|x| x + share);
                            mixed.offer(0, scores.zip((g * n..).map(encoded)));
                        }
                        self.go(new, &mixed, &mut best);
                        let share = log2(self.route.speeds.shares()[new]);
                        // A way back arrives at this speed with its share. It may tie with a move on
                        // the map: `offer` then takes the lower state.
                        let moves = returned.scores.iter().map(|x| x + share);
                        best.offer(0, moves.zip(returned.from.iter().copied()));
                        for (from, state) in from[new * n..].iter_mut().zip(&*best.from) {
                            *from = decoded(*state);
                        }
                    }
                });
            });
        });
        let Some(off) = &self.off else { return };
        buffers::with(n, |states| {
            let mut best = Best { scores: &mut out[k * n..], from: states };
            best.clear();
            // From any speed at the same place, or from off the map (g = k) at the same place.
            for g in 0..=k {
                let into = log2(if g < k { off.enter } else { off.stay });
                let scores = x[g * n..][..n].iter().map(|x| x + into);
                best.offer(0, scores.zip((g * n..).map(encoded)));
            }
            for (from, state) in from[k * n..].iter_mut().zip(&*best.from) {
                *from = decoded(*state);
            }
        });
    }

    /// Offers to the places of a speed the moves of its window from places with these scores.
    fn go(&self, new: usize, mixed: &Best<'_>, best: &mut Best<'_>) {
        let (route, window) = (self.route, self.window(new));
        // Around a short loop, several moves join the same two places: their weights add up to one
        // entry, which the taps, a move each, would offer in parts. All places then go entry by
        // entry.
        let laps = route.line.closed && window.len() > route.line.places;
        let alone = if laps { 0..0 } else { 0..route.line.places };
        for (places, taps) in route.stencils[new][0].runs(alone) {
            for (first, weight, stays) in taps {
                let added = log2(window[weight]) + log2(self.factors.of(stays));
                for (span, at) in route.line.spans(first, places.len()) {
                    let scores = mixed.scores[span.clone()].iter().map(|x| x + added);
                    best.offer(places.start + at, scores.zip(mixed.from[span].iter().copied()));
                }
            }
        }
        let ends = route.line.ends().chain((0..route.line.places).filter(|_| laps));
        for end in ends {
            for i in route.line.sources(route.span_of(new), end) {
                let [weight, seen] = self.move_factors(new, i, end).map(log2);
                let score = mixed.scores[i] + (weight + seen);
                best.offer(end, std::iter::once((score, mixed.from[i])));
            }
        }
    }

    /// Finds the best way back to each place, before the share of the speed.
    fn best_return(&self, off: &Off, x: &[f64], best: &mut Best<'_>) {
        let (line, first) = (self.route.line, self.route.k() * x.len());
        let back = log2(off.back);
        // The best place to have left, the lowest on ties. Places near it get a second, larger
        // offer of the same move below, which includes its uniform part.
        let mut top = 0;
        for (i, score) in x.iter().enumerate() {
            if *score > x[top] {
                top = i;
            }
        }
        let anywhere = (x[top] + back + log2(off.each), encoded(first + top));
        best.offer(0, std::iter::repeat_n(anywhere, x.len()));
        for (i, score) in x.iter().enumerate().filter(|entry| *entry.1 > f64::NEG_INFINITY) {
            let returning = back + log2(self.route.near_shares[i] + off.each);
            for j in line.near(i, off.within) {
                best.offer(j, std::iter::once((score + returning, encoded(first + i))));
            }
        }
    }
}

/// Scores of places, and the states they come from. States are encoded as doubles, so that a vector
/// register holds as many of them as of scores.
struct Best<'a> {
    scores: &'a mut [f64],
    from: &'a mut [f64],
}

/// 2^52: a state added to it gives a double whose low bits are the state, as the spacing of doubles
/// from 2^52 to 2^53 is 1.
const ZERO: f64 = (1_u64 << 52) as f64;

/// Encodes a state, below 2^32, as a double.
fn encoded(state: usize) -> f64 {
    ZERO + state as f64
}

/// Decodes a state: the low 32 bits.
fn decoded(state: f64) -> u32 {
    state.to_bits() as u32
}

impl Best<'_> {
    fn clear(&mut self) {
        self.scores.fill(f64::NEG_INFINITY);
        self.from.fill(ZERO);
    }

    /// Offers moves with these scores to consecutive places. The lowest state wins ties, whatever
    /// the order of offers.
    fn offer(&mut self, to: usize, moves: impl Iterator<Item = (f64, f64)>) {
        let best = self.scores[to..].iter_mut().zip(&mut self.from[to..]);
        // Selections instead of branches, which vectorise. A place without a way keeps state 0,
        // as −∞ ties with −∞; its score says that there is none.
        for ((score, from), (value, state)) in best.zip(moves) {
            let lower = if state < *from { state } else { *from };
            let tied = if value == *score { lower } else { *from };
            *from = if value > *score { state } else { tied };
            *score = if value > *score { value } else { *score };
        }
    }
}
