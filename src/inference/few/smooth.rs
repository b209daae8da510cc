//! The smoother over a whole sequence: x forward, r backward; p(X_k | y_1 … y_T) is in proportion
//! to x_k ∘ r_k.

use std::ops::Range;

use super::likelihoods::{LikelihoodRows, Sensed};
use super::segments::{SegmentProducts, pack_segments, unpack_segments};
use super::{FewModel, control_of, log_of};
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::plan::{self, Engine};
use crate::inference::posteriors::Posteriors;
use crate::kernels::{
    ChainState, Eight, LANES, Packed, chain_backward, chain_forward, in_large_pages,
    smooth_segments,
};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// [`Hmm::smooth`].
pub(in super::super) fn smooth<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Posteriors, f64)>
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
    let mut attempt = |segments: bool| match states {
        3 => model.smooth::<3>(source, steps, &mut rows, segments),
        4 => model.smooth::<4>(source, steps, &mut rows, segments),
        _ => model.smooth::<2>(source, steps, &mut rows, segments),
    };
    let first =
        (plan::for_sequence(states, steps) == Engine::Segments).then(|| attempt(true)).flatten();
    let log_likelihood = first.or_else(|| attempt(false))?;
    Some((Posteriors::from_values(states, rows), log_likelihood))
}

/// Eight segments between the passes.
struct Kept<const N: usize> {
    steps: Range<usize>,
    segments: SegmentProducts<N>,
    starts: [Eight; N],
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
        let n = self.states;
        let (mut x, mut logs) = (self.prior, LogSum::default());
        let first = self.start(source, &mut x, &mut logs)?;
        // Row k is that of step k; the first is X_0, or X_1 if nothing moves before.
        let before = x;
        let mut left = first + 1..steps + 1;
        let few = self.few::<N>();
        let (mut packed, mut kept, mut scales) = (Vec::new(), Vec::new(), vec![0.0; steps]);
        while segments && let Some(length) = plan::segment_length(left.len()) {
            let steps = left.start..left.start + LANES * length;
            left.start = steps.end;
            // Likelihoods wait for the backward pass where results will be.
            let place = &mut rows[n * steps.start..n * steps.end];
            let scales = &mut scales[..steps.len()];
            if source.likelihoods(steps.clone(), false, place, scales)? {
                scales.iter().for_each(|log| logs.add(*log));
            }
            pack_segments(place, &mut packed);
            let segments = SegmentProducts::new(&few, &packed)?;
            let starts = segments.forward(&mut x)?;
            kept.push(Kept { steps, segments, starts });
        }
        let mut likelihoods = vec![0.0; n * left.len()];
        let scales = &mut scales[..left.len()];
        let chained = &mut rows[n * left.start..n * left.end];
        let mut normalizers = vec![0.0; left.len()];
        let start = x;
        let mut attempt = |scaled: bool| {
            x = start;
            let any = source.likelihoods(left.clone(), scaled, &mut likelihoods, scales)?;
            chain_forward(&self.columns, &mut x, n, &likelihoods, chained, &mut normalizers)
                .then_some(any)
        };
        // Scales take time, and are seldom needed.
        if attempt(false).or_else(|| attempt(true))? {
            scales.iter().for_each(|log| logs.add(*log));
        }
        let log_likelihood = log_of(&x, &logs);

        let mut r = ChainState::new(1.0);
        chain_backward(&self.rows, &mut r, n, &likelihoods, chained).then_some(())?;
        let mut smoothed = Vec::new();
        while let Some(Kept { steps, segments, starts }) = kept.pop() {
            let ends = segments.backward(&mut r)?;
            let place = &mut rows[n * steps.start..n * steps.end];
            pack_segments(place, &mut packed);
            smoothed.resize(packed.len(), [Packed::default(); N]);
            smooth_segments(&few, &starts, &ends, &packed, &mut smoothed)?;
            unpack_segments(smoothed.as_flattened(), place);
        }
        let mut posterior = before.values;
        posterior.iter_mut().zip(r.values).for_each(|(x, r)| *x *= r);
        let sum: f64 = posterior.iter().sum();
        for row in rows.chunks_exact_mut(n).take(first + 1) {
            row.iter_mut().zip(posterior).for_each(|(row, x)| *row = x / sum);
        }
        Some(log_likelihood)
    }
}
