//! The few states that are followed among millions, and those that a step can
//! lead to.

use crate::transition::TransitionEntries;

/// Which states are followed. A dense array says so, with no hashing: 4 bytes a
/// state, and a bit for those that are listed.
#[derive(Debug, Clone)]
pub(super) struct Frontier {
    /// One more than a state's place among those followed, or 0.
    places: Vec<u32>,
    listed: Vec<u64>,
    candidates: Vec<usize>,
}

impl Frontier {
    pub(super) fn new(states: usize) -> Self {
        let listed = vec![0; states.div_ceil(64)];
        Self { places: vec![0; states], listed, candidates: Vec::new() }
    }

    /// The place of a state among those followed.
    #[inline]
    pub(super) fn place(&self, state: usize) -> Option<usize> {
        (self.places[state] as usize).checked_sub(1)
    }

    /// Follows other states from now on.
    pub(super) fn follow(&mut self, before: &[usize], after: &[usize]) {
        before.iter().for_each(|&state| self.places[state] = 0);
        for (&state, place) in after.iter().zip(1..) {
            self.places[state] = place;
        }
    }

    /// Lists what a step can lead to from the states followed, or these
    /// themselves if nothing moves, and whatever else is wanted.
    pub(super) fn list<A: TransitionEntries<Control = ()>>(
        &mut self,
        followed: &[usize],
        transition: Option<&A>,
        wanted: &[usize],
    ) {
        let Self { places, listed, candidates } = self;
        candidates.clear();
        let mut list = |state: usize| {
            let (word, bit) = (&mut listed[state / 64], 1 << (state % 64));
            if *word & bit == 0 {
                *word |= bit;
                candidates.push(state);
            }
        };
        match transition {
            Some(a) => {
                followed.iter().for_each(|&j| a.outgoing(&(), j).for_each(|(i, _)| list(i)));
            }
            None => followed.iter().for_each(|&state| list(state)),
        }
        wanted.iter().filter(|&&state| state < places.len()).for_each(|&state| list(state));
        candidates.sort_unstable();
        candidates.iter().for_each(|&state| listed[state / 64] = 0);
    }

    /// What was listed last, in ascending order.
    pub(super) fn candidates(&self) -> &[usize] {
        &self.candidates
    }
}
