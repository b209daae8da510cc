//! Entropy of the whole path given the observations (Hernando, Crespi and Cybenko 2005; section 6
//! of the [formulas](crate::guide::formulas)).
//!
//! The invariant of the forward pass: before step k, `entropy[i]` is H_{k-1}(i), the entropy of the
//! states before X_{k-1} given X_{k-1} = i and the observations so far.

use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::step::in_logs::BeliefRef;
use crate::inference::step::state::{FilterSnapshot, StepScratch};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;

impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// Returns the Shannon entropy of p(x_1 … x_T | y_1 … y_T), in nats: the remaining
    /// uncertainty about the whole path, 0 if only one path is possible. It is at most the sum of
    /// the entropies of the smoothed beliefs.
    ///
    /// Takes one forward pass, with O(E) a step and O(n) memory. No term is negative, so that
    /// nothing cancels. The error is about 1e-12 nats: the logarithm of a probability near one is
    /// only as exact as that number's last digit.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let table = TableLikelihood::from_rows(&[[0.5, 0.5], [0.5, 0.5]])?;
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.5; 2]; 2])?, table)?;
    /// // One of two states is drawn at each of 3 steps, and the observations say nothing about it.
    /// assert!((hmm.path_entropy(&[0, 1, 0])? - 8.0_f64.ln()).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`smooth`](Self::smooth).
    pub fn path_entropy<S>(&self, sequence: &S) -> Result<f64, InferenceError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let n = self.states();
        let prior = self.prior().belief().as_slice();
        let (mut state, mut scratch) = (FilterSnapshot::start(prior), StepScratch::new(prior));
        // H(x_1 … x_{k-1} | x_k, y_1 … y_{k-1}) for each x_k.
        let mut entropy = vec![0.0; n];
        let mut next = entropy.clone();
        let mut predecessors = Vec::new();
        for number in 1..=sequence.steps() {
            // The chain rule needs p(X_{k-1} | X_k, y_1 … y_{k-1}), and thus the belief before the
            // observation of step k: first the entropies, then the filter.
            let step = Step::of(self, sequence, number);
            if number > 1 {
                step.entropies(state.held(), &entropy, &mut next, &mut predecessors)?;
                std::mem::swap(&mut entropy, &mut next);
            }
            state.advance(&step, sequence.observation(number), &mut scratch)?;
        }
        if sequence.steps() == 0 {
            return Ok(0.0);
        }
        Ok(total(&state, &entropy))
    }
}

/// Returns Σ_i α_T(i) (H_T(i) − ln α_T(i)).
fn total(state: &FilterSnapshot, entropy: &[f64]) -> f64 {
    let held = state.held();
    let mut sum = 0.0;
    for (i, (&p, entropy)) in held.linear.iter().zip(entropy).enumerate() {
        // 0 ln 0 counts as 0.
        if p > 0.0 {
            sum += p * (entropy - held.log(i));
        }
    }
    sum
}

impl<A: TransitionEntries, B: Likelihood> Step<'_, A, B> {
    /// Computes H_k(i) = Σ_j q_j (H_{k-1}(j) − ln q_j), where q_j is the probability that i was
    /// reached from j, proportional to A\[i, j\] α_{k-1}(j).
    fn entropies(
        &self,
        alpha: BeliefRef<'_>,
        before: &[f64],
        after: &mut [f64],
        predecessors: &mut Vec<(usize, f64)>,
    ) -> Result<(), InferenceError> {
        let Some(control) = self.control else { return Ok(()) }; // only step 1 has none
        let in_logs = self.evidence()?.is_some() && self.entries_need_logs();
        for (i, after) in after.iter_mut().enumerate() {
            alpha.predecessors(self.hmm.transition(), control, i, in_logs, predecessors);
            let total: f64 = predecessors.iter().map(|entry| entry.1).sum();
            *after = 0.0;
            for &(j, weight) in &*predecessors {
                // The weights of an unreachable state are all 0 or NaN. Then q is NaN, the
                // comparison is false, and H is 0; α is 0 there, so that it is never used.
                let q = weight / total;
                if q > 0.0 {
                    *after += q * (before[j] - q.ln());
                }
            }
        }
        Ok(())
    }
}
