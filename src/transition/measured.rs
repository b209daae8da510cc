//! Operators with a likelihood of moves: A\[i, j\] p(u | j → i), with a log factor taken out
//! (guide, section 2, "Evidence on moves").
//!
//! An entry is an entry of the base times a likelihood, computed anew for each step, so that a
//! product with a belief goes through the columns of the base once. Where entries leave the range
//! of doubles, [`MoveLikelihood::needs_logs`] says so, and inference reads their logarithms.

use std::f64::consts::LOG2_E;

use super::log::{self, LARGEST_LINEAR_ENTRY};
use super::{Transition, TransitionEntries, check_slices};
use crate::error::TransitionError;
use wayfix_kernels as kernels;

/// Likelihood of a measurement between two steps, for the moves of an operator `A`.
pub(crate) trait MoveLikelihood<A: TransitionEntries<Control = ()>> {
    type Measurement: 'static;
    /// Data of a move, stored with the entry of the base.
    type Move: Copy;

    /// Log factor that was taken out of the likelihoods; `None` if nothing was measured.
    fn log_factor(&self, measured: &Self::Measurement) -> Option<f64>;

    /// Returns a function of a move (to, from) and of its stored data, if at hand: its
    /// log-likelihood less the log factor. `None` if nothing was measured.
    fn move_log_likelihood(
        &self,
        base: &A,
        measured: &Self::Measurement,
    ) -> Option<impl Fn(usize, usize, Option<Self::Move>) -> f64>;

    /// Checks that a measurement is valid, and that the log-likelihoods of all moves are.
    fn check(&self, base: &A, measured: &Self::Measurement) -> Result<(), TransitionError>;

    /// True if an entry is out of the range of doubles.
    fn needs_logs(&self, base: &A, measured: &Self::Measurement) -> bool {
        let Some(log) = self.move_log_likelihood(base, measured) else { return false };
        // An impossible move (log-likelihood −∞) is exactly 0 as a double, so it needs no logs.
        let beyond = |log: f64, p: f64| {
            let in_range = f64::MIN_POSITIVE..=LARGEST_LINEAR_ENTRY;
            log > f64::NEG_INFINITY && !in_range.contains(&(p * log.exp()))
        };
        let mut columns = (0..base.states()).map(|from| (from, base.outgoing(&(), from)));
        columns.any(|(from, mut column)| column.any(|(to, p)| beyond(log(to, from, None), p)))
    }

    /// Lists the entries of the base out of a state, each with the stored data of its move.
    fn column(&self, base: &A, from: usize) -> impl Iterator<Item = (usize, f64, Self::Move)>;

    /// As [`column`](Self::column), with the base-2 logarithms of the entries.
    fn column_log2(&self, base: &A, from: usize) -> impl Iterator<Item = (usize, f64, Self::Move)>;
}

/// An operator whose entries are those of the base times the likelihood of a move.
#[derive(Debug, Clone)]
pub(crate) struct WithMoveLikelihood<A, L> {
    pub(crate) base: A,
    pub(crate) likelihood: L,
}

impl<A: TransitionEntries<Control = ()>, L: MoveLikelihood<A>> WithMoveLikelihood<A, L> {
    fn move_log_likelihood(
        &self,
        measured: &L::Measurement,
    ) -> Option<impl Fn(usize, usize, Option<L::Move>) -> f64> {
        self.likelihood.move_log_likelihood(&self.base, measured)
    }
}

