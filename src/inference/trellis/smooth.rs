//! Forward-backward on a trellis (sections 2 to 4 of the [formulas](crate::guide::formulas), in
//! logarithms), of the whole or of a window that slides: a trellis that drops its first step as it
//! grows, or its last one if it failed.
//!
//! γ_k ∝ α_k ∘ β_k, each step normalised by itself. β is scaled by what the forward pass took out
//! of each step, so that its logarithms stay near those of γ / α.

use super::{Scale, Trellis};
use crate::error::HmmError;
use crate::inference::LogSum;
use wayfix_kernels::log_sum;

/// Filtered and smoothed distributions of the states of each step of a [`Trellis`].
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedTrellis {
    steps: Vec<usize>,
    /// ln p(X_k | y_1 … y_k).
    log_filtered: Vec<f64>,
    filtered: Vec<f64>,
    smoothed: Vec<f64>,
    /// ln p(y_k+1 … y_T | X_k), up to a constant for each step.
    log_backward: Vec<f64>,
    scales: Vec<Scale>,
}

/// Forward pass over a trellis: filtered logarithms of all its states, and the logarithms taken out
/// of each step. A caller that grows a trellis step by step from the filtered distribution has
/// these already.
#[derive(Debug, Clone, Default)]
pub struct TrellisForward {
    log_filtered: Vec<f64>,
    scales: Vec<Scale>,
}

impl TrellisForward {
    /// Adds the result of [`Trellis::forward_step`] for the next step.
    #[doc(hidden)]
    pub fn push(&mut self, log_filtered: &[f64], scale: Scale) -> Result<(), HmmError> {
        self.scales.push(scale);
        if scale.sum == f64::NEG_INFINITY {
            return Err(HmmError::Impossible { step: self.scales.len() });
        }
        self.log_filtered.extend_from_slice(log_filtered);
        Ok(())
    }
}

impl Trellis {
    /// Computes the filtered and smoothed distributions of all steps. O(moves) time; 32 bytes a
    /// state.
    ///
    /// # Errors
    ///
    /// [`HmmError::Impossible`] with the first step at which no state is possible.
    pub fn smooth(&self) -> Result<SmoothedTrellis, HmmError> {
        let mut forward = TrellisForward::default();
        let (mut before, mut now) = (vec![0.0], Vec::new());
        for step in 1..=self.steps() {
            let scale = self.forward_step(step, &before, &mut now);
            forward.push(&now, scale)?;
            std::mem::swap(&mut before, &mut now);
        }
        Ok(self.smooth_after(forward))
    }

    /// Computes the smoothed distributions after a forward pass over all steps.
    #[doc(hidden)]
    #[must_use]
    pub fn smooth_after(&self, forward: TrellisForward) -> SmoothedTrellis {
        let TrellisForward { log_filtered, scales } = forward;
        let mut steps = self.steps.clone();
        steps.push(self.log_likelihoods.len());
        let mut log_backward = vec![0.0; log_filtered.len()];
        for step in (2..=self.steps()).rev() {
            // The backward logarithms of a step depend only on those of the next.
            let (earlier, later) = log_backward.split_at_mut(self.range(step).start);
            let earlier = &mut earlier[self.range(step - 1).start..];
            self.backward_step(step, scales[step - 1], later, earlier);
        }
        let filtered = log_filtered.iter().map(|log| log.exp()).collect();
        let mut smoothed: Vec<f64> = Vec::with_capacity(log_filtered.len());
        // γ = α ∘ β, normalised in each step, so any constant factor of a step cancels.
        for bounds in steps.windows(2) {
            let logs = bounds[0]..bounds[1];
            let log = logs.map(|s| log_filtered[s] + log_backward[s]);
            let sum = log_sum(log.clone());
            smoothed.extend(log.map(|log| (log - sum).exp()));
        }
        SmoothedTrellis { steps, log_filtered, filtered, smoothed, log_backward, scales }
    }
}

