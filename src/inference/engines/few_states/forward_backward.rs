//! Filter and smoother over a whole sequence ("Few states" in section 3 of the
//! [formulas](crate::guide::formulas)): x_k = b_k ∘ A x_{k−1} forward without normalisation, r
//! backward, and p(X_k | y_1 … y_T) ∝ x_k ∘ r_k.
//!
//! The invariant: x, times two to its exponent, times everything taken out of the likelihoods, is
//! p(X_k, y_1 … y_k). It is never divided by its sum, so that only powers of two are taken out.

use std::ops::Range;

use super::likelihoods::{LikelihoodRows, SensorRows};
use super::{FewStatesModel, SegmentProducts, pack_segments, rescale, unpack_segments};
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::engines::choice;
use crate::inference::engines::choice::GATHERED;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::{
    ChainState, Eight, LANES, Packed, SmallModel, chain_backward, chain_forward, filter_segments,
    in_large_pages, smooth_segments,
};

/// The vector, and the scales that were taken out of the likelihoods.
pub(crate) struct Forward<'m> {
    model: &'m FewStatesModel,
    source: &'m mut dyn LikelihoodRows,
    pub(crate) x: ChainState,
    logs: LogSum,
    /// Logarithm of the scale taken out of each of the steps that were gathered last.
    pub(crate) scales: Vec<f64>,
}

impl<'m> Forward<'m> {
    /// Starts from the prior. If no transition leads to the first observation, this also takes step
    /// 1. Returns the number of the next step too.
    pub(crate) fn start(
        model: &'m FewStatesModel,
        source: &'m mut dyn LikelihoodRows,
    ) -> Option<(Self, usize)> {
        let (x, logs) = (model.prior, LogSum::default());
        let mut start = Self { model, source, x, logs, scales: Vec::new() };
        if model.moves {
            return Some((start, 1));
        }
        let mut b = [0.0; LANES];
        // Step 1 has no transition: its likelihoods multiply the prior.
        let was_scaled = start.gather(1..2, true, &mut b[..model.states])?;
        start.take_out(was_scaled);
        start.x.values.iter_mut().zip(b).for_each(|(x, b)| *x *= b);
        rescale(&mut start.x)?;
        Some((start, 2))
    }

    /// Copies the likelihoods of some steps. Returns true if they were scaled.
    fn gather(&mut self, steps: Range<usize>, scaled: bool, out: &mut [f64]) -> Option<bool> {
        self.scales.resize(steps.len(), 0.0);
        self.source.likelihoods(steps, scaled, out, &mut self.scales)
    }

    fn take_out(&mut self, was_scaled: bool) {
        if was_scaled {
            self.scales.iter().for_each(|log| self.logs.add(*log));
        } else {
            self.scales.fill(0.0);
        }
    }

    /// Returns ln Σ x, with the scales that were taken out of likelihoods.
    pub(crate) fn log_likelihood(&self) -> f64 {
        // Σ_i p(X_k = i, y_1 … y_k) = p(y_1 … y_k).
        let mut sum = self.logs;
        sum.add(self.x.values.iter().sum::<f64>().ln());
        sum.add(self.x.exponent as f64 * std::f64::consts::LN_2);
        sum.value()
    }

    /// Takes some steps one by one; see [`chain_forward`].
    pub(crate) fn chain(
        &mut self,
        steps: Range<usize>,
        likelihoods: &mut [f64],
        rows: &mut [f64],
        normalizers: &mut [f64],
    ) -> Option<()> {
        // The kernel may fail after some steps. The second attempt starts from the same vector.
        let before = self.x;
        // First without scaling, which takes time and is seldom needed.
        for scaled in [false, true] {
            let was_scaled = self.gather(steps.clone(), scaled, likelihoods)?;
            let FewStatesModel { columns, states, .. } = self.model;
            self.x = before;
            if chain_forward(columns, &mut self.x, *states, likelihoods, rows, normalizers) {
                self.take_out(was_scaled);
                return Some(());
            }
            // The likelihoods were scaled already, so their range is too wide for a chain.
            if was_scaled {
                break;
            }
        }
        None
    }

    /// Takes x through eight segments, after copying and packing their likelihoods. Returns the
    /// products of the segments, and x at the start of each.
    pub(crate) fn segments<const N: usize>(
        &mut self,
        model: &SmallModel<N>,
        steps: Range<usize>,
        likelihoods: &mut [f64],
        packed: &mut Vec<[Packed; N]>,
    ) -> Option<(SegmentProducts<N>, [Eight; N])> {
        let was_scaled = self.gather(steps, false, likelihoods)?;
        self.take_out(was_scaled);
        pack_segments(likelihoods, packed);
        let products = SegmentProducts::new(model, packed)?;
        let starts = products.forward(&mut self.x)?;
        Some((products, starts))
    }
}

/// Filters a sequence as [`Hmm::forward`] does: returns a row for each step from 0, and the
/// log-likelihoods of each step and of all.
pub(crate) fn filter<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Vec<f64>, Vec<f64>, f64)>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (states, steps) = (hmm.states(), sequence.steps());
    if !choice::is_long(steps) {
        return None; // short sequences have the beliefs of a stream to the bit
    }
    let model = FewStatesModel::new(hmm)?;
    let mut rows = in_large_pages(vec![0.0; states * (steps + 1)]);
    let mut logs = vec![0.0; steps];
    let mut source = SensorRows::new(hmm, sequence);
    let sum = model.filter(&mut source, steps, Some((&mut rows, &mut logs)))?;
    Some((rows, logs, sum))
}

