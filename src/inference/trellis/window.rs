//! Sliding windows: trellises that drop their first step as they grow, or their last one if it
//! failed.

use super::Trellis;

impl Trellis {
    /// Removes the first step. The second becomes the first, and the logarithms of a distribution
    /// of its states replace everything before.
    #[doc(hidden)]
    pub fn remove_first(&mut self, log_distribution: &[f64]) {
        let (first, second) = (self.range(1).end, self.range(2).end);
        let moves = self.moves[second] as usize;
        self.steps.remove(0);
        self.steps.iter_mut().for_each(|start| *start -= first);
        self.log_likelihoods.drain(..first);
        self.moves.drain(..second);
        // The new first step has one move from the start into each of its states; the starts of all
        // later moves shift by the difference.
        let states = second - first;
        self.from.splice(..moves, std::iter::repeat_n(0, states));
        self.log_weights.splice(..moves, log_distribution.iter().copied());
        self.moves.iter_mut().for_each(|start| *start = *start - moves as u32 + states as u32);
        self.moves.splice(..0, 0..states as u32);
        // The distribution includes the observation of the step already.
        self.log_likelihoods[..states].fill(0.0);
    }

    /// Removes the last step, which may be incomplete.
    #[doc(hidden)]
    pub fn remove_last(&mut self) {
        let Some(first) = self.steps.pop() else { return };
        self.log_likelihoods.truncate(first);
        self.moves.truncate(first + 1);
        let moves = self.moves[first] as usize;
        self.from.truncate(moves);
        self.log_weights.truncate(moves);
    }

    /// Frees unused memory, if it is more than a quarter of what is used.
    #[doc(hidden)]
    pub fn shrink(&mut self) {
        if self.from.capacity() > self.from.len() + self.from.len() / 4 + 16 {
            self.from.shrink_to_fit();
            self.log_weights.shrink_to_fit();
            self.log_likelihoods.shrink_to_fit();
            self.moves.shrink_to_fit();
        }
    }

    /// Bytes of heap memory.
    #[doc(hidden)]
    pub fn bytes(&self) -> usize {
        let doubles = self.log_likelihoods.capacity() + self.log_weights.capacity();
        let indices = 2 * self.steps.capacity() + self.moves.capacity();
        doubles * size_of::<f64>() + (indices + self.from.capacity()) * size_of::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_that_failed_leaves_nothing() {
        let mut trellis = Trellis::new();
        trellis.begin_step();
        trellis.state(-1.0, [(0, -0.5)]).unwrap();
        trellis.state(-2.0, [(0, -0.7)]).unwrap();
        let before = trellis.clone();
        trellis.begin_step();
        trellis.state(-1.0, [(0, -0.1), (1, -3.0)]).unwrap();
        trellis.state(-1.0, [(0, f64::NAN)]).unwrap_err();
        trellis.remove_last();
        assert_eq!(trellis, before);
        trellis.remove_last();
        trellis.remove_last();
        assert_eq!(trellis, Trellis::new());
    }
}
