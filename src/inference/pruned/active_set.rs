//! Active set: the few states that are followed among millions, and the candidates that a step
//! can reach.

use crate::transition::TransitionEntries;

/// Active set and candidates. A dense array replaces hashing: 4 bytes a state, and a bit a state
/// for the candidates.
#[derive(Debug, Clone)]
pub(crate) struct ActiveSet {
    /// One more than the position of a state in the active set, or 0.
    places: Vec<u32>,
    /// A bit for each candidate that the step reaches; those that are only wanted have none.
    reached: Vec<u64>,
    candidates: Vec<usize>,
}

impl ActiveSet {
    pub(crate) fn new(states: usize) -> Self {
        let reached = vec![0; states.div_ceil(64)];
        Self { places: vec![0; states], reached, candidates: Vec::new() }
    }

    /// Returns the position of a state in the active set.
    #[inline]
    pub(crate) fn place(&self, state: usize) -> Option<usize> {
        (self.places[state] as usize).checked_sub(1)
    }

    /// Replaces the active set.
    pub(crate) fn follow(&mut self, before: &[usize], after: &[usize]) {
        before.iter().for_each(|&state| self.places[state] = 0);
        for (&state, place) in after.iter().zip(1..) {
            self.places[state] = place;
        }
    }

    /// Lists as candidates the states that a step can reach from the active ones, or these
    /// themselves without a transition, and all wanted states.
    pub(crate) fn list<A: TransitionEntries>(
        &mut self,
        followed: &[usize],
        moves: Option<(&A, &A::Control)>,
        wanted: &[usize],
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
            // Entries that are listed in linear form would miss those below the range of doubles.
            Some((a, control)) if a.evidence(control).is_some() && a.entries_need_logs(control) => {
                let entries = followed.iter().flat_map(|&j| a.outgoing_log2(control, j));
                entries.for_each(|(i, _)| list(i));
            }
            Some((a, control)) => {
                followed.iter().for_each(|&j| a.outgoing(control, j).for_each(|(i, _)| list(i)));
            }
            None => followed.iter().for_each(|&state| list(state)),
        }
        self.add_wanted(wanted);
    }

    /// Lists as candidates the states for which `leads` is true, in ascending order, and all
    /// wanted states.
    pub(crate) fn list_reached(&mut self, leads: impl Iterator<Item = bool>, wanted: &[usize]) {
        let Self { reached, candidates, .. } = self;
        candidates.iter().for_each(|&state| reached[state / 64] = 0);
        candidates.clear();
        for (state, _) in leads.enumerate().filter(|entry| entry.1) {
            reached[state / 64] |= 1 << (state % 64);
            candidates.push(state);
        }
        if !wanted.is_empty() {
            self.add_wanted(wanted);
        }
    }

    fn add_wanted(&mut self, wanted: &[usize]) {
        let Self { places, reached, candidates } = self;
        // Wanted states get a bit as well, so that none is listed twice, and lose it again below:
        // nothing leads to them.
        let first = candidates.len();
        for &state in wanted.iter().filter(|&&state| state < places.len()) {
            let (word, bit) = (&mut reached[state / 64], 1 << (state % 64));
            if *word & bit == 0 {
                *word |= bit;
                candidates.push(state);
            }
        }
        for &state in &candidates[first..] {
            reached[state / 64] &= !(1 << (state % 64));
        }
        // In ascending order, as all sums over states are: the same bits whatever listed them.
        candidates.sort_unstable();
    }

    /// Returns true if the step leads to a candidate from an active state.
    #[inline]
    pub(crate) fn is_reached(&self, candidate: usize) -> bool {
        self.reached[candidate / 64] >> (candidate % 64) & 1 == 1
    }

    /// Returns the candidates listed last, in ascending order.
    pub(crate) fn candidates(&self) -> &[usize] {
        &self.candidates
    }
}
