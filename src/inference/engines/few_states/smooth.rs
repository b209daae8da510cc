//! The smoother over a whole sequence: x forward, r backward; p(X_k | y_1 … y_T) is in proportion
//! to x_k ∘ r_k.

use super::forward::Forward;
use super::likelihoods::{LikelihoodRows, Sensed};
use super::segments::{pack_segments, unpack_segments};
use super::{FewModel, control_of};
use crate::hmm::Hmm;
use crate::inference::engines::choice::{self, GATHERED};
use crate::inference::sequences::posteriors::Posteriors;
use crate::kernels::{ChainState, Packed, chain_backward, in_large_pages, smooth_segments};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// [`Hmm::smooth`].
pub(crate) fn smooth<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Posteriors, f64)>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (states, steps) = (hmm.states(), sequence.steps());
    let control = control_of(hmm, steps)?;
    let model = FewModel::new(hmm, control)?;
    let source: &mut dyn LikelihoodRows = &mut Sensed::new(hmm, sequence);
    let mut rows = in_large_pages(vec![0.0; states * (steps + 1)]);
    let log_likelihood = model.attempt(steps, |segments| match states {
        3 => model.smooth::<3>(source, steps, &mut rows, segments),
        4 => model.smooth::<4>(source, steps, &mut rows, segments),
        _ => model.smooth::<2>(source, steps, &mut rows, segments),
    })?;
    Some((Posteriors::from_values(states, rows), log_likelihood))
}

impl FewModel {
    /// Smooths a sequence, in segments for models of N states or step by step, and returns its
    /// log-likelihood.
    fn smooth<const N: usize>(
        &self,
        source: &mut dyn LikelihoodRows,
        steps: usize,
        rows: &mut [f64],
        segments: bool,
    ) -> Option<f64> {
        let (n, few) = (self.states, self.few::<N>());
        // Row k is that of step k; the first is X_0, or X_1 if nothing moves before.
        let (mut forward, first) = Forward::start(self, source)?;
        let before = forward.x.values;
        let mut left = first..steps + 1;
        let (mut packed, mut kept) = (Vec::new(), Vec::new());
        while segments && let Some(steps) = choice::next_segments(&mut left) {
            // Likelihoods wait for the backward pass where results will be.
            let place = &mut rows[n * steps.start..n * steps.end];
            let (products, starts) = forward.segments(&few, steps.clone(), place, &mut packed)?;
            kept.push((steps, products, starts));
        }
        let chained = n * left.start..n * left.end;
        let mut likelihoods = in_large_pages(vec![0.0; chained.len()]);
        while let Some(steps) = choice::next_steps(&mut left) {
            let (place, count) = (n * steps.start..n * steps.end, steps.len());
            let b = &mut likelihoods[place.start - chained.start..place.end - chained.start];
            forward.chain(steps, b, &mut rows[place], &mut [0.0; GATHERED][..count])?;
        }
        let log_likelihood = forward.log_likelihood();

        let mut r = ChainState::new(1.0);
        chain_backward(&self.rows, &mut r, n, &likelihoods, &mut rows[chained]).then_some(())?;
        let mut smoothed = Vec::new();
        while let Some((steps, products, starts)) = kept.pop() {
            let ends = products.backward(&mut r)?;
            let place = &mut rows[n * steps.start..n * steps.end];
            pack_segments(place, &mut packed);
            smoothed.resize(packed.len(), [Packed::default(); N]);
            smooth_segments(&few, &starts, &ends, &packed, &mut smoothed)?;
            unpack_segments(smoothed.as_flattened(), place);
        }
        let mut posterior = before;
        posterior.iter_mut().zip(r.values).for_each(|(x, r)| *x *= r);
        let sum: f64 = posterior.iter().sum();
        for row in rows.chunks_exact_mut(n).take(first) {
            row.iter_mut().zip(posterior).for_each(|(row, x)| *row = x / sum);
        }
        Some(log_likelihood)
    }
}
