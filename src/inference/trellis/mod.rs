//! Trellises: sequences with a different set of states at each step, such as the roads near each
//! position of a drive, and their most probable paths (section 7 of the
//! [formulas](crate::guide::formulas)).
//!
//! States are numbered through all steps, and moves by the state that they enter (compressed rows),
//! so that a pass over a trellis reads its arrays in order. Everything is in natural logarithms.
//! Each step subtracts its largest weight, its largest log-likelihood and the remaining sum
//! separately ([`Scale`]), because adding large logarithms before they cancel would cost digits.

mod smooth;

use super::decoding::k_best;
use super::decoding::k_best::{Best, RankedPath, best_ends};
use super::{LogSum, ViterbiPath};
use crate::error::HmmError;
use wayfix_kernels::log_sum;

pub use self::smooth::{SmoothedTrellis, TrellisForward};

/// A sequence of steps with their own states: the log-likelihood of each state, and the moves into
/// it from the states of the previous step, with their log weights.
///
/// If each observation leaves only a few of a model's million states, and a search finds them,
/// these few make a trellis. Weights of moves are probabilities, or probabilities times the
/// likelihood of what was measured on the move; they need not sum to one. All computations are in
/// natural logarithms, so that nothing underflows.
///
/// Steps count from 1. The states of step 1 have one move each, from the start, whose weight is
/// their prior probability.
///
/// ```
/// use wayfix::inference::Trellis;
///
/// let ln = f64::ln;
/// let mut trellis = Trellis::new();
/// trellis.begin_step();
/// trellis.state(ln(0.9), [(0, ln(0.5))])?; // log-likelihood, moves (from, log weight)
/// trellis.state(ln(0.2), [(0, ln(0.5))])?;
/// trellis.begin_step();
/// trellis.state(ln(0.5), [(0, ln(0.7)), (1, ln(0.3))])?;
/// trellis.state(ln(0.1), [(0, ln(0.3)), (1, ln(0.7))])?;
/// trellis.state(ln(0.5), [])?; // unreachable
///
/// let smoothed = trellis.smooth()?;
/// assert!((smoothed.log_likelihood() - 0.1930_f64.ln()).abs() < 1e-12);
/// assert_eq!(smoothed.filtered(2)[2], 0.0);
/// let path = trellis.viterbi()?;
/// assert_eq!(path.states(), [0, 0]);
/// assert!((path.log_probability() - 0.1575_f64.ln()).abs() < 1e-12);
/// # Ok::<(), wayfix::HmmError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Trellis {
    /// First state of each step, and the number of states at the end.
    steps: Vec<usize>,
    log_likelihoods: Vec<f64>,
    /// Moves into state s have the numbers `moves[s]..moves[s + 1]`.
    moves: Vec<u32>,
    from: Vec<u32>,
    log_weights: Vec<f64>,
}

impl Default for Trellis {
    fn default() -> Self {
        Self::new()
    }
}

impl Trellis {
    /// Creates a trellis without steps.
    #[must_use]
    pub fn new() -> Self {
        let (steps, from) = (Vec::new(), Vec::new());
        let (log_likelihoods, log_weights) = (Vec::new(), Vec::new());
        Self { steps, log_likelihoods, moves: vec![0], from, log_weights }
    }

    /// Removes all steps but keeps the memory.
    pub fn clear(&mut self) {
        self.steps.clear();
        self.log_likelihoods.clear();
        self.moves.clear();
        self.moves.push(0);
        self.from.clear();
        self.log_weights.clear();
    }

    /// Begins a step, at first without states.
    pub fn begin_step(&mut self) {
        self.steps.push(self.log_likelihoods.len());
    }

