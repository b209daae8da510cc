//! Expectations of learning, in lanes: Σ γ and Σ ξ over the steps of eight sequences (section 9 of
//! the [formulas](crate::guide::formulas)).
//!
//! Σ_k ξ_k(j, i) = A\[i, j\] Σ_k α_{k−1}(j) γ_k(i) / p_k(i), so that A is multiplied in once, at
//! the end.

use super::segments::SegmentGroup;
use super::{Group, LaneModel, LaneScratch};
use crate::hmm::Hmm;
use crate::inference::engines::choice;
use crate::inference::engines::parallel::{self, ScratchPool};
use crate::likelihood::LearnLikelihood;
use crate::sequence::Sequence;
use crate::transition::{LearnTransition, MoveCounts, constant_control};
use wayfix_kernels::limits::BACK_LIFT;
use wayfix_kernels::{self as kernels, LANES, Packed};

/// Sum of the expectations of the sequences in a group's valid lanes.
pub(crate) struct LaneExpectations<T> {
    /// Σ p(X_0 | y_1 … y_T).
    pub(crate) first: Vec<f64>,
    /// Expected moves, if they are counted.
    pub(crate) moves: Option<MoveCounts>,
    /// Statistics of the sensor.
    pub(crate) sensor: T,
    /// ln p(y_1 … y_T) of each valid lane; the sums do not include the sequences of the others.
    pub(crate) log_likelihoods: [Option<f64>; LANES],
}

impl<A: LearnTransition, B: LearnLikelihood> LaneModel<'_, A, B> {
    /// Returns the expectations of the sequences of a group.
    pub(crate) fn expectations<S>(
        &self,
        group: &Group<'_, S>,
        scratch: &mut LaneScratch,
    ) -> LaneExpectations<B::Statistics>
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let n = self.states();
        let mut forward = self.forward(group, scratch, true, |_, _| ());
        // Counts without A, which is the same at all steps and is multiplied in at the end.
        let mut counts = vec![Packed::default(); self.counted_entries()];
        let counted = (!counts.is_empty()).then_some(&mut counts[..]);
        self.backward(group, scratch, &mut forward.valid, counted);
        let log_likelihoods = forward.log_likelihoods();
        let valid = forward.valid;
        let mut first = vec![0.0; n];
        for l in (0..LANES).filter(|l| valid[*l]) {
            // The first n beliefs are those of step 0.
            first.iter_mut().zip(&scratch.beliefs).for_each(|(sum, gamma)| *sum += gamma[l]);
        }
        // The sensor's statistics take a second pass over the steps: a lane may become invalid at
        // any step of the backward pass, and then nothing of it may have been added.
        let mut sensor = self.hmm.likelihood().statistics();
        let steps = std::array::from_fn(|l| if valid[l] { group.steps[l] } else { 0 });
        self.add_statistics(&mut sensor, scratch, steps, |l, step| {
            group.sequences[l].1.observation(step)
        });
        let moves = self.moves(&counts, valid);
        LaneExpectations { first, moves, sensor, log_likelihoods }
    }

    /// Number of entries of the columns whose moves are counted.
    fn counted_entries(&self) -> usize {
        let transition = self.hmm.transition();
        let mut statistics = transition.statistics();
        let control = constant_control::<A>();
        let counted = control.and_then(|u| transition.counts(&mut statistics, u)).is_some();
        if counted { self.columns.values().len() } else { 0 }
    }

    /// Returns the moves of the valid lanes, if they are counted.
    fn moves(&self, counts: &[Packed], valid: [bool; LANES]) -> Option<MoveCounts> {
        // α(j) γ(i) / p(i), summed over the steps; A is multiplied in at the end.
        let sum = |at: usize| -> f64 {
            counts[at].iter().zip(valid).filter(|c| c.1).map(|c| c.0 / BACK_LIFT).sum()
        };
        let counted = !counts.is_empty();
        counted.then(|| MoveCounts::of_entries(self.columns, self.states(), |at, p| p * sum(at)))
    }

    /// Adds observations with their smoothed beliefs to the statistics of the sensor, for the first
    /// `steps` steps of each lane.
    fn add_statistics<'y>(
        &self,
        sensor: &mut B::Statistics,
        scratch: &LaneScratch,
        steps: [usize; LANES],
        observation: impl Fn(usize, usize) -> &'y B::Observation,
    ) where
        B::Observation: 'y,
    {
        let n = self.states();
        let mut rows = vec![0.0; n * LANES];
        for step in 1..=steps.into_iter().max().unwrap_or(0) {
            let mut row = rows.chunks_exact_mut(n);
            let out = std::array::from_fn(|_| row.next().unwrap_or_default());
            kernels::unpack(&scratch.beliefs[step * n..][..n], out);
            for (l, row) in rows.chunks_exact(n).enumerate().filter(|(l, _)| step <= steps[*l]) {
                self.hmm.likelihood().add(sensor, observation(l, step), row);
            }
        }
    }

    /// Passes the expectations of a long sequence, cut into segments, to `take`, group by group.
    /// Returns `None` if the sequence has to run by itself; those passed are then meaningless.
    pub(crate) fn expectations_in_segments<S>(
        &self,
        sequence: &S,
        mut take: impl FnMut(LaneExpectations<B::Statistics>),
    ) -> Option<()>
    where
        Hmm<A, B>: Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        let (n, scratches) = (self.states(), ScratchPool::<LaneScratch>::default());
        let mut scratch = LaneScratch::default();
        let longest = choice::longest_segments_to_learn(n);
        let segments = &self.segments(sequence, longest, &mut scratch)?;
        scratches.push(scratch);
        let finish =
            |group: &SegmentGroup, scratch: &LaneScratch, counts: &[Packed], number: usize| {
                let mut sensor = self.hmm.likelihood().statistics();
                let mut first = vec![0.0; n];
                if number == 0 {
                    // The first n beliefs are those of step 0, or of step 1 if no move leads to it.
                    first.iter_mut().zip(&scratch.beliefs).for_each(|(p, gamma)| *p = gamma[0]);
                    if segments.first == 1 {
                        self.hmm.likelihood().add(&mut sensor, sequence.observation(1), &first);
                    }
                }
                let bounds = segments.bounds(number);
                self.add_statistics(&mut sensor, scratch, group.lengths, |l, step| {
                    sequence.observation(bounds[l] + step)
                });
                let moves = self.moves(counts, [true; LANES]);
                LaneExpectations { first, moves, sensor, log_likelihoods: group.logs.map(Some) }
            };
        let run = |tasks| {
            parallel::map(tasks, |task, (): &mut ()| {
                let mut scratch = scratches.pop().unwrap_or_default();
                let entries = self.counted_entries();
                let done = self.run_task(segments, task, entries, &mut scratch, |g, m, c, task| {
                    finish(g, m, c, task.group)
                });
                scratches.push(scratch);
                done
            })
        };
        segments.visit(std::iter::repeat_n((), segments.groups), run, &mut take)
    }
}
