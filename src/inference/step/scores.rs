//! Scores of the decoders: sums of logarithms to base 2, rounded to a grid on which sums are exact
//! (`kernels::log2`; "The grid" in section 7 of the [formulas](crate::guide::formulas)), so that
//! ties are ties. Each step subtracts a whole number from all scores, which is exact too, so that
//! scores stay small and keep their digits over any number of steps.

use std::f64::consts::{LN_2, LOG2_E};

use super::{SensorScratch, Step};
use crate::error::HmmError;
use crate::inference::LogSum;
use crate::likelihood::{Diagonal, Likelihood, Values};
use crate::transition::TransitionEntries;
use wayfix_kernels::limits::{self, LIFT};
use wayfix_kernels::{self as kernels, Scores, ScoresIn};

/// Amounts that have been taken out of the scores.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct TakenOut {
    /// Sum of the whole numbers, an exact integer.
    pub(crate) whole: f64,
    pub(crate) factors: LogSum,
}

impl TakenOut {
    /// Returns ln p of a path with this score.
    pub(crate) fn log_probability(&self, score: f64) -> f64 {
        let mut sum = self.factors;
        sum.add(self.whole * LN_2);
        sum.add(score * LN_2);
        sum.value()
    }

    /// Records the whole part of the best score as taken out, and returns it.
    fn whole_of(&mut self, best: f64) -> f64 {
        let floor = best.floor();
        self.whole += floor;
        floor
    }
}

