//! Expectations of a sequence under a model of up to eight states, from whole passes.
//!
//! The filter and the smoother of such models take many steps in one call of a kernel
//! ([`few_states`](crate::inference::engines::few_states)), which is many times faster than single
//! steps. Expected moves ξ_k = α_{k-1}(j) A\[i, j\] γ_k(i) / p_k(i) also need p_k = A α_{k-1}, a
//! product of a few states.

use super::entry_sums::EntrySums;
use super::expectations::Expectations;
use crate::hmm::Hmm;
use crate::inference::engines::{choice, few_states};
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::LearnTransition;

/// Prediction below which γ / p may leave the range of doubles.
const LEAST: f64 = 1e-280;

impl<A: LearnTransition, B: LearnLikelihood> Hmm<A, B> {
    /// Adds the expectations of a sequence. Returns `None`, with nothing added, if the sequence
    /// does not suit this: single steps can use logarithms, and report errors.
    pub(super) fn add_few_states<S>(
        &self,
        sequence: &S,
        expected: &mut Expectations<B, A::Statistics>,
    ) -> Option<()>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let (n, steps) = (self.states(), sequence.steps());
        if !choice::learns_whole(n, steps) {
            return None;
        }
        let mut entries = EntrySums::new(self, &mut expected.moves)?;
        let (alpha, _, _) = few_states::filter(self, sequence)?;
        let (gamma, log_likelihood) = few_states::smooth(self, sequence)?;
        let mut ratio = vec![0.0; n];
        // `entries` collects the moves until `finish`, so that `None` below leaves nothing behind.
        let first = if self.prior().moves_at(1) { 1 } else { 2 };
        for number in first..=steps {
            let alpha = &alpha[(number - 1) * n..][..n];
            entries.predict(alpha, &mut ratio);
            for (ratio, gamma) in ratio.iter_mut().zip(&gamma[number * n..]) {
                if *gamma > 0.0 && *ratio < LEAST {
                    return None;
                }
                // A state without γ has no moves into it; its p may be 0.
                *ratio = if *gamma > 0.0 { gamma / *ratio } else { 0.0 };
            }
            entries.add(alpha, &ratio, 1.0);
        }
        expected.first.copy_from_slice(&gamma[..n]);
        for (number, posterior) in (1..).zip(gamma[n..].chunks_exact(n)) {
            self.likelihood().add(&mut expected.sensor, sequence.observation(number), posterior);
        }
        entries.finish(self, &mut expected.moves);
        expected.log_likelihood.add(log_likelihood);
        Some(())
    }
}
