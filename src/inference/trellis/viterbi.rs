//! Viterbi on a trellis (section 7 of the [formulas](crate::guide::formulas), in natural
//! logarithms).

use super::Trellis;
use crate::error::InferenceError;
use crate::inference::{LogSum, ViterbiPath};

impl Trellis {
    /// Most probable sequence of states. Ties go to the lowest state. O(moves) time; 4 bytes a
    /// state.
    ///
    /// # Errors
    ///
    /// [`InferenceError::Impossible`] with the first step at which no state is possible.
    pub fn viterbi(&self) -> Result<ViterbiPath, InferenceError> {
        let mut back = Vec::with_capacity(self.log_likelihoods.len());
        let (mut scores, mut next) = (vec![0.0], Vec::new());
        let mut taken_out = LogSum::default();
        for step in 1..=self.steps() {
            next.clear();
            let largest_weight = self.largest_weight(step, |j| scores[j] > f64::NEG_INFINITY);
            for state in self.range(step) {
                let mut best = (f64::NEG_INFINITY, 0);
                for (from, weight) in self.moves_into(state) {
                    let score = scores[from] + (weight - largest_weight);
                    // Strictly better only: ties go to the first.
                    if score > best.0 {
                        best = (score, from as u32);
                    }
                }
                next.push(best.0);
                back.push(best.1);
            }
            let likelihood = self.largest_likelihood(step, |i| next[i] > f64::NEG_INFINITY);
            let logs = &self.log_likelihoods[self.range(step)];
            next.iter_mut().zip(logs).for_each(|(score, log)| *score += log - likelihood);
            let best = next.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if best == f64::NEG_INFINITY {
                return Err(InferenceError::Impossible { step });
            }
            // The best score becomes 0, so that scores of long sequences keep their digits.
            next.iter_mut().for_each(|score| *score -= best);
            [largest_weight, likelihood, best].into_iter().for_each(|log| taken_out.add(log));
            std::mem::swap(&mut scores, &mut next);
        }
        // The best score is exactly 0, from the subtraction in the last step. In an empty trellis
        // it is that of the start.
        let mut state = scores.iter().position(|score| *score == 0.0).unwrap_or(0);
        let mut states = vec![0; self.steps()];
        for step in (1..=self.steps()).rev() {
            states[step - 1] = state;
            state = back[self.range(step).start + state] as usize;
        }
        Ok(ViterbiPath { states, log_probability: taken_out.value() })
    }
}