impl<A: TransitionEntries, B: Likelihood> Step<'_, A, B> {
    /// Computes the scores of the states of step 1, before its observation; X_0 is summed over.
    pub(crate) fn first_scores(
        &self,
        scores: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Result<(), HmmError> {
        let prior = self.hmm.prior().belief().as_slice();
        // Lifted, so that a small prior times a small entry does not underflow before its logarithm
        // is taken ("Scores and draws" in `limits`).
        let mut lifted = vec![0.0; prior.len()];
        kernels::lift(prior, &mut lifted);
        let evidence = self.evidence()?;
        if let Some(log_factor) = evidence {
            taken_out.factors.add(log_factor);
            // The operator itself reports factors outside the range of doubles.
            if self.needs_logs() {
                return self.first_scores_in_logs(scores, &mut lifted);
            }
        }
        self.predict(&lifted, scores);
        match evidence {
            Some(_) if self.evidence_sum(scores)?.is_none() => {
                return self.first_scores_in_logs(scores, &mut lifted);
            }
            Some(_) => {}
            None => _ = self.check_prediction(scores)?,
        }
        let tiny = |p: &f64| limits::is_tiny(*p);
        if let (Some(control), true) = (self.control, prior.iter().any(tiny)) {
            // A tiny prior times an entry may underflow even when lifted. Only such sums (lifted
            // below 1) are taken from logarithms; the others keep their linear scores, since the
            // two computations may round differently, which would break ties.
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

    /// Computes the first scores in logarithms, if the evidence on the first move leaves the range
    /// of `f64`.
    #[cold]
    fn first_scores_in_logs(&self, scores: &mut [f64], logs: &mut [f64]) -> Result<(), HmmError> {
        let Some(control) = self.control else { return Ok(()) }; // no evidence without one
        let prior = self.hmm.prior().belief().as_slice();
        logs.iter_mut().zip(prior).for_each(|(log, p)| *log = p.ln());
        self.hmm.transition().apply_log(control, logs, scores);
        self.check_log_evidence(scores)?;
        scores.iter_mut().for_each(|score| *score = kernels::on_grid(*score * LOG2_E));
        Ok(())
    }

    /// Takes out the log factor of the evidence on the move. Returns true if there is evidence.
    pub(crate) fn take_out_evidence(&self, taken_out: &mut TakenOut) -> Result<bool, HmmError> {
        let evidence = self.evidence()?;
        evidence.iter().for_each(|log_factor| taken_out.factors.add(*log_factor));
        Ok(evidence.is_some())
    }

    /// Returns an error if evidence on the move is invalid, or leaves no path with a probability
    /// above 0. `best` is the score of the best path.
    pub(crate) fn check_best_path(&self, best: f64) -> Result<(), HmmError> {
        let step = self.number;
        if best.is_finite() {
            Ok(())
        } else if best == f64::NEG_INFINITY {
            Err(HmmError::ImpossibleMove { step })
        } else {
            Err(HmmError::EvidenceFactor { step, value: best })
        }
    }

    /// Takes a step of Viterbi: finds the best predecessor of each state, adds the likelihoods of
    /// the observation if there is one, and takes out a whole number.
    pub(crate) fn decode(
        &self,
        scores: &[f64],
        observation: Option<&B::Observation>,
        (next, from): (&mut [f64], &mut [u32]),
        sensor: &mut SensorScratch,
        taken_out: &mut TakenOut,
    ) -> Result<(), HmmError> {
        let scratch = &mut sensor.scratch;
        let likelihoods = match observation {
            Some(observation) => {
                scratch.ask_for_log2();
                let (diagonal, largest) = self.diagonal(observation, scratch)?;
                let scores = likelihood_scores(&diagonal, largest, taken_out);
                Some(scores.ok_or(HmmError::Impossible { step: self.number })?)
            }
            None => None,
        };
        let Some(control) = self.control else { return Ok(()) }; // only step 1 has none
        let evidence = self.take_out_evidence(taken_out)?;
        let transition = self.hmm.transition();
        // The kernel of a stored matrix adds the likelihoods and finds the best score in the same
        // pass.
        let largest = if let Some(matrix) = self.stored(control) {
            matrix.maximize(scores, likelihoods, next, from)
        } else {
            transition.max_product(control, scores, next, from);
            if evidence {
                self.check_best_path(next.iter().copied().fold(f64::NEG_INFINITY, f64::max))?;
            }
            kernels::add_scores(next, likelihoods)
        };
        self.take_out_whole_of(next, largest, taken_out)?;
        Ok(())
    }

    /// Adds the likelihoods of an observation to the scores.
    pub(crate) fn observe(
        &self,
        observation: &B::Observation,
        sensor: &mut SensorScratch,
        scores: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Result<(), HmmError> {
        let scratch = &mut sensor.scratch;
        scratch.ask_for_log2();
        let (diagonal, largest) = self.diagonal(observation, scratch)?;
        let likelihoods = likelihood_scores(&diagonal, largest, taken_out)
            .ok_or(HmmError::Impossible { step: self.number })?;
        kernels::add_scores(scores, Some(likelihoods));
        Ok(())
    }

    /// Takes a whole number out of the scores, and returns it. Fails if all scores are −∞.
    pub(crate) fn take_out_whole(
        &self,
        scores: &mut [f64],
        taken_out: &mut TakenOut,
    ) -> Result<f64, HmmError> {
        let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.take_out_whole_of(scores, best, taken_out)
    }

    fn take_out_whole_of(
        &self,
        scores: &mut [f64],
        best: f64,
        taken_out: &mut TakenOut,
    ) -> Result<f64, HmmError> {
        // No path is left.
        if best == f64::NEG_INFINITY {
            return Err(HmmError::Impossible { step: self.number });
        }
        // The best score is now from 0 to 1. Scores down to −256 are multiples of 2^-45 that
        // doubles hold exactly, so this subtraction and later sums stay exact.
        let floor = taken_out.whole_of(best);
        scores.iter_mut().for_each(|score| *score -= floor);
        Ok(floor)
    }
}

/// Returns log2 of a probability, given lifted. The lift is undone first if that keeps all digits,
/// so that equal numbers have equal scores whether they were lifted or not.
pub(crate) fn unlifted_log2(lifted: f64) -> f64 {
    let p = lifted / LIFT;
    if p >= f64::MIN_POSITIVE { kernels::log2(p) } else { kernels::log2(lifted) - LIFT.log2() }
}

/// Returns the state with the highest score, the lowest of them in a tie.
pub(crate) fn best(scores: &[f64]) -> usize {
    let mut state = 0;
    for (i, &score) in scores.iter().enumerate() {
        if score > scores[state] {
            state = i;
        }
    }
    state
}

/// Returns the scores of likelihoods, with a common part taken out to keep them small, or `None` if
/// all likelihoods are 0.
pub(crate) fn likelihood_scores<'a>(
    diagonal: &Diagonal<'a>,
    largest: f64,
    taken_out: &mut TakenOut,
) -> Option<Scores<'a>> {
    let (values, form) = match diagonal.values {
        Values::Log(logs) => {
            if largest == f64::NEG_INFINITY {
                return None;
            }
            taken_out.factors.add(largest + diagonal.log_factor);
            return Some(Scores { values: logs, form: ScoresIn::Ln(largest), shift: 0.0 });
        }
        Values::Checked { log2: Some(scores), .. } => (scores, ScoresIn::Log2),
        Values::Linear(linear) | Values::Checked { linear, .. } => (linear, ScoresIn::Linear),
    };
    if largest == 0.0 {
        return None;
    }
    if diagonal.log_factor != 0.0 {
        taken_out.factors.add(diagonal.log_factor);
    }
    // A whole power of two is taken out without rounding.
    let shift = taken_out.whole_of(kernels::log2(largest));
    Some(Scores { values, form, shift })
}
