//! Scores within a beam, upper bounds on those of all other paths, and backpointers: v, u and δ of
//! "Beam search" in section 13 of the [formulas](crate::guide::formulas).
//!
//! Scores are those of the exact decoder, computed in the same way on the same grid, so that a path
//! proven optimal is the exact decoder's path with its probability.

use std::f64::consts::LOG2_E;

use crate::inference::pruned::active_set::ActiveSet;
use crate::inference::step::scores::unlifted_log2;
use crate::transition::TransitionEntries;
use wayfix_kernels as kernels;
use wayfix_kernels::limits::LIFT;

/// Upper bound on log2 of an entry without evidence on the move. It is above 0, since the sums of
/// columns may deviate from one by 1e-9.
pub(crate) const ENTRY: f64 = 1.6e-9;

/// Scores of a step: logarithms to base 2 on the grid of `kernels::log2`.
#[derive(Debug, Default)]
pub(crate) struct Beam {
    /// States in the beam, in ascending order.
    pub(crate) states: Vec<usize>,
    /// Score of the best path to each state that never left the beam.
    pub(crate) scores: Vec<f64>,
    /// Upper bound on the scores of the paths to each state that left the beam.
    pub(crate) ceilings: Vec<f64>,
    /// Upper bound on the scores of the paths to any other state.
    pub(crate) elsewhere: f64,
}

/// Backpointers of all steps.
#[derive(Debug, Default)]
pub(crate) struct Pointers {
    /// States of all steps, each with the position of its predecessor among those of the step
    /// before.
    pub(crate) entries: Vec<(u32, u32)>,
    /// Index of the first entry of each step.
    pub(crate) starts: Vec<usize>,
}

impl Beam {
    pub(crate) fn clear(&mut self) {
        self.states.clear();
        self.scores.clear();
        self.ceilings.clear();
    }

    /// Computes the scores of step 1; X_0 is summed over.
    pub(crate) fn start<A: TransitionEntries>(
        &mut self,
        prior: &[f64],
        moves: Option<(&A, &A::Control)>,
        from: &mut Vec<u32>,
    ) {
        // Asked once, since it looks at all entries.
        let in_logs = moves.is_some_and(|(a, u)| a.evidence(u).is_some() && a.entries_need_logs(u));
        for &i in &self.states {
            let lifted = match moves {
                Some(_) if in_logs => 0.0,
                Some((transition, control)) => {
                    let entries = transition.incoming(control, i);
                    entries.map(|(j, a)| a * (prior[j] * LIFT)).sum()
                }
                None => prior[i] * LIFT,
            };
            self.scores.push(match moves {
                // A tiny prior times a small entry may leave the range of `f64` even when lifted.
                Some((transition, control)) if !(1.0..=f64::MAX).contains(&lifted) => {
                    let entries = || transition.incoming_log2(control, i);
                    log2_sum(|| entries().map(|(j, log2)| log2 + kernels::log2(prior[j])))
                }
                _ => unlifted_log2(lifted),
            });
            self.ceilings.push(f64::NEG_INFINITY);
            from.push(0);
        }
        self.elsewhere = f64::NEG_INFINITY;
    }

    /// Returns true if no path has a probability above 0.
    pub(crate) fn is_nowhere(&self) -> bool {
        let all = self.scores.iter().chain(&self.ceilings).chain([&self.elsewhere]);
        all.copied().all(|score| score == f64::NEG_INFINITY)
    }

    /// Extends the best paths from the states before to each state, and the bounds on the others.
    pub(crate) fn extend<I: Iterator<Item = (usize, f64)>>(
        &mut self,
        before: &Self,
        active_set: &ActiveSet,
        incoming: impl Fn(usize) -> I,
        from: &mut Vec<u32>,
    ) {
        for &i in &self.states {
            let (mut score, mut best) = (f64::NEG_INFINITY, 0);
            let (mut ceiling, mut beyond) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
            for (j, log2) in incoming(i) {
                // Through a state of the beam: the best path that never left the beam, and the
                // bound on those that did.
                if let Some(at) = active_set.place(j) {
                    let value = log2 + before.scores[at];
                    if value > score {
                        (score, best) = (value, at as u32);
                    }
                    ceiling = f64::max(ceiling, log2 + before.ceilings[at]);
                } else {
                    // States outside share one bound: with the largest entry out of them it covers
                    // all paths from there.
                    beyond = f64::max(beyond, log2);
                }
            }
            self.scores.push(score);
            self.ceilings.push(ceiling.max(before.elsewhere + beyond));
            from.push(best);
        }
    }

