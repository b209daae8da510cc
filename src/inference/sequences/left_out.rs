//! Distributions of each step without its own observation: given the observations before it, and
//! given all others (sections 2 and 3 of the [formulas](crate::guide::formulas)).
//!
//! γ_k divided by the likelihood of y_k would lose the states that y_k rules out. So the backward
//! pass computes β_k itself, in logarithms, since it may leave the range of doubles at any step.

use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::step::state::normalize_logs;
use crate::inference::step::state::{FilterSnapshot, StepScratch};
use crate::likelihood::{Likelihood, Scratch};
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Distributions of X_k for k = 1 … T, in rows of n numbers.
#[derive(Debug)]
pub struct LeftOut {
    /// p(X_k | y_1 … y_{k-1})
    pub predicted: Vec<f64>,
    /// p(X_k | y_1 … y_{k-1}, y_{k+1} … y_T)
    pub others: Vec<f64>,
}

/// Returns both distributions of all steps, by one product with A for each step, and one with A' in
/// logarithms.
///
/// # Errors
///
/// [`HmmError`] with the step, as for the smoother.
pub fn left_out<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Result<LeftOut, HmmError>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (n, steps, prior) = (hmm.states(), sequence.steps(), hmm.prior().belief().as_slice());
    let (mut state, mut scratch) = (FilterSnapshot::start(prior), StepScratch::new(prior));
    // `others` first holds ln p_k, which the backward pass replaces by the distributions.
    let (mut predicted, mut others) = (Vec::with_capacity(n * steps), vec![0.0; n * steps]);
    for (number, row) in (1..).zip(others.chunks_exact_mut(n)) {
        let step = Step::of(hmm, sequence, number);
        let outcome = step.advance_unseen(state.belief_ref(), &mut scratch)?;
        state.commit(number, &outcome, &mut scratch);
        predicted.extend_from_slice(state.belief_ref().linear);
        state.belief_ref().logs_to(row);
        let update = Step { hmm, number, control: None };
        state.advance(&update, sequence.observation(number), &mut scratch)?;
    }
    // `back` is ln β_k up to a constant: p(X_k | all others) ∝ p_k ∘ β_k, then
    // β_{k-1} = A' (b_k ∘ β_k) (paper eq. 12).
    let (mut back, mut next) = (vec![0.0; n], vec![0.0; n]);
    let mut memory = Scratch::default();
    for (before, row) in others.chunks_exact_mut(n).enumerate().rev() {
        let number = before + 1;
        row.iter_mut().zip(&back).for_each(|(log, back)| *log += back);
        let sum = normalize_logs(row, &mut next);
        sum.ok_or(HmmError::PredictedSum { step: number, sum: 0.0 })?;
        row.copy_from_slice(&next);

        let step = Step::of(hmm, sequence, number);
        let (diagonal, _) = step.diagonal(sequence.observation(number), &mut memory)?;
        back.iter_mut().zip(diagonal.logs()).for_each(|(back, log)| *back += log);
        if let Some(control) = step.control {
            hmm.transition().apply_transpose_log(control, &back, &mut next);
            std::mem::swap(&mut back, &mut next);
        }
        // β may have any scale; without this, its logarithms would grow and lose digits.
        let largest = back.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if largest.is_finite() {
            back.iter_mut().for_each(|back| *back -= largest);
        }
    }
    Ok(LeftOut { predicted, others })
}
