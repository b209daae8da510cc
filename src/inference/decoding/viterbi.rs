//! Viterbi decoding: the most probable path (Viterbi 1967; section 7 of the
//! [formulas](crate::guide::formulas)).
//!
//! The invariant: up to an amount that is taken out of all, the score of a state is log2 of the
//! probability of the best path to it, on a grid on which sums are exact. So ties are ties, and
//! every decoder finds the same path.

use crate::error::HmmError;
use crate::hmm::Hmm;
use crate::inference::engines::{choice, few_states};
use crate::inference::step::scores::{TakenOut, best};
use crate::inference::step::{SensorScratch, Step};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::TransitionEntries;
use wayfix_kernels::{Aligned, in_large_pages};

/// The most probable path of hidden states, and its probability.
///
/// Made by [`Hmm::viterbi`] and [`Hmm::k_best`].
#[derive(Debug, Clone, PartialEq)]
pub struct ViterbiPath {
    pub(crate) states: Vec<usize>,
    pub(crate) log_probability: f64,
}

impl ViterbiPath {
    /// States of steps 1 to T: `states()[k - 1]` belongs to `ys[k - 1]`.
    #[must_use]
    pub fn states(&self) -> &[usize] {
        &self.states
    }

    /// Log-probability ln p(path, y_1 … y_T); never −∞, since an impossible path is an error.
    #[must_use]
    pub fn log_probability(&self) -> f64 {
        self.log_probability
    }

    /// Returns the states by value.
    #[must_use]
    pub fn into_states(self) -> Vec<usize> {
        self.states
    }
}

/// # Paths
impl<A: TransitionEntries, B: Likelihood> Hmm<A, B> {
    /// Returns the path that maximises p(x_1 … x_T, y_1 … y_T). The transition operator allows
    /// every move of it.
    ///
    /// Under [`Prior::BeforeFirstTransition`](crate::Prior::BeforeFirstTransition)
    /// the path starts at X_1, and X_0 is summed over.
    ///
    /// Ties go to the path with the lowest last state, then the lowest last but one, and so on.
    /// Paths tie if their factors are the same, in any order and up to powers of two, as long as
    /// none falls behind by more than 2^256 on the way; log-likelihoods tie as far as rounding
    /// allows. Paths that differ by less than rounding (1e-14 a factor) may be ranked either way.
    /// An empty sequence gives the empty path, with log-probability 0.
    ///
    /// O(E) a step; 4 n T bytes for the backpointers.
    ///
    /// # Errors
    ///
    /// [`HmmError`] with the step at which an observation is impossible
    /// or has no valid likelihood, or a control is not valid.
    pub fn viterbi<S>(&self, sequence: &S) -> Result<ViterbiPath, HmmError>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (n, steps) = (self.states(), sequence.steps());
        if steps == 0 {
            return Ok(ViterbiPath { states: Vec::new(), log_probability: 0.0 });
        }
        // Sums of scores are exact in both routines, so path and probability are the same to the
        // bit.
        if choice::is_whole(self.states(), sequence.steps())
            && let Some((states, log_probability)) = few_states::viterbi(self, sequence)
        {
            return Ok(ViterbiPath { states, log_probability });
        }
        let mut scratch = SensorScratch::new(n);
        let mut scores = Aligned::new(n, 0.0);
        let mut next = Aligned::new(n, 0.0);
        // Backpointers of steps 2 to T. Step 1 has none, since X_0 is summed over.
        let mut from = in_large_pages(vec![0_u32; n * (steps - 1)]);
        let mut taken_out = TakenOut::default();
        for number in 1..=steps {
            let step = Step::of(self, sequence, number);
            let observation = sequence.observation(number);
            if number == 1 {
                step.first_scores(&mut next, &mut taken_out)?;
                step.observe(observation, &mut scratch, &mut next, &mut taken_out)?;
                step.take_out_whole(&mut next, &mut taken_out)?;
            } else {
                let from = &mut from[(number - 2) * n..(number - 1) * n];
                let next = (&mut next[..], from);
                step.decode(&scores, Some(observation), next, &mut scratch, &mut taken_out)?;
            }
            std::mem::swap(&mut scores, &mut next);
        }
        // The rule for ties: `best` takes the lowest of the best last states, and every backpointer
        // is the lowest of the best predecessors.
        let mut state = best(&scores);
        let log_probability = taken_out.log_probability(scores[state]);
        let mut states = vec![state; steps];
        for index in (0..steps - 1).rev() {
            state = from[index * n + state] as usize;
            states[index] = state;
        }
        Ok(ViterbiPath { states, log_probability })
    }
}
