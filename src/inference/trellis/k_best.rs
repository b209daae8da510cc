//! The k most probable paths of a trellis, by lists of paths to each state.

use super::Trellis;
use crate::error::InferenceError;
use crate::inference::{LogSum, ViterbiPath};

/// A path to a state: its score, the state before, and the rank of the path there that it extends.
#[derive(Debug, Clone, Copy)]
struct Way {
    score: f64,
    from: u32,
    rank: u32,
}

impl Trellis {
    /// Most probable sequences of states, the best first; fewer than `count`, if the trellis has
    /// fewer. They are distinct, and the first is that of [`viterbi`](Self::viterbi). O(moves ·
    /// K log K) time, and 16 K bytes a state.
    ///
    /// # Errors
    ///
    /// As [`viterbi`](Self::viterbi), also for a `count` of 0.
    pub fn k_best(&self, count: usize) -> Result<Vec<ViterbiPath>, InferenceError> {
        let mut lists: Vec<Vec<Way>> = Vec::with_capacity(self.log_likelihoods.len());
        let mut taken_out = LogSum::default();
        let start = [Way { score: 0.0, from: 0, rank: 0 }];
        for step in 1..=self.steps() {
            let range = self.range(step);
            let before = if step == 1 { 0..0 } else { self.range(step - 1) };
            let possible = |from: usize| step == 1 || !lists[before.start + from].is_empty();
            let largest_weight = self.largest_weight(step, possible);
            for state in range.clone() {
                let mut ways = Vec::new();
                for (from, weight) in self.moves_into(state) {
                    let to_extend =
                        if step == 1 { &start[..] } else { &lists[before.start + from][..] };
                    for (rank, way) in to_extend.iter().enumerate() {
                        let score = way.score + (weight - largest_weight);
                        if score > f64::NEG_INFINITY
                            && self.log_likelihoods[state] > f64::NEG_INFINITY
                        {
                            ways.push(Way { score, from: from as u32, rank: rank as u32 });
                        }
                    }
                }
                // Sorted before the likelihood is added, whose size may hide small differences;
                // at least one is kept, to find out whether the step is possible.
                keep_best(&mut ways, count.max(1));
                lists.push(ways);
            }
            let now = &mut lists[range.clone()];
            let likelihood = self.largest_likelihood(step, |i| !now[i].is_empty());
            let mut best = f64::NEG_INFINITY;
            for (ways, log) in now.iter_mut().zip(&self.log_likelihoods[range]) {
                ways.iter_mut().for_each(|way| way.score += log - likelihood);
                best = ways.first().map_or(best, |way| best.max(way.score));
            }
            if best == f64::NEG_INFINITY {
                return Err(InferenceError::Impossible { step });
            }
            now.iter_mut().flatten().for_each(|way| way.score -= best);
            [largest_weight, likelihood, best].into_iter().for_each(|log| taken_out.add(log));
        }
        let last = self.range(self.steps());
        let mut ends = Vec::new();
        for (number, list) in lists[last].iter().enumerate() {
            let end = |(rank, way): (usize, &Way)| Way {
                score: way.score,
                from: number as u32,
                rank: rank as u32,
            };
            ends.extend(list.iter().enumerate().map(end));
        }
        if self.steps() == 0 {
            ends.extend(start);
        }
        keep_best(&mut ends, count);
        Ok(ends.into_iter().map(|end| self.follow(&lists, end, taken_out)).collect())
    }

    /// Path that ends with a way; what was taken out of all scores is added to its own.
    fn follow(&self, lists: &[Vec<Way>], end: Way, mut taken_out: LogSum) -> ViterbiPath {
        taken_out.add(end.score);
        let (mut states, mut way) = (vec![0; self.steps()], end);
        for step in (1..=self.steps()).rev() {
            states[step - 1] = way.from as usize;
            way = lists[self.range(step).start + way.from as usize][way.rank as usize];
        }
        ViterbiPath { states, log_probability: taken_out.value() }
    }
}

/// Keeps the best ways, in descending order of their scores; equal ones stay in order.
fn keep_best(ways: &mut Vec<Way>, count: usize) {
    ways.sort_by(|a, b| b.score.total_cmp(&a.score));
    ways.truncate(count);
}
