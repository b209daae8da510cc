//! The filter over a whole sequence: x_k = b_k ∘ A x_{k−1} without normalisation ("Few states" in
//! section 3 of the [formulas](crate::guide::formulas)), for beliefs and log-likelihoods, or for
//! the total alone.

use super::FewStatesModel;
use super::forward::Forward;
use super::likelihoods::{LikelihoodRows, SensorRows};
use super::segments::unpack_segments;
use crate::hmm::Hmm;
use crate::inference::engines::choice::{self, GATHERED};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::{LANES, Packed, filter_segments, in_large_pages};

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
        // next start; then all eight run at once from their starts, none waiting for the one
        // before.
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
