//! The needs of a step, and the least time that they take.

use std::collections::HashSet;

use wayfix::{SparseTransition, Transition, TransitionEntries};

use crate::ceilings::{Bandwidth, Machine, fresh, gathers};

/// Needs of a step; the results are those of all steps.
#[derive(Default)]
pub(crate) struct Needs {
    /// Bytes, and the working set that they are of.
    pub(crate) bytes: Vec<(usize, usize)>,
    /// Seconds.
    pub(crate) gathers: f64,
    pub(crate) operations: usize,
    /// Multiplications and additions that wait for each other.
    pub(crate) chain: (f64, f64),
    /// Results, and bytes of each.
    pub(crate) fresh: Option<(usize, usize)>,
    /// Processors, if more than one.
    pub(crate) threads: usize,
}

/// Needs in seconds.
pub(crate) struct Bound {
    /// Longest of the times that may overlap.
    pub(crate) parts: [(&'static str, f64); 4],
    pub(crate) fresh: f64,
}

impl Needs {
    pub(crate) fn bound(self, machine: &Machine, steps: usize) -> Bound {
        let threads = self.threads.max(1);
        let moved = |(bytes, set)| bytes as f64 / Bandwidth::of(set, threads).best();
        let bytes = self.bytes.into_iter().map(moved).fold(0.0, f64::max);
        let operations = 2.0 * self.operations as f64 / machine.peak;
        let (multiplications, additions) = self.chain;
        let chain = multiplications * machine.multiplication + additions * machine.addition;
        let parts = [
            ("bytes", bytes),
            ("gathers", self.gathers / threads as f64),
            ("operations", operations / threads as f64),
            ("chain", chain),
        ];
        let fresh = self.fresh.map_or(0.0, |(count, bytes)| fresh(count, bytes) / steps as f64);
        Bound { parts, fresh }
    }
}

/// Matrix, as a product has to read it.
#[derive(Clone, Copy)]
pub(crate) struct Matrix {
    pub(crate) states: usize,
    pub(crate) bytes: usize,
    pub(crate) entries: usize,
    /// Seconds.
    gathers: f64,
}

impl Matrix {
    pub(crate) fn dense(n: usize) -> Self {
        Self { states: n, bytes: 8 * n * n, entries: n * n, gathers: 0.0 }
    }

    pub(crate) fn sparse(a: &SparseTransition) -> Self {
        let (n, entries) = (a.states(), a.entries());
        let gathered = gathered(a);
        let bytes = 8 * entries + 4 * gathered.len();
        Self { states: n, bytes, entries, gathers: gathers(n, &gathered) }
    }

    /// A step of the filter, in a sequence of this many steps.
    pub(crate) fn filter(self, seen: usize) -> Needs {
        let Self { states: n, bytes, entries, gathers } = self;
        let bytes = vec![(bytes + 16 * n, bytes + 16 * n), (8 * n, 8 * n * seen)];
        Needs { bytes, gathers, operations: 2 * entries, ..Needs::default() }
    }

    /// A step of the smoother, there and back.
    pub(crate) fn smooth(self, steps: usize) -> Needs {
        let Self { states: n, bytes, entries, gathers } = self;
        let (products, result) = (2 * bytes + 32 * n, 8 * n * (steps + 1));
        let bytes = vec![(products, products), (16 * n, 8 * n * steps), (16 * n, result)];
        let (gathers, fresh) = (2.0 * gathers, Some((1, result)));
        Needs { bytes, gathers, operations: 4 * entries, fresh, ..Needs::default() }
    }

    /// A step of the decoder, with scores of observations of this many bytes.
    pub(crate) fn viterbi(self, steps: usize, scores: usize) -> Needs {
        let Self { states: n, bytes, entries, gathers } = self;
        let bytes = vec![(bytes + 16 * n, bytes + 16 * n), (8 * n, scores)];
        let fresh = Some((1, 4 * n * steps));
        Needs { bytes, gathers, operations: 4 * entries, fresh, ..Needs::default() }
    }

    /// A step of the smoother in lock-step, for this number of sequences and steps.
    pub(crate) fn smooth_all(self, count: usize, steps: usize) -> Needs {
        let Self { states: n, entries, .. } = self;
        let kept = 2 * 64 * n * (steps + 1);
        // Likelihoods are read, results cleared by the system and written.
        let bytes = vec![(32 * n, kept), (24 * n, 16 * n * count * steps)];
        // Beside the products, for each state: a multiplication by the likelihood, divisions by the
        // sum and the prediction, and multiplications by the likelihood again and by the belief.
        let operations = 4 * entries + 5 * n;
        Needs { bytes, operations, ..Needs::default() }
    }
}

/// The indices of the loads of x: one for each diagonal among eight rows, since entries on one
/// diagonal can be loaded side by side.
fn gathered(a: &SparseTransition) -> Vec<u32> {
    let n = a.states();
    let mut indices = Vec::new();
    for first in (0..n).step_by(8) {
        let rows = first..(first + 8).min(n);
        let entries = rows.flat_map(|to| a.incoming(&(), to).map(move |(from, _)| (to, from)));
        let mut seen = HashSet::new();
        let is_new = |&(to, from): &(usize, usize)| seen.insert(n + from - to);
        indices.extend(entries.filter(is_new).map(|entry| entry.1 as u32));
    }
    indices
}
