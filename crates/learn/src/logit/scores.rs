//! Scores a + b · u of the moves, and their normaliser.
//!
//! Probabilities are exp(score − largest), divided by the sum of these, so that nothing overflows,
//! and a constant added to all scores changes no digit.

use std::ops::Range;

use super::LogitTransition;
use wayfix::TransitionError;
use wayfix::internal::Number;
use wayfix_kernels::limits;

impl LogitTransition {
    /// Numbers of the moves out of a state.
    #[inline]
    pub(super) fn column(&self, from: usize) -> Range<usize> {
        self.starts[from] as usize..self.starts[from + 1] as usize
    }

    /// Slopes of a move by its number.
    #[inline]
    pub(super) fn slopes_at(&self, at: usize) -> &[f64] {
        match self.groups[at] as usize {
            0 => &[],
            group => &self.slopes[(group - 1) * self.inputs..group * self.inputs],
        }
    }

    #[inline]
    pub(super) fn score(&self, inputs: &[f64], at: usize) -> f64 {
        let terms = self.slopes_at(at).iter().zip(inputs).map(|(b, u)| b * u);
        self.intercepts[at] + terms.sum::<f64>()
    }

    /// The largest score of a column, and the sum of exp(score − largest).
    #[inline]
    pub(super) fn normalizer(&self, inputs: &[f64], from: usize) -> (f64, f64) {
        let scores = || self.column(from).map(|at| self.score(inputs, at));
        let largest = scores().fold(f64::NEG_INFINITY, f64::max);
        (largest, scores().map(|score| (score - largest).exp()).sum())
    }

    /// Writes exp(score − largest) for the moves out of a state, and returns their sum.
    #[inline]
    pub(super) fn weigh(&self, inputs: &[f64], from: usize, weights: &mut [f64]) -> f64 {
        let column = self.column(from);
        weights.iter_mut().zip(column).for_each(|(out, at)| *out = self.score(inputs, at));
        let largest = weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        weights.iter_mut().for_each(|weight| *weight = (*weight - largest).exp());
        weights.iter().sum()
    }

    /// Writes ln A\[i, j\] for the moves out of a state j.
    #[inline]
    pub(super) fn logs(&self, inputs: &[f64], from: usize, logs: &mut [f64]) {
        let (largest, sum) = self.normalizer(inputs, from);
        let sum = sum.ln();
        let moves = logs.iter_mut().zip(self.column(from));
        moves.for_each(|(log, at)| *log = self.score(inputs, at) - largest - sum);
    }

    /// Upper bound on the magnitude of scores at these inputs: O(p), not O(E p).
    fn bound(&self, inputs: &[f64]) -> f64 {
        let slopes = self.largest_slopes.iter().zip(inputs).map(|(b, u)| b * u.abs());
        self.largest_intercept + slopes.sum::<f64>()
    }

    /// True if an entry is below the range of doubles.
    pub(super) fn leaves_doubles(&self, inputs: &[f64]) -> bool {
        // Least logarithm of an entry, above that of the smallest normal double, −708.4.
        let least = -700.0;
        // score − largest ≥ −2 bound, and the sum has at most `widest` terms of at most 1: nearly
        // all inputs pass without a look at the moves.
        if -2.0 * self.bound(inputs) - (self.widest as f64).ln() >= least {
            return false;
        }
        (0..self.states_count()).any(|from| {
            let (largest, sum) = self.normalizer(inputs, from);
            let mut scores = self.column(from).map(|at| self.score(inputs, at));
            scores.any(|score| score - largest - sum.ln() < least)
        })
    }

    pub(super) fn states_count(&self) -> usize {
        self.starts.len() - 1
    }

    pub(super) fn check_inputs(&self, inputs: &[f64]) -> Result<(), TransitionError> {
        let (found, expected) = (inputs.len(), self.inputs);
        if found != expected {
            let text = format!("{found} inputs given, expected {expected}");
            return Err(TransitionError::Control(text));
        }
        if let Some(input) = inputs.iter().position(|u| !u.is_finite()) {
            let value = inputs[input];
            let text = format!("input {input} is {value}, expected a finite value");
            return Err(TransitionError::Control(text));
        }
        if !limits::is_log(self.bound(inputs)) {
            // Names the input that contributes most.
            let part = |k: &usize| self.largest_slopes[*k] * inputs[*k].abs();
            let most = (0..self.largest_slopes.len()).max_by(|a, b| part(a).total_cmp(&part(b)));
            let input = most.unwrap_or(0);
            let value = Number(inputs[input]);
            let text =
                format!("input {input} is {value}, with which log-odds of moves may exceed 1e300");
            return Err(TransitionError::Control(text));
        }
        Ok(())
    }
}