    /// Adds the logarithms of likelihoods, none of which is above `largest`, less a whole number.
    /// Returns that number.
    pub(crate) fn weigh(&mut self, listed: &[f64], others: f64, largest: f64) -> f64 {
        // The same whole number as the exact decoder takes out, so that scores are the same.
        let whole = if largest > 0.0 { kernels::log2(largest).floor() } else { 0.0 };
        self.add(listed.iter().map(|b| kernels::log2(*b) - whole));
        self.elsewhere += kernels::log2(others) - whole;
        whole
    }

    /// Adds likelihoods given by their natural logarithms, less the largest. Returns the largest.
    pub(crate) fn weigh_with_logs(&mut self, listed: &[f64], others: f64, largest: f64) -> f64 {
        let largest = if largest.is_finite() { largest } else { 0.0 };
        // Rounded to the grid as by the exact decoder (`Hmm::viterbi`), whose scores these must
        // equal.
        let log2 = |log: f64| kernels::on_grid((log - largest) * LOG2_E);
        self.add(listed.iter().map(|log| log2(*log)));
        self.elsewhere += log2(others);
        largest
    }

    fn add(&mut self, log2: impl Iterator<Item = f64>) {
        for ((score, ceiling), log2) in self.scores.iter_mut().zip(&mut self.ceilings).zip(log2) {
            *score += log2;
            *ceiling += log2;
        }
    }

    /// Drops the states whose score and bound are both more than `width` below the best score, and
    /// takes out the whole part of that score.
    pub(crate) fn prune(&mut self, best: f64, width: f64, from: &mut Vec<u32>) {
        let (floor, least) = (best.floor(), best - width);
        let mut kept = 0;
        for at in 0..self.states.len() {
            let (score, ceiling) = (self.scores[at], self.ceilings[at]);
            // A state is kept also because of its bound alone: dropping it would raise the bound on
            // all other states.
            let highest = score.max(ceiling);
            if highest >= least && highest > f64::NEG_INFINITY {
                (self.states[kept], from[kept]) = (self.states[at], from[at]);
                (self.scores[kept], self.ceilings[kept]) = (score - floor, ceiling - floor);
                kept += 1;
            } else {
                self.elsewhere = self.elsewhere.max(highest);
            }
        }
        self.states.truncate(kept);
        self.scores.truncate(kept);
        self.ceilings.truncate(kept);
        from.truncate(kept);
        self.elsewhere -= floor;
    }
}

impl Pointers {
    /// Returns the path to the state at this position of the last step.
    pub(crate) fn path(&self, mut at: usize) -> Vec<usize> {
        let mut states = vec![0; self.starts.len()];
        for (state, start) in states.iter_mut().zip(&self.starts).rev() {
            let (here, before) = self.entries[start + at];
            *state = here as usize;
            at = before as usize;
        }
        states
    }
}

/// Returns log2 of the largest entry. O(E).
pub(crate) fn largest_log2<A: TransitionEntries>(transition: &A, control: &A::Control) -> f64 {
    let entries = (0..transition.states()).flat_map(|i| transition.incoming_log2(control, i));
    entries.map(|entry| entry.1).fold(f64::NEG_INFINITY, f64::max)
}

/// Returns log2 of a sum of numbers, from their logarithms to base 2.
fn log2_sum<I: Iterator<Item = f64>>(logs: impl Fn() -> I) -> f64 {
    let largest = logs().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    kernels::on_grid(largest + logs().map(|log| (log - largest).exp2()).sum::<f64>().log2())
}
