//! Forward filtering, backward sampling (Carter and Kohn 1994, Frühwirth-Schnatter 1994; section 8
//! of the [formulas](crate::guide::formulas)).
//!
//! Given X_{k+1} and the observations up to k, X_k does not depend on anything later. So a path is
//! drawn from its end, each state from α_k weighted by the entries into the state after it.

use std::fmt;

use rand::Rng;

use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::step::forward_pass::ForwardPass;
use crate::likelihood::Likelihood;
use crate::random::index;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;

/// Sampler of whole paths from p(x_1 … x_T | y_1 … y_T).
///
/// Made by [`Hmm::path_sampler`], which filters; each draw is one backward pass.
pub struct PathSampler<'m, A, B, S: ?Sized> {
    hmm: &'m Hmm<A, B>,
    sequence: &'m S,
    block: ForwardPass,
    /// Steps whose entries need logarithms, in ascending order.
    in_logs: Vec<usize>,
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
    ) -> Result<PathSampler<'m, A, B, S>, InferenceError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (block, _) = ForwardPass::over(self, sequence, 0, |_| ())?;
        let mut in_logs = Vec::new();
        for number in 1..=sequence.steps() {
            let step = Step::of(self, sequence, number);
            // Asked once for each step here, instead of at every draw.
            if step.evidence()?.is_some() && step.entries_need_logs() {
                in_logs.push(number);
            }
        }
        Ok(PathSampler { hmm: self, sequence, block, in_logs })
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
    /// [`InferenceError::PredictedSum`] if the operator lists no entry into a state that its
    /// product reaches: either it breaks its contract, or the entry is below 1e-323 and not listed
    /// as a logarithm either.
    pub fn draw<R: Rng + ?Sized>(&self, rng: &mut R) -> Result<Vec<usize>, InferenceError> {
        let mut states = vec![0; self.sequence.steps()];
        let mut predecessors = Vec::new();
        // From the last step back: `states[at + 1]` is drawn before `states[at]`.
        for at in (0..states.len()).rev() {
            let row = at + 1; // step of states[at], and its row in the block
            let alpha = self.block.held(row);
            match states.get(at + 1) {
                None => predecessors = alpha.linear.iter().copied().enumerate().collect(),
                Some(&to) => {
                    let step = Step::of(self.hmm, self.sequence, row + 1);
                    let Some(control) = step.control else { continue }; // only step 1 has none
                    let in_logs = self.in_logs.binary_search(&(row + 1)).is_ok();
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
                return Err(InferenceError::PredictedSum { step: row + 1, sum: 0.0 });
            }
            states[at] = index(predecessors.iter().copied(), total, rng);
        }
        Ok(states)
    }
}
