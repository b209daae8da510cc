//! Trellises that lose their first step as they grow.

use super::Trellis;

impl Trellis {
    /// Removes the first step. The next becomes the first, with the logarithms of a distribution
    /// of its states in place of all that was before.
    pub(crate) fn remove_first(&mut self, log_distribution: &[f64]) {
        let (first, second) = (self.range(1).end, self.range(2).end);
        let moves = self.moves[second] as usize;
        self.steps.remove(0);
        self.steps.iter_mut().for_each(|start| *start -= first);
        self.log_likelihoods.drain(..first);
        self.moves.drain(..second);
        // The new first step: one move from the start into each of its states.
        let states = second - first;
        self.from.splice(..moves, std::iter::repeat_n(0, states));
        self.log_weights.splice(..moves, log_distribution.iter().copied());
        self.moves.iter_mut().for_each(|start| *start = *start - moves as u32 + states as u32);
        self.moves.splice(..0, 0..states as u32);
        // Its observation is in the distribution already.
        self.log_likelihoods[..states].fill(0.0);
    }

    /// Gives back memory that is not in use, if it is much.
    pub(crate) fn shrink(&mut self) {
        if self.from.capacity() > self.from.len() + self.from.len() / 4 + 16 {
            self.from.shrink_to_fit();
            self.log_weights.shrink_to_fit();
            self.log_likelihoods.shrink_to_fit();
            self.moves.shrink_to_fit();
        }
    }

    /// Bytes of memory beside the value itself.
    pub(crate) fn bytes(&self) -> usize {
        let doubles = self.log_likelihoods.capacity() + self.log_weights.capacity();
        let indices = 2 * self.steps.capacity() + self.moves.capacity();
        doubles * size_of::<f64>() + (indices + self.from.capacity()) * size_of::<u32>()
    }
}