impl Trellis {
    /// Computes the backward logarithms of the states of the step that precedes `step`, from those
    /// of `step` (`later`).
    fn backward_step(&self, step: usize, scale: Scale, later: &[f64], earlier: &mut [f64]) {
        earlier.fill(f64::NEG_INFINITY);
        let log = |(state, later): (usize, &f64)| {
            (state, (self.log_likelihoods[state] - scale.likelihood) + later - scale.sum)
        };
        for (state, log) in self.range(step).zip(later).map(log) {
            self.moves_into(state)
                .for_each(|(j, weight)| earlier[j] = earlier[j].max((weight - scale.weight) + log));
        }
        // Log-sum-exp in two passes, the largest term and then the sum relative to it. Moves are
        // stored by their later state, so the terms of one earlier state are spread over all of
        // them.
        let mut sums = vec![0.0; earlier.len()];
        for (state, log) in self.range(step).zip(later).map(log) {
            for (j, weight) in self.moves_into(state) {
                let below = (weight - scale.weight) + log - earlier[j];
                // Terms below e^-45 = 2^-65 are beyond the digits of the sum, which is at least 1.
                // (False for the NaN of an earlier state at −∞, which leads nowhere possible.)
                if below > -45.0 {
                    sums[j] += if below == 0.0 { 1.0 } else { below.exp() };
                }
            }
        }
        let reached = earlier.iter_mut().zip(sums).filter(|(_, sum)| *sum > 0.0);
        reached.for_each(|(earlier, sum)| *earlier += sum.ln());
    }
}

impl SmoothedTrellis {
    /// Distribution p(X_k | y_1 … y_k) over the states of a step, from 1.
    ///
    /// # Panics
    ///
    /// If the step does not exist; this holds for all methods.
    #[must_use]
    pub fn filtered(&self, step: usize) -> &[f64] {
        &self.filtered[self.range(step)]
    }

    /// Distribution p(X_k | y_1 … y_T) over the states of a step.
    #[must_use]
    pub fn smoothed(&self, step: usize) -> &[f64] {
        &self.smoothed[self.range(step)]
    }

    /// Distribution p(X_k | y_1 … y_{k + lag}) over the states of a step, given all observations if
    /// there are fewer. `trellis` must be the one that was smoothed. O(moves of `lag` steps).
    #[must_use]
    pub fn lagged(&self, trellis: &Trellis, step: usize, lag: usize) -> Vec<f64> {
        let last = step.saturating_add(lag).min(self.steps.len() - 1);
        let mut later = vec![0.0; self.range(last).len()];
        for k in (step + 1..=last).rev() {
            let mut earlier = vec![0.0; self.range(k - 1).len()];
            trellis.backward_step(k, self.scales[k - 1], &later, &mut earlier);
            later = earlier;
        }
        let logs = self.log_filtered[self.range(step)].iter().zip(&later);
        let logs: Vec<f64> = logs.map(|(filtered, later)| filtered + later).collect();
        let sum = log_sum(logs.iter().copied());
        logs.into_iter().map(|log| (log - sum).exp()).collect()
    }

    /// ln p(y_k | y_1 … y_{k-1}).
    #[must_use]
    pub fn log_normalizer(&self, step: usize) -> f64 {
        self.scales[step - 1].log()
    }

    /// ln p(y_1 … y_T).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        let mut sum = LogSum::default();
        self.scales.iter().for_each(|scale| scale.add_to(&mut sum));
        sum.value()
    }

    /// Moves into a state of a step with their probabilities p(X_{k-1}, X_k | y_1 … y_T), in the
    /// order they were added: pairs (from, probability), which sum to one over all states
    /// of the step. `trellis` must be the one that was smoothed.
    pub fn moves<'a>(
        &'a self,
        trellis: &'a Trellis,
        step: usize,
        state: usize,
    ) -> impl Iterator<Item = (usize, f64)> + 'a {
        let number = self.range(step).start + state;
        let scale = self.scales[step - 1];
        // ln ξ = ln α_{k-1} + (weight − scale) + (likelihood − scale) + ln β_k − sum. Scales are
        // subtracted from their terms before these are added: a term may be as large as 1e300,
        // whereas the sum is at most 0.
        let likelihood = trellis.log_likelihoods[number] - scale.likelihood;
        let later = likelihood + self.log_backward[number] - scale.sum;
        trellis.moves_into(number).map(move |(from, weight)| {
            let before = match step {
                1 => 0.0,
                _ => self.log_filtered[self.range(step - 1).start + from],
            };
            (from, (before + (weight - scale.weight) + later).exp())
        })
    }

    fn range(&self, step: usize) -> std::ops::Range<usize> {
        self.steps[step - 1]..self.steps[step]
    }
}

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
        // The distribution already includes the observation of the step.
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
    #[must_use]
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