    /// Adds a state to the last step, with the moves into it from states of the previous step,
    /// which are numbered from 0 there. In the first step the only state before is 0, the start.
    /// Moves should be in ascending order, at most one from each state: ties go to the first.
    ///
    /// # Panics
    ///
    /// If there are 2^32 moves.
    ///
    /// # Errors
    ///
    /// [`HmmError::TrellisValue`] for a log-likelihood or a weight that is neither −∞ nor
    /// from −1e300 to 1e300, [`HmmError::TrellisState`] for a move from a state that does
    /// not exist, and [`HmmError::TrellisStep`] before the first step; the trellis is then
    /// as before.
    pub fn state(
        &mut self,
        log_likelihood: f64,
        moves: impl IntoIterator<Item = (usize, f64)>,
    ) -> Result<(), HmmError> {
        let step = self.steps.len();
        if step == 0 {
            return Err(HmmError::TrellisStep);
        }
        let before = if step > 1 { self.steps[step - 1] - self.steps[step - 2] } else { step };
        let valid = |value: f64| {
            let error = HmmError::TrellisValue { step, value };
            // Sums of larger values could overflow.
            let is_valid = value.abs() <= 1e300 || value == f64::NEG_INFINITY;
            if is_valid { Ok(()) } else { Err(error) }
        };
        // Moves are added as they are checked (the iterator can be read only once), and removed
        // again if one is invalid.
        let kept = self.from.len();
        let checked = valid(log_likelihood).and_then(|()| {
            moves.into_iter().try_for_each(|(from, log_weight)| {
                valid(log_weight)?;
                if from >= before {
                    return Err(HmmError::TrellisState { step, from, states: before });
                }
                self.from.push(from as u32);
                self.log_weights.push(log_weight);
                Ok(())
            })
        });
        if checked.is_err() {
            self.from.truncate(kept);
            self.log_weights.truncate(kept);
            return checked;
        }
        self.log_likelihoods.push(log_likelihood);
        self.moves.push(u32::try_from(self.from.len()).expect("there are fewer than 2^32 moves"));
        Ok(())
    }

    /// Number of steps, T.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// Number of states of a step, from 1; 0 if the step does not exist.
    #[must_use]
    pub fn states(&self, step: usize) -> usize {
        self.range(step).len()
    }

    /// Log-likelihood of a state of a step.
    ///
    /// # Panics
    ///
    /// If the state does not exist.
    #[must_use]
    pub fn log_likelihood(&self, step: usize, state: usize) -> f64 {
        self.log_likelihoods[self.range(step)][state]
    }

    /// Moves into a state of a step, in the order they were added: pairs (from, log weight).
    ///
    /// # Panics
    ///
    /// If the state does not exist.
    pub fn moves(&self, step: usize, state: usize) -> impl Iterator<Item = (usize, f64)> {
        self.moves_into(self.range(step).nth(state).expect("the state exists"))
    }

    /// Numbers of the states of a step, counted through all steps; empty for step 0 or beyond T.
    fn range(&self, step: usize) -> std::ops::Range<usize> {
        let Some(&start) = step.checked_sub(1).and_then(|k| self.steps.get(k)) else {
            return 0..0;
        };
        start..self.steps.get(step).copied().unwrap_or(self.log_likelihoods.len())
    }

    /// Moves into a state, by its number through all steps: pairs (from, log weight).
    fn moves_into(&self, state: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
        let range = self.moves[state] as usize..self.moves[state + 1] as usize;
        let from = self.from[range.clone()].iter().map(|&from| from as usize);
        from.zip(self.log_weights[range].iter().copied())
    }

    /// Computes ln p(X_k = i | y_1 … y_k) for the states of a step from those of the previous step.
    /// Returns the logarithms taken out, with a sum of −∞ if no state is possible.
    #[doc(hidden)]
    pub fn forward_step(&self, step: usize, before: &[f64], out: &mut Vec<f64>) -> Scale {
        out.clear();
        // The largest weight and the largest log-likelihood are taken out before anything is added:
        // next to numbers of 1e5, small differences would lose their digits. Only possible states
        // count, since the values of others may have any size.
        let weight = self.largest_weight(step, |j| before[j] > f64::NEG_INFINITY);
        out.extend(self.range(step).map(|state| {
            log_sum(self.moves_into(state).map(|(j, log)| before[j] + (log - weight)))
        }));
        let likelihood = self.largest_likelihood(step, |i| out[i] > f64::NEG_INFINITY);
        let logs = &self.log_likelihoods[self.range(step)];
        out.iter_mut().zip(logs).for_each(|(x, log)| *x += log - likelihood);
        let largest = out.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if largest == f64::NEG_INFINITY {
            return Scale { weight, likelihood, sum: largest };
        }
        // Two subtractions: `largest + sum` rounds relative to its size, the differences do not.
        out.iter_mut().for_each(|x| *x -= largest);
        let sum = log_sum(out.iter().copied());
        out.iter_mut().for_each(|x| *x -= sum);
        Scale { weight, likelihood, sum: largest + sum }
    }

