//! Entries: arrivals at the first age of a place, and stays. Where a place has only one age and a
//! move back to itself, both lead to the same state, and add up.

use std::iter::once;
use std::ops::Add;

use super::DwellTransition;
use crate::transition::log::add_log2;
use crate::transition::{Transition, TransitionEntries, best_of, buffers, check_slices, merge};

impl<A: Transition> DwellTransition<A> {
    /// The place of a state, and true if the state has the oldest age there.
    pub(super) fn place(&self, state: usize) -> (usize, bool) {
        let place = self.groups.as_slice()[state];
        (place, state + 1 == self.starts[place + 1])
    }
}

impl<A: TransitionEntries> TransitionEntries for DwellTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let (place, last) = self.place(to);
        let arrives = self.starts[place] == to;
        let moves = arrives.then(|| self.moves.incoming(control, place)).into_iter().flatten();
        let arrivals = moves.flat_map(move |(j, p)| {
            (self.starts[j]..self.starts[j + 1]).map(move |state| (state, p * self.leave[state]))
        });
        // Stays come from the previous age, and into the oldest age also from itself. They ascend,
        // and so do arrivals, which are listed place by place.
        let younger = (!arrives).then(|| to - 1).into_iter();
        let stays = younger.chain(last.then_some(to)).map(move |state| (state, self.stay[state]));
        merge(arrivals, stays, f64::add).filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let (place, last) = self.place(from);
        let older = if last { from } else { from + 1 };
        let moves = self.moves.outgoing(control, place);
        let moves = moves.map(move |(i, p)| (self.starts[i], p * self.leave[from]));
        merge(moves, once((older, self.stay[from])), f64::add).filter(|entry| entry.1 > 0.0)
    }

    fn incoming_log2(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let (place, last) = self.place(to);
        let arrives = self.starts[place] == to;
        let moves = arrives.then(|| self.moves.incoming_log2(control, place)).into_iter().flatten();
        let arrivals = moves.flat_map(move |(j, log2)| {
            (self.starts[j]..self.starts[j + 1])
                .map(move |state| (state, log2 + self.log2_leave[state]))
        });
        let younger = (!arrives).then(|| to - 1).into_iter();
        let stays = younger.chain(last.then_some(to)).map(|state| (state, self.log2_stay[state]));
        merge(arrivals, stays, add_log2).filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        // The best way into a place is the best of the moves from the best departure of each place:
        // O(states) and one max-product of `moves`. Ties go to the lowest place, and within it to
        // the lowest age, which is the lowest state.
        buffers::with_two(self.places(), |leaving, arriving| {
            buffers::with_two(self.places(), |leaver, origin| {
                for (place, range) in self.ranges() {
                    let leave = self.log2_leave[range.clone()].iter().copied();
                    let states = range.start as u32..range.end as u32;
                    (leaving[place], leaver[place]) = best_of(states.zip(leave), x);
                }
                self.moves.max_product(control, leaving, arriving, origin);
                for (place, range) in self.ranges() {
                    let (first, last) = (range.start, range.end - 1);
                    // An unreachable place has no predecessor.
                    let reached = arriving[place] > f64::NEG_INFINITY;
                    out[first] = arriving[place];
                    from[first] = if reached { leaver[origin[place] as usize] } else { 0 };
                    for state in first..last {
                        out[state + 1] = self.log2_stay[state] + x[state];
                        from[state + 1] = state as u32;
                    }
                    let mut stay = self.log2_stay[last];
                    if first == last && self.stay[last] > 0.0 {
                        // The state leads to itself by a stay and by a move: its entry is the sum.
                        let mut moves = self.moves.incoming_log2(control, place);
                        if let Some((_, again)) = moves.find(|entry| entry.0 == place) {
                            stay = add_log2(again + self.log2_leave[last], stay);
                        }
                    }
                    // Staying at the oldest age competes with growing into it, or arriving at it.
                    let (value, state) = (stay + x[last], last as u32);
                    if value > out[last] || (value == out[last] && state < from[last]) {
                        (out[last], from[last]) = (value, state);
                    }
                }
            });
        });
    }
}
