//! The distribution of whole paths given the observations: samples from it (forward filtering,
//! backward sampling; Carter and Kohn 1994, Frühwirth-Schnatter 1994; section 8 of the
//! [formulas](crate::guide::formulas)), and its entropy (Hernando, Crespi and Cybenko 2005; section
//! 6).
//!
//! Given X_{k+1} and the observations up to k, X_k does not depend on anything later. So a path is
//! drawn from its end, each state from α_k weighted by the entries into the state after it.
//!
//! The invariant of the entropy's forward pass: before step k, `entropy[i]` is H_{k-1}(i), the
//! entropy of the states before X_{k-1} given X_{k-1} = i and the observations so far.

use std::fmt;

use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::step::forward_backward::ForwardPass;
use crate::inference::step::state::{BeliefRef, FilterSnapshot, StepScratch};
use crate::likelihood::Likelihood;
use crate::random::index;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;
use rand::Rng;

/// Sampler of whole paths from p(x_1 … x_T | y_1 … y_T).
///
/// Made by [`Hmm::path_sampler`], which filters; each draw is one backward pass.
pub struct PathSampler<'m, A, B, S: ?Sized> {
    hmm: &'m Hmm<A, B>,
    sequence: &'m S,
    block: ForwardPass,
    /// Steps whose entries need logarithms, in ascending order.
    entries_in_logs: Vec<usize>,
}

impl<A, B, S: ?Sized> fmt::Debug for PathSampler<'_, A, B, S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PathSampler").field("block", &self.block).finish_non_exhaustive()
    }
}

impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// Filters a sequence, and returns a sampler of hidden paths given all observations. It answers
    /// questions that marginals cannot: how long a drive was on a road, or whether it passed a
    /// place at all.
    ///
    /// Costs one product with A and O(n) a step, and n (T + 1) numbers of memory; a draw then takes
    /// O(entries into a state) a step.
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// # let hmm = wayfix::canberra::hmm(5, 1.0)?;
    /// let sightings = [4, 5, 5, 7, 8];
    /// let sampler = hmm.path_sampler(&sightings)?;
    /// let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// // The probability of having been at place 7 (state 6) at some step.
    /// let drives = 1000;
    /// let mut passed = 0;
    /// for _ in 0..drives {
    ///     passed += usize::from(sampler.draw(&mut rng)?.contains(&6));
    /// }
    /// # assert!(passed > 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`smooth`](Self::smooth).
    pub fn path_sampler<'m, S>(
        &'m self,
        sequence: &'m S,
    ) -> Result<PathSampler<'m, A, B, S>, HmmError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (block, _) = ForwardPass::over(self, sequence, 0, |_| ())?;
        let mut entries_in_logs = Vec::new();
        for number in 1..=sequence.steps() {
            let step = Step::of(self, sequence, number);
            // Asked once for each step here, instead of at every draw.
            if step.evidence()?.is_some() && step.entries_need_logs() {
                entries_in_logs.push(number);
            }
        }
        Ok(PathSampler { hmm: self, sequence, block, entries_in_logs })
    }
}

impl<A, B, S> PathSampler<'_, A, B, S>
where
    A: TransitionEntries,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    /// Draws the states of steps 1 to T. The same generator in the same state gives the same
    /// path.
    ///
    /// # Errors
    ///
    /// [`HmmError::PredictedSum`] if the operator lists no entry into a state that its
    /// product reaches: either it breaks its contract, or the entry is below 1e-323 and not listed
    /// as a logarithm either.
    pub fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> Result<Vec<usize>, HmmError> {
        let mut states = vec![0; self.sequence.steps()];
        let mut predecessors = Vec::new();
        // From the last step back: `states[at + 1]` is drawn before `states[at]`.
        for at in (0..states.len()).rev() {
            let row = at + 1; // step of states[at], and its row in the block
            let alpha = self.block.belief(row);
            match states.get(at + 1) {
                None => predecessors = alpha.linear.iter().copied().enumerate().collect(),
                Some(&to) => {
                    let step = Step::of(self.hmm, self.sequence, row + 1);
                    let Some(control) = step.control else { continue }; // only step 1 has none
                    let in_logs = self.entries_in_logs.binary_search(&(row + 1)).is_ok();
                    alpha.predecessors(
                        self.hmm.transition(),
                        control,
                        to,
                        in_logs,
                        &mut predecessors,
                    );
                }
            }
            // The weights are proportional to p(x_k | x_{k+1}, y_1 … y_k), and need not sum to one.
            let total: f64 = predecessors.iter().map(|entry| entry.1).sum();
            if total.is_nan() || total <= 0.0 {
                return Err(HmmError::PredictedSum { step: row + 1, sum: 0.0 });
            }
            states[at] = index(predecessors.iter().copied(), total, rng);
        }
        Ok(states)
    }
}

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
    pub fn path_entropy<S>(&self, sequence: &S) -> Result<f64, HmmError>
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
                step.entropies(state.belief_ref(), &entropy, &mut next, &mut predecessors)?;
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
    let belief = state.belief_ref();
    let mut sum = 0.0;
    for (i, (&p, entropy)) in belief.linear.iter().zip(entropy).enumerate() {
        // 0 ln 0 counts as 0.
        if p > 0.0 {
            sum += p * (entropy - belief.log(i));
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
    ) -> Result<(), HmmError> {
        let Some(control) = self.control else { return Ok(()) }; // only step 1 has none
        let in_logs = self.evidence()?.is_some() && self.entries_need_logs();
        for (i, after) in after.iter_mut().enumerate() {
            alpha.predecessors(self.hmm.transition(), control, i, in_logs, predecessors);
            let total: f64 = predecessors.iter().map(|entry| entry.1).sum();
            *after = 0.0;
            for &(j, weight) in &*predecessors {
                // The weights of an unreachable state are all 0 or NaN. Then q is NaN, the
                // comparison is false, and H is 0. It is never used, since α is 0 there.
                let q = weight / total;
                if q > 0.0 {
                    *after += q * (before[j] - q.ln());
                }
            }
        }
        Ok(())
    }
}
