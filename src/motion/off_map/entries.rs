//! Entries to and from the state off the map: the last of each row and column, so order is kept.

use std::iter::once;

use super::OffMapTransition;
use crate::transition::{Transition, TransitionEntries, best_of, check_slices};
use wayfix_kernels::log2;

impl<A: Transition> OffMapTransition<A> {
    /// Lists a row, given its moves on the map: `entry` turns probabilities into entries, and those
    /// up to `zero` are left out.
    fn row(
        &self,
        to: usize,
        moves: impl Iterator<Item = (usize, f64)>,
        entry: impl Fn(f64) -> f64,
        zero: f64,
    ) -> impl Iterator<Item = (usize, f64)> {
        let n = self.off_map_state();
        // All other states lead into the state off the map at the same rate; no move of A does.
        let (leavers, back) =
            if to == n { (0..n, self.stay) } else { (0..0, self.jumps.jump_probabilities[to]) };
        let (leave, back) = (entry(self.leave), entry(back));
        let entries = moves.chain(leavers.map(move |j| (j, leave))).chain(once((n, back)));
        entries.filter(move |entry| entry.1 > zero)
    }

    /// Lists a column, given its moves on the map; `returns` gives the entries of coming back.
    fn column(
        &self,
        from: usize,
        moves: impl Iterator<Item = (usize, f64)>,
        returns: impl Fn(usize) -> f64,
        entry: impl Fn(f64) -> f64,
        zero: f64,
    ) -> impl Iterator<Item = (usize, f64)> {
        let n = self.off_map_state();
        assert!(from <= n, "there is no state {from}");
        let (returned, last) = if from == n { (0..n, self.stay) } else { (0..0, self.leave) };
        let last = entry(last);
        let entries = moves.chain(returned.map(move |i| (i, returns(i)))).chain(once((n, last)));
        entries.filter(move |entry| entry.1 > zero)
    }
}

impl<A: TransitionEntries> TransitionEntries for OffMapTransition<A> {
    fn incoming(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let weight = self.jumps.log_factor(control).exp();
        let moves = (to < self.off_map_state()).then(|| self.jumps.inner.incoming(control, to));
        let moves = self.jumps.scaled_entries(moves.into_iter().flatten());
        self.row(to, moves, move |p| weight * p, 0.0)
    }

    fn outgoing(&self, control: &A::Control, from: usize) -> impl Iterator<Item = (usize, f64)> {
        let weight = self.jumps.log_factor(control).exp();
        let moves = (from < self.off_map_state()).then(|| self.jumps.inner.outgoing(control, from));
        let moves = self.jumps.scaled_entries(moves.into_iter().flatten());
        self.column(
            from,
            moves,
            move |i| weight * self.jumps.jump_probabilities[i],
            move |p| weight * p,
            0.0,
        )
    }

    fn incoming_log2(&self, control: &A::Control, to: usize) -> impl Iterator<Item = (usize, f64)> {
        let (inner, log2_off) = (&self.jumps.inner, self.jumps.log2_factor(control));
        let moves = (to < self.off_map_state()).then(|| inner.incoming_log2(control, to));
        let moves = self.jumps.scaled_log2(moves.into_iter().flatten());
        self.row(to, moves, move |p| log2(p) + log2_off, f64::NEG_INFINITY)
    }

    fn outgoing_log2(
        &self,
        control: &A::Control,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let (inner, log2_off) = (&self.jumps.inner, self.jumps.log2_factor(control));
        let moves = (from < self.off_map_state()).then(|| inner.outgoing_log2(control, from));
        let moves = self.jumps.scaled_log2(moves.into_iter().flatten());
        let returns = move |i: usize| self.jumps.log2_jump_probabilities[i] + log2_off;
        self.column(from, moves, returns, move |p| log2(p) + log2_off, f64::NEG_INFINITY)
    }

    fn entries_need_logs(&self, control: &A::Control) -> bool {
        self.jumps.inner.entries_need_logs(control)
            || self.jumps.need_logs(control, &[self.leave, self.stay])
    }

    fn max_product(&self, control: &A::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
        check_slices(self.states(), x, out);
        let n = self.off_map_state();
        // Every entry of A has the same factor, so the best moves on the map stay the best; off the
        // map, the best predecessor is the first of the best states. Ways back come from the last
        // state, so on a tie they lose: they must be strictly better.
        self.jumps.inner.max_product(control, &x[..n], &mut out[..n], &mut from[..n]);
        let keep = log2(self.jumps.move_probability);
        out[..n].iter_mut().for_each(|out| *out += keep);
        let log2_off = self.jumps.log2_factor(control);
        let leave = log2(self.leave) + log2_off;
        (out[n], from[n]) = best_of((0..n as u32).map(|j| (j, leave)), x);
        let returns = self.jumps.log2_jump_probabilities.iter().copied().chain([log2(self.stay)]);
        for ((out, from), log2) in out.iter_mut().zip(from).zip(returns) {
            let value = (log2 + log2_off) + x[n];
            if value > *out {
                (*out, *from) = (value, n as u32);
            }
        }
    }
}
