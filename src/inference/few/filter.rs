//! The filter over a whole sequence: beliefs and log-likelihoods, or the total alone.

use super::likelihoods::{LikelihoodRows, Sensed};
use super::segments::{SegmentProducts, pack_segments, unpack_segments};
use super::{FewModel, control_of, log_of};
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::filtering::FilteredSequence;
use crate::inference::plan::{self, Engine};
use crate::inference::posteriors::Posteriors;
use crate::kernels::{ChainState, LANES, Packed, chain_forward, filter_segments, in_large_pages};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Steps of a chain that are gathered at a time: they stay in the first cache.
const GATHERED: usize = 128;

/// [`Hmm::forward`].
pub(in super::super) fn filter<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<FilteredSequence>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let (states, steps) = (hmm.states(), sequence.steps());
    if !plan::is_long(steps) {
        return None; // the beliefs of a stream, to the bit
    }
    let control = control_of(hmm, steps)?;
    let model = FewModel::new(hmm, control)?;
    let mut rows = in_large_pages(vec![0.0; states * (steps + 1)]);
    let mut logs = vec![0.0; steps];
    let mut source = Sensed::new(hmm, sequence);
    let sum = model.filter(&mut source, steps, Some((&mut rows, &mut logs)))?;
    let posteriors = Posteriors::from_values(states, rows);
    Some(FilteredSequence::new(posteriors, logs, sum))
}

/// [`Hmm::log_likelihood`].
pub(in super::super) fn log_likelihood<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<f64>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let control = control_of(hmm, sequence.steps())?;
    let model = FewModel::new(hmm, control)?;
    model.filter(&mut Sensed::new(hmm, sequence), sequence.steps(), None)
}

/// Rows from step 0, and log-likelihoods from step 1.
type Out<'a> = (&'a mut [f64], &'a mut [f64]);

impl FewModel {
    /// Filters a sequence, and returns its log-likelihood.
    fn filter(
        &self,
        source: &mut dyn LikelihoodRows,
        steps: usize,
        mut out: Option<Out<'_>>,
    ) -> Option<f64> {
        if let Some((rows, _)) = &mut out {
            rows[..self.states].copy_from_slice(&self.prior.values[..self.states]);
        }
        let mut attempt = |segments: bool| -> Option<f64> {
            let (mut x, mut logs) = (self.prior, LogSum::default());
            let mut out = out.as_mut().map(|out| (&mut *out.0, &mut *out.1));
            let mut done = self.start(source, &mut x, &mut logs)?;
            if let (Some((rows, log_likelihoods)), 1) = (&mut out, done) {
                let sum: f64 = x.values.iter().sum();
                let row = rows[self.states..].iter_mut().zip(x.values);
                row.take(self.states).for_each(|(row, x)| *row = x / sum);
                log_likelihoods[0] = log_of(&x, &logs);
            }
            if segments {
                let out = out.as_mut().map(|out| (&mut *out.0, &mut *out.1));
                done = match self.states {
                    2 => self.filter_segments::<2>(source, &mut x, done..steps, out, &mut logs),
                    3 => self.filter_segments::<3>(source, &mut x, done..steps, out, &mut logs),
                    _ => self.filter_segments::<4>(source, &mut x, done..steps, out, &mut logs),
                }?;
            }
            self.filter_chain(source, &mut x, done..steps, out, &mut logs)?;
            Some(log_of(&x, &logs))
        };
        let first = (plan::for_sequence(self.states, steps) == Engine::Segments)
            .then(|| attempt(true))
            .flatten();
        first.or_else(|| attempt(false))
    }

    /// Filters step by step.
    fn filter_chain(
        &self,
        source: &mut dyn LikelihoodRows,
        x: &mut ChainState,
        mut left: std::ops::Range<usize>,
        mut out: Option<Out<'_>>,
        logs: &mut LogSum,
    ) -> Option<()> {
        let n = self.states;
        let mut likelihoods = vec![0.0; n * GATHERED.min(left.len())];
        while !left.is_empty() {
            let steps = left.start..left.end.min(left.start + GATHERED);
            left.start = steps.end;
            let mut scales = [0.0; GATHERED];
            let (likelihoods, scales) =
                (&mut likelihoods[..n * steps.len()], &mut scales[..steps.len()]);
            let (rows, normalizers): Out<'_> = match &mut out {
                Some((rows, logs)) => {
                    let rows = &mut rows[n * (steps.start + 1)..n * (steps.end + 1)];
                    (rows, &mut logs[steps.clone()])
                }
                None => (&mut [], &mut []),
            };
            let before = *x;
            let mut attempt = |scaled: bool| {
                *x = before;
                let numbers = steps.start + 1..steps.end + 1;
                let any = source.likelihoods(numbers, scaled, likelihoods, scales)?;
                chain_forward(&self.columns, x, n, likelihoods, rows, normalizers).then_some(any)
            };
            // Scales take time, and are seldom needed.
            if attempt(false).or_else(|| attempt(true))? {
                scales.iter().for_each(|log| logs.add(*log));
            } else {
                scales.fill(0.0);
            }
            normalizers.iter_mut().zip(scales).for_each(|(log, scale)| *log = log.ln() + *scale);
        }
        Some(())
    }

    /// Filters eight segments at a time, as long as there are enough steps. Returns how many are
    /// done.
    fn filter_segments<const N: usize>(
        &self,
        source: &mut dyn LikelihoodRows,
        x: &mut ChainState,
        mut left: std::ops::Range<usize>,
        mut out: Option<Out<'_>>,
        logs: &mut LogSum,
    ) -> Option<usize> {
        let few = self.few::<N>();
        let (mut packed, mut beliefs, mut normalizers) = (Vec::new(), Vec::new(), Vec::new());
        let (mut gathered, mut scales) = (Vec::new(), Vec::new());
        while let Some(length) = plan::segment_length(left.len()) {
            let steps = left.start..left.start + LANES * length;
            left.start = steps.end;
            gathered.resize(N * steps.len(), 0.0);
            scales.resize(steps.len(), 0.0);
            let numbers = steps.start + 1..steps.end + 1;
            if source.likelihoods(numbers, false, &mut gathered, &mut scales)? {
                scales.iter().for_each(|log| logs.add(*log));
            } else {
                scales.fill(0.0);
            }
            pack_segments(&gathered, &mut packed);
            let starts = SegmentProducts::<N>::new(&few, &packed)?.forward(x)?;
            let Some((rows, logs)) = &mut out else { continue };
            beliefs.resize(length, [Packed::default(); N]);
            normalizers.resize(length, Packed::default());
            filter_segments(&few, &starts, &packed, &mut beliefs, &mut normalizers)?;
            unpack_segments(
                beliefs.as_flattened(),
                &mut rows[N * (steps.start + 1)..N * (steps.end + 1)],
            );
            let logs = &mut logs[steps];
            unpack_segments(&normalizers, logs);
            logs.iter_mut().zip(&scales).for_each(|(log, scale)| *log = log.ln() + scale);
        }
        Some(left.start)
    }
}
