//! Max-product scores of places, with back-pointers. The lowest state wins ties, whatever the order
//! of offers: states are encoded as doubles that compare as they do.

/// Scores of places, and the states that they come from, encoded as doubles: vector registers
/// hold as many of both.
pub(super) struct Best<'a> {
    pub(super) scores: &'a mut [f64],
    pub(super) from: &'a mut [f64],
}

/// 2^52: added to a state, it gives a double whose low bits are the state.
const ZERO: f64 = (1_u64 << 52) as f64;

/// Encodes a state as a double.
pub(super) fn encoded(state: usize) -> f64 {
    ZERO + state as f64
}

/// Decodes a state.
pub(super) fn decoded(state: f64) -> u32 {
    state.to_bits() as u32
}

impl Best<'_> {
    pub(super) fn clear(&mut self) {
        self.scores.fill(f64::NEG_INFINITY);
        self.from.fill(ZERO);
    }

    /// Offers moves with these scores to consecutive places. The lowest state wins ties, in any
    /// order.
    pub(super) fn offer(&mut self, to: usize, moves: impl Iterator<Item = (f64, f64)>) {
        let best = self.scores[to..].iter_mut().zip(&mut self.from[to..]);
        for ((score, from), (value, state)) in best.zip(moves) {
            let lower = if state < *from { state } else { *from };
            let tied = if value == *score { lower } else { *from };
            *from = if value > *score { state } else { tied };
            *score = if value > *score { value } else { *score };
        }
    }
}
