//! The smoother over a whole sequence: x forward, r backward, and p(X_k | y_1 … y_T) ∝ x_k ∘ r_k
//! ("Few states" in section 3 of the [formulas](crate::guide::formulas)).

use super::FewStatesModel;
use super::forward::Forward;
use super::likelihoods::{LikelihoodRows, SensorRows};
use super::segments::{pack_segments, unpack_segments};
use crate::hmm::Hmm;
use crate::inference::engines::choice::{self, GATHERED};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::{ChainState, Packed, chain_backward, in_large_pages, smooth_segments};

/// Smooths a sequence as [`Hmm::smooth`] does: returns a row for each step from 0, and the
/// log-likelihood.
pub(crate) fn smooth<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Vec<f64>, f64)>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (states, steps) = (hmm.states(), sequence.steps());
    let model = FewStatesModel::new(hmm)?;
    let source: &mut dyn LikelihoodRows = &mut SensorRows::new(hmm, sequence);
    let mut rows = in_large_pages(vec![0.0; states * (steps + 1)]);
    let log_likelihood = model.in_segments_or_steps(steps, |segments| match states {
        3 => model.smooth::<3>(source, steps, &mut rows, segments),
        4 => model.smooth::<4>(source, steps, &mut rows, segments),
        _ => model.smooth::<2>(source, steps, &mut rows, segments),
    })?;
    Some((rows, log_likelihood))
}

impl FewStatesModel {
    /// Smooths a sequence, in segments for models of N states or step by step, and returns its
    /// log-likelihood.
    fn smooth<const N: usize>(
        &self,
        source: &mut dyn LikelihoodRows,
        steps: usize,
        rows: &mut [f64],
        segments: bool,
    ) -> Option<f64> {
        let (n, segment_model) = (self.states, self.segment_model::<N>());
        // `before` is x before the first transition: of X_0, or of X_1 if no move leads to it.
        let (mut forward, first) = Forward::start(self, source)?;
        let before = forward.x.values;
        let mut remaining = first..steps + 1;
        let (mut packed, mut passed) = (Vec::new(), Vec::new());
        // The products of the segments are used twice: x goes through them forward, r backward.
        while segments && let Some(steps) = choice::next_segments(&mut remaining) {
            // The likelihoods are kept for the backward pass in the place of the results.
            let place = &mut rows[n * steps.start..n * steps.end];
            let (products, starts) =
                forward.segments(&segment_model, steps.clone(), place, &mut packed)?;
            passed.push((steps, products, starts));
        }
        let chained = n * remaining.start..n * remaining.end;
        let mut likelihoods = in_large_pages(vec![0.0; chained.len()]);
        while let Some(steps) = choice::next_steps(&mut remaining) {
            let (place, count) = (n * steps.start..n * steps.end, steps.len());
            let b = &mut likelihoods[place.start - chained.start..place.end - chained.start];
            forward.chain(steps, b, &mut rows[place], &mut [0.0; GATHERED][..count])?;
        }
        let log_likelihood = forward.log_likelihood();

        // Nothing is observed after T, so that r is one in all states, and the last posterior is
        // the filtered one. The chain comes last in the sequence, so it is the first on the way
        // back.
        let mut r = ChainState::new(1.0);
        chain_backward(&self.rows, &mut r, n, &likelihoods, &mut rows[chained]).then_some(())?;
        let mut smoothed = Vec::new();
        while let Some((steps, products, starts)) = passed.pop() {
            let ends = products.backward(&mut r)?;
            let place = &mut rows[n * steps.start..n * steps.end];
            pack_segments(place, &mut packed);
            smoothed.resize(packed.len(), [Packed::default(); N]);
            smooth_segments(&segment_model, &starts, &ends, &packed, &mut smoothed)?;
            unpack_segments(smoothed.as_flattened(), place);
        }
        // The rows before the first transition: that of X_0, and that of X_1 too if no move leads
        // to it, since then both are the same state.
        let mut posterior = before;
        posterior.iter_mut().zip(r.values).for_each(|(x, r)| *x *= r);
        let sum: f64 = posterior.iter().sum();
        for row in rows.chunks_exact_mut(n).take(first) {
            row.iter_mut().zip(posterior).for_each(|(row, x)| *row = x / sum);
        }
        Some(log_likelihood)
    }
}
