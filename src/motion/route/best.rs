//! The best way to each place so far.

/// Scores of places, and the states that they come from, as doubles that are as wide as
/// the scores: vector registers hold both.
pub(super) struct Best<'a> {
    pub(super) scores: &'a mut [f64],
    pub(super) from: &'a mut [f64],
}

/// 2^52, to which states are added: the low bits of the double are the state.
const ZERO: f64 = (1_u64 << 52) as f64;

/// A state as a double.
pub(super) fn encoded(state: usize) -> f64 {
    ZERO + state as f64
}

/// A state that was a double.
pub(super) fn decoded(state: f64) -> u32 {
    state.to_bits() as u32
}

impl Best<'_> {
    pub(super) fn clear(&mut self) {
        self.scores.fill(f64::NEG_INFINITY);
        self.from.fill(ZERO);
    }

    /// Offers to places, one after the other, ways with these scores. Of equal
    /// ones, that from the lowest state stays, whatever the order.
    pub(super) fn offer(&mut self, to: usize, ways: impl Iterator<Item = (f64, f64)>) {
        let best = self.scores[to..].iter_mut().zip(&mut self.from[to..]);
        for ((score, from), (value, state)) in best.zip(ways) {
            let lower = if state < *from { state } else { *from };
            let tied = if value == *score { lower } else { *from };
            *from = if value > *score { state } else { tied };
            *score = if value > *score { value } else { *score };
        }
    }
}
