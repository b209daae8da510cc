//! The k most probable paths of a trellis: Viterbi with a list of paths for each state (section 7
//! of the [formulas](crate::guide::formulas)), in natural logarithms.
//!
//! The invariant: `lists` holds the k best paths to each state so far, best first. The k best paths
//! to a state extend paths that are among the k best to their own last state, so none is missed.

use super::Trellis;
use crate::error::InferenceError;
use crate::inference::decoding::ranked_paths::{self, Best, RankedPath, best_ends};
use crate::inference::{LogSum, ViterbiPath};

impl Trellis {
    /// Most probable sequences of states, the best first; fewer than `count` if the trellis has
    /// fewer. They are distinct, and the first is that of [`viterbi`](Self::viterbi). O(moves ·
    /// K log K) time, and 16 K bytes a state.
    ///
    /// # Errors
    ///
    /// As [`viterbi`](Self::viterbi), also for a `count` of 0.
    pub fn k_best(&self, count: usize) -> Result<Vec<ViterbiPath>, InferenceError> {
        // Paths to each state, indexed by its number through all steps.
        let mut lists: Vec<Vec<RankedPath>> = Vec::with_capacity(self.log_likelihoods.len());
        let mut taken_out = LogSum::default();
        let start = [vec![RankedPath::start(0.0)]];
        // At least one path is kept, to detect an impossible step.
        let mut best_paths = Best::new(count.max(1));
        for step in 1..=self.steps() {
            let range = self.range(step);
            let before = if step == 1 { &start[..] } else { &lists[self.range(step - 1)] };
            let largest_weight = self.largest_weight(step, |from| !before[from].is_empty());
            let into = |state: usize| {
                best_paths.paths.clear();
                if self.log_likelihoods[state] > f64::NEG_INFINITY {
                    // Ranked by the number of the move, since ties go to the move added first.
                    let moves = (self.moves[state] as usize..).zip(self.moves_into(state));
                    for (number, (from, weight)) in moves.filter(|(_, m)| m.1 > f64::NEG_INFINITY) {
                        best_paths.extend(number, &before[from], weight - largest_weight);
                    }
                }
                // Sorted before the likelihood is added: it is the same for all paths to the state,
                // but its size may round away small differences. Then move numbers are replaced by
                // the states that they leave.
                best_paths.finish();
                let mut paths = best_paths.paths.clone();
                paths.iter_mut().for_each(|path| path.from = self.from[path.from as usize]);
                paths
            };
            let mut now: Vec<_> = range.clone().map(into).collect();
            let likelihood = self.largest_likelihood(step, |i| !now[i].is_empty());
            let mut best = f64::NEG_INFINITY;
            for (paths, log) in now.iter_mut().zip(&self.log_likelihoods[range]) {
                paths.iter_mut().for_each(|path| path.score += log - likelihood);
                best = paths.first().map_or(best, |path| best.max(path.score));
            }
            if best == f64::NEG_INFINITY {
                return Err(InferenceError::Impossible { step });
            }
            now.iter_mut().flatten().for_each(|path| path.score -= best);
            [largest_weight, likelihood, best].into_iter().for_each(|log| taken_out.add(log));
            lists.extend(now);
        }
        let last = if self.steps() == 0 { &start[..] } else { &lists[self.range(self.steps())] };
        let path = |end: RankedPath| {
            let mut log_probability = taken_out;
            log_probability.add(end.score);
            let paths = |step: usize, state: usize| &lists[self.range(step + 1).start + state][..];
            let states = ranked_paths::states(end, self.steps(), paths);
            ViterbiPath { states, log_probability: log_probability.value() }
        };
        Ok(best_ends(last.iter().map(Vec::as_slice), count).into_iter().map(path).collect())
    }
}