impl<A: TransitionEntries<Control = ()>, L: MoveLikelihood<A>> Transition
    for WithMoveLikelihood<A, L>
{
    type Control = L::Measurement;

    fn states(&self) -> usize {
        self.base.states()
    }

    fn apply(&self, measured: &L::Measurement, x: &[f64], out: &mut [f64]) {
        let Some(log) = self.move_log_likelihood(measured) else {
            return self.base.apply(&(), x, out);
        };
        check_slices(self.states(), x, out);
        out.fill(0.0);
        // By columns in both directions, since stored data of moves are found by columns. States
        // without mass are skipped: their likelihoods, the costly part, are not evaluated.
        for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 != 0.0) {
            for (to, p, stored) in self.likelihood.column(&self.base, from) {
                out[to] += p * log(to, from, Some(stored)).exp() * x;
            }
        }
    }

    fn apply_transpose(&self, measured: &L::Measurement, x: &[f64], out: &mut [f64]) {
        let Some(log) = self.move_log_likelihood(measured) else {
            return self.base.apply_transpose(&(), x, out);
        };
        check_slices(self.states(), x, out);
        for (from, out) in out.iter_mut().enumerate() {
            let column = self.likelihood.column(&self.base, from);
            *out =
                column.map(|(to, p, stored)| p * log(to, from, Some(stored)).exp() * x[to]).sum();
        }
    }

    fn apply_log(&self, measured: &L::Measurement, x: &[f64], out: &mut [f64]) {
        let Some(log) = self.move_log_likelihood(measured) else {
            return self.base.apply_log(&(), x, out);
        };
        check_slices(self.states(), x, out);
        out.fill(f64::NEG_INFINITY);
        for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 > f64::NEG_INFINITY) {
            for (to, p, stored) in self.likelihood.column(&self.base, from) {
                out[to] = log::add(out[to], p.ln() + log(to, from, Some(stored)) + x);
            }
        }
    }

    fn apply_transpose_log(&self, measured: &L::Measurement, x: &[f64], out: &mut [f64]) {
        let Some(log) = self.move_log_likelihood(measured) else {
            return self.base.apply_transpose_log(&(), x, out);
        };
        check_slices(self.states(), x, out);
        for (from, out) in out.iter_mut().enumerate() {
            let column = self.likelihood.column(&self.base, from);
            let terms = column.map(|(to, p, stored)| p.ln() + log(to, from, Some(stored)) + x[to]);
            *out = terms.fold(f64::NEG_INFINITY, log::add);
        }
    }

    fn evidence(&self, measured: &L::Measurement) -> Option<f64> {
        self.likelihood.log_factor(measured)
    }

    fn needs_logs(&self, measured: &L::Measurement) -> bool {
        self.likelihood.needs_logs(&self.base, measured)
    }

    fn check_control(&self, measured: &L::Measurement) -> Result<(), TransitionError> {
        self.likelihood.check(&self.base, measured)
    }
}

impl<A: TransitionEntries<Control = ()>, L: MoveLikelihood<A>> TransitionEntries
    for WithMoveLikelihood<A, L>
{
    fn incoming(&self, measured: &L::Measurement, to: usize) -> impl Iterator<Item = (usize, f64)> {
        // Rows of the base come without stored data: the likelihood computes or looks them up.
        let log = self.move_log_likelihood(measured);
        let entry = move |(from, p): (usize, f64)| {
            (from, log.as_ref().map_or(p, |log| p * log(to, from, None).exp()))
        };
        self.base.incoming(&(), to).map(entry).filter(|entry| entry.1 > 0.0)
    }

    fn outgoing(
        &self,
        measured: &L::Measurement,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let log = self.move_log_likelihood(measured);
        let entry = move |(to, p, stored): (usize, f64, L::Move)| {
            (to, log.as_ref().map_or(p, |log| p * log(to, from, Some(stored)).exp()))
        };
        self.likelihood.column(&self.base, from).map(entry).filter(|entry| entry.1 > 0.0)
    }

    fn incoming_log2(
        &self,
        measured: &L::Measurement,
        to: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let log = self.move_log_likelihood(measured);
        let entry = move |(from, log2): (usize, f64)| {
            (from, log2 + log.as_ref().map_or(0.0, |log| log2_of(log(to, from, None))))
        };
        let entries = self.base.incoming_log2(&(), to).map(entry);
        entries.filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    fn outgoing_log2(
        &self,
        measured: &L::Measurement,
        from: usize,
    ) -> impl Iterator<Item = (usize, f64)> {
        let log = self.move_log_likelihood(measured);
        let entry = move |(to, log2, stored): (usize, f64, L::Move)| {
            (to, log2 + log.as_ref().map_or(0.0, |log| log2_of(log(to, from, Some(stored)))))
        };
        let entries = self.likelihood.column_log2(&self.base, from).map(entry);
        entries.filter(|entry| entry.1 > f64::NEG_INFINITY)
    }

    fn max_product(
        &self,
        measured: &L::Measurement,
        x: &[f64],
        out: &mut [f64],
        predecessor: &mut [u32],
    ) {
        let Some(log) = self.move_log_likelihood(measured) else {
            return self.base.max_product(&(), x, out, predecessor);
        };
        check_slices(self.states(), x, out);
        out.fill(f64::NEG_INFINITY);
        predecessor.fill(0);
        // Predecessors come in ascending order, so the lowest wins ties.
        for (from, x) in x.iter().enumerate().filter(|entry| *entry.1 > f64::NEG_INFINITY) {
            for (to, log2, stored) in self.likelihood.column_log2(&self.base, from) {
                let value = log2 + log2_of(log(to, from, Some(stored))) + x;
                if value > out[to] {
                    (out[to], predecessor[to]) = (value, from as u32);
                }
            }
        }
    }
}

/// Base-2 logarithm of a likelihood, on the grid of scores.
fn log2_of(log: f64) -> f64 {
    kernels::on_grid(log * LOG2_E)
}