    /// Largest weight above −∞ of the moves into a step from states that are possible; 0 if there
    /// is none.
    fn largest_weight(&self, step: usize, possible: impl Fn(usize) -> bool) -> f64 {
        let moves = self.range(step).flat_map(|state| self.moves_into(state));
        largest(moves.filter(|(from, _)| possible(*from)).map(|(_, weight)| weight))
    }

    /// Largest log-likelihood above −∞ of the states of a step that are possible; 0 if there is
    /// none.
    fn largest_likelihood(&self, step: usize, possible: impl Fn(usize) -> bool) -> f64 {
        let logs = self.log_likelihoods[self.range(step)].iter().enumerate();
        largest(logs.filter(|(state, _)| possible(*state)).map(|(_, log)| *log))
    }
}

/// Logarithms taken out of a step, before they could cost the others digits: the largest weight,
/// the largest log-likelihood, and the logarithm of the remaining sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    weight: f64,
    likelihood: f64,
    sum: f64,
}

impl Scale {
    /// ln p(y_k | y_1 … y_{k-1}).
    #[doc(hidden)]
    #[must_use]
    pub fn log(self) -> f64 {
        (self.weight + self.likelihood) + self.sum
    }

    /// Adds ln p(y_k | y_1 … y_{k-1}) to a sum, without rounding it first.
    #[doc(hidden)]
    pub fn add_to(self, sum: &mut LogSum) {
        [self.weight, self.likelihood, self.sum].into_iter().for_each(|log| sum.add(log));
    }
}

/// Returns the largest of some logarithms, or 0 if all are −∞.
fn largest(logs: impl Iterator<Item = f64>) -> f64 {
    let largest = logs.fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY { 0.0 } else { largest }
}

impl Trellis {
    /// Most probable sequence of states. Ties go to the lowest state. O(moves) time; 4 bytes a
    /// state.
    ///
    /// # Errors
    ///
    /// [`HmmError::Impossible`] with the first step at which no state is possible.
    pub fn viterbi(&self) -> Result<ViterbiPath, HmmError> {
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
                return Err(HmmError::Impossible { step });
            }
            // The best score becomes 0, so that scores of long sequences keep their digits.
            next.iter_mut().for_each(|score| *score -= best);
            [largest_weight, likelihood, best].into_iter().for_each(|log| taken_out.add(log));
            std::mem::swap(&mut scores, &mut next);
        }
        // The best score is exactly 0, from the subtraction in the last step. In an empty trellis
        // the best score is that of the start.
        let mut state = scores.iter().position(|score| *score == 0.0).unwrap_or(0);
        let mut states = vec![0; self.steps()];
        for step in (1..=self.steps()).rev() {
            states[step - 1] = state;
            state = back[self.range(step).start + state] as usize;
        }
        Ok(ViterbiPath { states, log_probability: taken_out.value() })
    }
}

impl Trellis {
    /// Most probable sequences of states, the best first; fewer than `count` if the trellis has
    /// fewer. They are distinct, and the first is that of [`viterbi`](Self::viterbi). O(moves ·
    /// K log K) time, and 16 K bytes a state.
    ///
    /// # Errors
    ///
    /// As [`viterbi`](Self::viterbi), also for a `count` of 0.
    pub fn k_best(&self, count: usize) -> Result<Vec<ViterbiPath>, HmmError> {
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
                return Err(HmmError::Impossible { step });
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
            let states = k_best::states(end, self.steps(), paths);
            ViterbiPath { states, log_probability: log_probability.value() }
        };
        Ok(best_ends(last.iter().map(Vec::as_slice), count).into_iter().map(path).collect())
    }
}
