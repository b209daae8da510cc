//! Viterbi on a trellis.

use super::Trellis;
use crate::error::InferenceError;
use crate::inference::ViterbiPath;

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
        for step in 1..=self.steps() {
            next.clear();
            for state in self.range(step) {
                let mut best = (f64::NEG_INFINITY, 0);
                for (from, weight) in self.moves_into(state) {
                    let score = scores[from] + weight;
                    if score > best.0 {
                        best = (score, from as u32);
                    }
                }
                next.push(best.0 + self.log_likelihoods[state]);
                back.push(best.1);
            }
            if next.iter().all(|score| *score == f64::NEG_INFINITY) {
                return Err(InferenceError::Impossible { step });
            }
            std::mem::swap(&mut scores, &mut next);
        }
        let best = scores.iter().enumerate().rev().max_by(|a, b| a.1.total_cmp(b.1));
        let (mut state, &log_probability) = best.unwrap_or((0, &0.0));
        let mut states = vec![0; self.steps()];
        for step in (1..=self.steps()).rev() {
            states[step - 1] = state;
            state = back[self.range(step).start + state] as usize;
        }
        Ok(ViterbiPath { states, log_probability })
    }
}
