//! Active set: the few states among millions that are followed, and the candidates for the next.
//!
//! The invariant: between steps no candidate bits are set but those of the states listed last, so
//! that clearing costs O(candidates), never O(n).

use crate::transition::TransitionEntries;

/// Active set and candidates. A dense array instead of hashing: 4 bytes a state, and one bit a
/// state for the candidates.
#[derive(Debug, Clone)]
pub(crate) struct ActiveSet {
    /// Position of each state in the active set plus one, or 0.
    positions: Vec<u32>,
    /// Bit set of the candidates that an active state leads to, without those only named.
    reached: Vec<u64>,
    candidates: Vec<usize>,
}

impl ActiveSet {
    pub(crate) fn new(states: usize) -> Self {
        let reached = vec![0; states.div_ceil(64)];
        Self { positions: vec![0; states], reached, candidates: Vec::new() }
    }

    /// Returns the position of a state in the active set.
    #[inline]
    pub(crate) fn position(&self, state: usize) -> Option<usize> {
        (self.positions[state] as usize).checked_sub(1)
    }

    /// Replaces the active set.
    pub(crate) fn replace(&mut self, before: &[usize], after: &[usize]) {
        before.iter().for_each(|&state| self.positions[state] = 0);
        for (&state, position) in after.iter().zip(1..) {
            self.positions[state] = position;
        }
    }

    /// Lists the candidates: the states that a step can reach from the active ones (without a
    /// transition, these themselves), and all named states.
    pub(crate) fn list<A: TransitionEntries>(
        &mut self,
        followed: &[usize],
        moves: Option<(&A, &A::Control)>,
        named: &[usize],
    ) {
        let Self { reached, candidates, .. } = self;
        // Only words that were set are cleared: a step must not cost O(n).
        candidates.iter().for_each(|&state| reached[state / 64] = 0);
        candidates.clear();
        let mut list = |state: usize| {
            let (word, bit) = (&mut reached[state / 64], 1 << (state % 64));
            if *word & bit == 0 {
                *word |= bit;
                candidates.push(state);
            }
        };
        match moves {
            // The linear form would not list entries below the range of doubles.
            Some((a, control)) if a.evidence(control).is_some() && a.entries_need_logs(control) => {
                let entries = followed.iter().flat_map(|&j| a.outgoing_log2(control, j));
                entries.for_each(|(i, _)| list(i));
            }
            Some((a, control)) => {
                followed.iter().for_each(|&j| a.outgoing(control, j).for_each(|(i, _)| list(i)));
            }
            None => followed.iter().for_each(|&state| list(state)),
        }
        self.add_named(named);
    }

    /// Lists the candidates: the states for which `leads` is true, which has a value for each state
    /// in order, and all named states.
    pub(crate) fn list_reached(&mut self, leads: impl Iterator<Item = bool>, named: &[usize]) {
        let Self { reached, candidates, .. } = self;
        candidates.iter().for_each(|&state| reached[state / 64] = 0);
        candidates.clear();
        for (state, _) in leads.enumerate().filter(|entry| entry.1) {
            reached[state / 64] |= 1 << (state % 64);
            candidates.push(state);
        }
        if !named.is_empty() {
            self.add_named(named);
        }
    }

    fn add_named(&mut self, named: &[usize]) {
        let Self { positions, reached, candidates } = self;
        // Named states get a bit temporarily, so that none is listed twice. They lose it again
        // below, since no active state leads to them.
        let first = candidates.len();
        for &state in named.iter().filter(|&&state| state < positions.len()) {
            let (word, bit) = (&mut reached[state / 64], 1 << (state % 64));
            if *word & bit == 0 {
                *word |= bit;
                candidates.push(state);
            }
        }
        for &state in &candidates[first..] {
            reached[state / 64] &= !(1 << (state % 64));
        }
        // Sorted, so that sums over candidates are the same to the bit whichever way listed them.
        candidates.sort_unstable();
    }

    /// Returns true if an active state leads to this candidate.
    #[inline]
    pub(crate) fn is_reached(&self, candidate: usize) -> bool {
        self.reached[candidate / 64] >> (candidate % 64) & 1 == 1
    }

    /// Returns the candidates listed last, in ascending order.
    pub(crate) fn candidates(&self) -> &[usize] {
        &self.candidates
    }
}
