//! What the decoders share: scores, which are sums of logarithms to base 2 on
//! a grid on which sums are exact (see `kernels::log2`), so that ties are ties.
//! Whole numbers are taken out of them at every step, which is exact too, and
//! keeps their digits over any number of steps.

use std::f64::consts::{LN_2, LOG2_E};

use super::LogSum;
use super::step::Step;
use crate::error::InferenceError;
use crate::kernels::{self, LIFT};
use crate::likelihood::{Diagonal, Likelihood, Scratch, Values};
use crate::transition::TransitionEntries;

/// 2^-900. A prior of at least this, lifted, is above 2^99: its product with
/// the least entry, 2^-1074, is a double with all its digits.
const LEAST_PRIOR: f64 = f64::from_bits((1023 - 900) << 52);

/// What was taken out of the scores.
#[derive(Debug, Clone, Default)]
pub(super) struct TakenOut {
    /// An integer, exactly.
    pub(super) whole: f64,
    pub(super) factors: LogSum,
}

impl TakenOut {
    /// ln of the probability of a path with this score.
    pub(super) fn log_probability(&self, score: f64) -> f64 {
        let mut sum = self.factors;
        sum.add(self.whole * LN_2);
        sum.add(score * LN_2);
        sum.value()
    }

    /// What can be taken out of scores of which this is the best.
    fn whole_of(&mut self, best: f64) -> f64 {
        let floor = best.floor();
        self.whole += floor;
        floor
    }
}

impl<A: TransitionEntries, B: Likelihood> Step<'_, A, B> {
    /// The scores of the states of step 1, before its observation: X_0 is
    /// summed over.
    pub(super) fn first_scores(&self, scores: &mut [f64]) -> Result<(), InferenceError> {
        let prior = self.hmm.prior().belief().as_slice();
        let mut lifted = vec![0.0; prior.len()];
        kernels::lift(prior, &mut lifted);
        self.predict(&lifted, scores)?;
        self.check_prediction(scores)?;
        let tiny = |p: &f64| *p > 0.0 && *p < LEAST_PRIOR;
        if let (Some(control), true) = (self.control, prior.iter().any(tiny)) {
            // Products of two such numbers may be beyond a double. Where they are
            // not, scores stay as they are, for the sake of ties.
            let (mut logs, mut next) = (lifted, vec![0.0; prior.len()]);
            logs.iter_mut().zip(prior).for_each(|(log, p)| *log = p.ln());
            self.hmm.transition().apply_log(control, &logs, &mut next);
            for (score, log) in scores.iter_mut().zip(next) {
                let log2 = kernels::on_grid(log * LOG2_E);
                *score = if *score < 1.0 { log2 } else { unlifted_log2(*score) };
            }
        } else {
            scores.iter_mut().for_each(|score| *score = unlifted_log2(*score));
        }
        Ok(())
    }

    /// The best way into each state.
    pub(super) fn maximise(
        &self,
        scores: &[f64],
        next: &mut [f64],
        from: &mut [u32],
    ) -> Result<(), InferenceError> {
        let Some(control) = self.control else { return Ok(()) }; // only step 1 has none
        self.check_control(control)?;
        self.hmm.transition().max_product(control, scores, next, from);
        Ok(())
    }

    /// Adds the likelihoods to the scores.
    pub(super) fn observe(
        &self,
        observation: &B::Observation,
        scratch: &mut Scratch,
        scores: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Result<(), InferenceError> {
        let (diagonal, largest) = self.diagonal(observation, scratch)?;
        taken_out.factors.add(add_likelihoods(diagonal, largest, scores));
        Ok(())
    }

    /// Takes a whole number out of scores, and returns it; an error if all are
    /// −∞.
    pub(super) fn settle(
        &self,
        scores: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Result<f64, InferenceError> {
        let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if best == f64::NEG_INFINITY {
            return Err(InferenceError::Impossible { step: self.number });
        }
        let floor = taken_out.whole_of(best);
        scores.iter_mut().for_each(|score| *score -= floor);
        Ok(floor)
    }
}

/// log2 of a lifted probability. Where it is a double with all its digits, of
/// that itself: a prior then has the same logarithm as an entry of its size.
fn unlifted_log2(lifted: f64) -> f64 {
    let p = lifted / LIFT;
    if p >= f64::MIN_POSITIVE { kernels::log2(p) } else { kernels::log2(lifted) - LIFT.log2() }
}

/// The lowest state of the highest score.
pub(super) fn best(scores: &[f64]) -> usize {
    let mut state = 0;
    for (i, &score) in scores.iter().enumerate() {
        if score > scores[state] {
            state = i;
        }
    }
    state
}

/// Adds log2 b to the scores, but for a common part that keeps them small;
/// returns what was left out, as a natural logarithm.
pub(super) fn add_likelihoods(diagonal: Diagonal<'_>, largest: f64, score: &mut [f64]) -> f64 {
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
