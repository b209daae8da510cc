//! Smoother of one long sequence, in segments ([`segments`](super::segments)). Every step of the
//! sequence belongs to exactly one segment, whose group writes its row; rows of warm-ups are
//! dropped.

use super::segments::SegmentGroup;
use super::verified::Task;
use super::{LaneModel, LaneScratch};
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::engines::choice;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::{self as kernels, LANES, Packed, in_large_pages};

/// Smooths a sequence as [`Hmm::smooth`] does: returns a row for each step from 0, and the
/// log-likelihood; `None` if the sequence does not suit segments.
pub(crate) fn smooth<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<(Vec<f64>, f64)>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let model = LaneModel::new(hmm)?;
    let longest = choice::longest_segments_to_smooth(model.states(), model.rows.values().len());
    let scratch = &mut LaneScratch::default();
    let segments = &model.segments(sequence, longest, scratch)?;

    let (n, head) = (model.states(), segments.first + 1);
    let mut rows = in_large_pages(vec![0.0; n * (sequence.steps() + 1)]);
    // Each group has a place in the rows. That of the first group includes the steps before it.
    let mut free = &mut rows[..];
    let mut start = 0;
    let places = (0..segments.groups).map(|group| {
        let end = segments.bounds(group)[LANES] + 1;
        let (place, others) = std::mem::take(&mut free).split_at_mut(n * (end - start));
        (free, start) = (others, end);
        place
    });
    let places: Vec<&mut [f64]> = places.collect();
    let finish =
        |found: &SegmentGroup, scratch: &LaneScratch, _: &[Packed], task: &mut Task<&mut [f64]>| {
            let before = if task.group == 0 { n * head } else { 0 };
            let (first, others) = task.place.split_at_mut(before);
            for row in first.chunks_exact_mut(n) {
                // X_0, and also X_1 if no move leads to it.
                row.iter_mut().zip(&scratch.beliefs).for_each(|(p, gamma)| *p = gamma[0]);
            }
            write_rows(scratch, found.lengths, n, others);
            found.logs
        };
    let mut log_likelihood = LogSum::default();
    // On one thread, so that neither model nor sequence needs to be `Sync`.
    let mut run_one = |task| model.run_task(segments, task, 0, scratch, finish);
    let run = |tasks: Vec<_>| tasks.into_iter().map(&mut run_one).collect();
    segments.visit(places, run, |logs: [f64; LANES]| {
        logs.into_iter().for_each(|log| log_likelihood.add(log));
    })?;
    Some((rows, log_likelihood.value()))
}

/// Writes the smoothed beliefs of eight consecutive segments of these lengths.
fn write_rows(scratch: &LaneScratch, lengths: [usize; LANES], n: usize, mut free: &mut [f64]) {
    let mut segments = lengths.map(|length| {
        let (own, others) = std::mem::take(&mut free).split_at_mut(n * length);
        free = others;
        own.chunks_exact_mut(n)
    });
    let mut spare = vec![0.0; n * LANES];
    for step in 1..=lengths.into_iter().max().unwrap_or(0) {
        let mut spare = spare.chunks_exact_mut(n);
        // Lengths differ by one: a shorter segment writes its extra row, of the warm-up, to
        // `spare`.
        let out = std::array::from_fn(|l| {
            let spare = spare.next().unwrap_or_default();
            segments[l].next().unwrap_or(spare)
        });
        kernels::unpack(&scratch.beliefs[step * n..][..n], out);
    }
}