/// Computes ln p(y_1 … y_T) as [`Hmm::log_likelihood`] does.
pub(crate) fn log_likelihood<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<f64>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let model = FewStatesModel::new(hmm)?;
    model.filter(&mut SensorRows::new(hmm, sequence), sequence.steps(), None)
}

/// Rows from step 0, and log-likelihoods from step 1.
type Out<'a> = (&'a mut [f64], &'a mut [f64]);

impl FewStatesModel {
    /// Filters a sequence, and returns its log-likelihood.
    fn filter(
        &self,
        source: &mut dyn LikelihoodRows,
        steps: usize,
        mut out: Option<Out<'_>>,
    ) -> Option<f64> {
        self.in_segments_or_steps(steps, |segments| {
            let out = out.as_mut().map(|(rows, logs)| (&mut **rows, &mut **logs));
            match self.states {
                3 => self.filter_in::<3>(source, steps, out, segments),
                4 => self.filter_in::<4>(source, steps, out, segments),
                _ => self.filter_in::<2>(source, steps, out, segments),
            }
        })
    }

    /// Filters in segments, for models of N states, or step by step.
    fn filter_in<const N: usize>(
        &self,
        source: &mut dyn LikelihoodRows,
        steps: usize,
        mut out: Option<Out<'_>>,
        segments: bool,
    ) -> Option<f64> {
        let n = self.states;
        let (mut forward, first) = Forward::start(self, source)?;
        if let Some((rows, logs)) = &mut out {
            rows[..n].copy_from_slice(&self.prior.values[..n]);
            // No transition leads to step 1: its belief is the prior times the likelihoods, which
            // `start` has multiplied already.
            if first > 1 {
                let sum: f64 = forward.x.values.iter().sum();
                rows[n..2 * n].iter_mut().zip(forward.x.values).for_each(|(row, x)| *row = x / sum);
                logs[0] = forward.log_likelihood();
            }
        }
        let mut remaining = first..steps + 1;
        let model = self.segment_model::<N>();
        let (mut packed, mut beliefs, mut normalizers) = (Vec::new(), Vec::new(), Vec::new());
        let mut likelihoods = Vec::new();
        // Two passes over eight segments. First the matrix product of each segment carries x to the
        // next start; then all eight run at once from their starts, without waiting for each other.
        while segments && let Some(steps) = choice::next_segments(&mut remaining) {
            likelihoods.resize(N * steps.len(), 0.0);
            let (_, starts) =
                forward.segments(&model, steps.clone(), &mut likelihoods, &mut packed)?;
            // For the log-likelihood alone, the products are sufficient.
            let Some((rows, logs)) = &mut out else { continue };
            beliefs.resize(packed.len(), [Packed::default(); N]);
            normalizers.resize(steps.len() / LANES, Packed::default());
            filter_segments(&model, &starts, &packed, &mut beliefs, &mut normalizers)?;
            unpack_segments(beliefs.as_flattened(), &mut rows[n * steps.start..n * steps.end]);
            // ln N_k, plus the logarithm of the scale taken out of the likelihoods of the step.
            let logs = &mut logs[steps.start - 1..steps.end - 1];
            unpack_segments(&normalizers, logs);
            logs.iter_mut().zip(&forward.scales).for_each(|(log, scale)| *log = log.ln() + scale);
        }
        // The rest (or all, without segments) goes through a chain.
        likelihoods.resize(n * GATHERED.min(remaining.len()), 0.0);
        while let Some(steps) = choice::next_steps(&mut remaining) {
            let (rows, logs): Out<'_> = match &mut out {
                Some((rows, logs)) => (
                    &mut rows[n * steps.start..n * steps.end],
                    &mut logs[steps.start - 1..steps.end - 1],
                ),
                None => (&mut [], &mut []),
            };
            let likelihoods = &mut likelihoods[..n * steps.len()];
            forward.chain(steps, likelihoods, rows, logs)?;
            logs.iter_mut().zip(&forward.scales).for_each(|(log, scale)| *log = log.ln() + scale);
        }
        Some(forward.log_likelihood())
    }
}

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
        // `before` is x before the first transition: that of X_0, or that of X_1 if no move leads
        // to X_1.
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

        // Nothing is observed after T, so r is one in all states, and the last posterior is the
        // filtered one. The chain comes last in the sequence, so it is the first on the way back.
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
        // The rows before the first transition: that of X_0, and also that of X_1 if no move leads
        // to X_1, since both are then the same state.
        let mut posterior = before;
        posterior.iter_mut().zip(r.values).for_each(|(x, r)| *x *= r);
        let sum: f64 = posterior.iter().sum();
        for row in rows.chunks_exact_mut(n).take(first) {
            row.iter_mut().zip(posterior).for_each(|(row, x)| *row = x / sum);
        }
        Some(log_likelihood)
    }
}
