//! Viterbi decoding: the most probable path (Viterbi 1967).
//!
//! Scores are sums of logarithms to base 2 on a grid on which sums are exact
//! (see `kernels::log2`), so that ties are ties; whole numbers are taken out of
//! them at every step, which is exact too, and keeps their digits over any
//! number of steps.

use std::f64::consts::{LN_2, LOG2_E};

use super::LogSum;
use super::step::Step;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::kernels::{self, LIFT};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;

/// The most probable path of hidden states, and its probability.
///
/// Made by [`Hmm::viterbi`].
#[derive(Debug, Clone, PartialEq)]
pub struct ViterbiPath {
    states: Vec<usize>,
    log_probability: f64,
}

impl ViterbiPath {
    /// The states of steps 1 to T: `states()[k - 1]` belongs to `ys[k - 1]`.
    #[must_use]
    pub fn states(&self) -> &[usize] {
        &self.states
    }

    /// ln p(path, y_1 … y_T): never −∞, since an impossible path is an error.
    #[must_use]
    pub fn log_probability(&self) -> f64 {
        self.log_probability
    }

    /// The states, moved out.
    #[must_use]
    pub fn into_states(self) -> Vec<usize> {
        self.states
    }
}

impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// The path that maximises p(x_1 … x_T, y_1 … y_T): every move of it is one
    /// that the transition operator allows.
    ///
    /// Under [`Prior::BeforeFirstTransition`](crate::Prior::BeforeFirstTransition)
    /// the path starts at X_1, and X_0 is summed over.
    ///
    /// Of several best paths it is the one whose last state is the lowest, then
    /// the last but one, and so on. Paths tie if their factors are the same, in
    /// any order and but for powers of two, as long as none falls more than
    /// 2^256 behind on the way; log-likelihoods tie as far as rounding lets them.
    /// Paths that differ by less than rounding (1e-14 a factor) may count as
    /// either.
    /// An empty sequence gives the empty path, with log-probability 0.
    ///
    /// O(E) a step; 4 n T bytes for the way back.
    ///
    /// # Errors
    ///
    /// [`InferenceError`] with the step at which an observation is impossible
    /// or has no valid likelihood, or a control is not valid.
    pub fn viterbi<S>(&self, sequence: &S) -> Result<ViterbiPath, InferenceError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (n, steps) = (self.states(), sequence.steps());
        if steps == 0 {
            return Ok(ViterbiPath { states: Vec::new(), log_probability: 0.0 });
        }
        let mut scratch = Scratch::default();
        let mut score = vec![0.0; n];
        let mut next = vec![0.0; n];
        let mut from = vec![0_u32; n * (steps - 1)];
        let mut whole = 0.0; // taken out of the scores: an integer, exactly
        let mut factors = LogSum::default();

        for number in 1..=steps {
            let step = Step::of(self, sequence, number);
            if number == 1 {
                let lifted: Vec<f64> =
                    self.prior().belief().as_slice().iter().map(|p| p * LIFT).collect();
                step.predict(&lifted, &mut next)?;
                next.iter_mut().for_each(|score| *score = kernels::log2(*score) - LIFT.log2());
            } else {
                let from = &mut from[(number - 2) * n..(number - 1) * n];
                step.maximise(&score, &mut next, from)?;
            }
            let (diagonal, largest) = step.diagonal(sequence.observation(number), &mut scratch)?;
            factors.add(add_likelihoods(diagonal, largest, &mut next));
            let best = next.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if best == f64::NEG_INFINITY {
                return Err(InferenceError::Impossible { step: number });
            }
            let floor = best.floor();
            score.iter_mut().zip(&next).for_each(|(score, next)| *score = next - floor);
            whole += floor;
        }

        let mut state = 0;
        for (i, &s) in score.iter().enumerate() {
            if s > score[state] {
                state = i;
            }
        }
        factors.add(whole * LN_2);
        factors.add(score[state] * LN_2);
        let mut states = vec![state; steps];
        for index in (0..steps - 1).rev() {
            state = from[index * n + state] as usize;
            states[index] = state;
        }
        Ok(ViterbiPath { states, log_probability: factors.value() })
    }
}

impl<A: TransitionEntries, B: Likelihood> Step<'_, A, B> {
    /// The best way into each state.
    fn maximise(
        &self,
        score: &[f64],
        next: &mut [f64],
        from: &mut [u32],
    ) -> Result<(), InferenceError> {
        let Some(control) = self.control else { return Ok(()) }; // only step 1 has none
        self.check_control(control)?;
        self.hmm.transition().max_product(control, score, next, from);
        Ok(())
    }
}

/// Adds log2 b to the scores, but for a common part that keeps them small;
/// returns what was left out, as a natural logarithm.
fn add_likelihoods(diagonal: Diagonal<'_>, largest: f64, score: &mut [f64]) -> f64 {
    fn add(score: &mut [f64], log2: impl Iterator<Item = f64>) {
        score.iter_mut().zip(log2).for_each(|(score, log2)| *score += log2);
    }
    let impossible = |score: &mut [f64]| {
        score.fill(f64::NEG_INFINITY);
        0.0
    };
    // Whole powers of two can be taken out without rounding.
    let whole = if largest > 0.0 { kernels::log2(largest).floor() } else { 0.0 };
    let left_out = match diagonal.values {
        Values::Log(_) if largest == f64::NEG_INFINITY => impossible(score),
        Values::Log(logs) => {
            add(score, logs.iter().map(|log| kernels::on_grid((log - largest) * LOG2_E)));
            largest
        }
        _ if largest == 0.0 => impossible(score),
        Values::Checked { log2: Some(log2), .. } => {
            add(score, log2.iter().map(|log2| log2 - whole));
            whole * LN_2
        }
        Values::Linear(linear) | Values::Checked { linear, .. } => {
            add(score, linear.iter().map(|&b| kernels::log2(b) - whole));
            whole * LN_2
        }
    };
    left_out + diagonal.log_factor
}
