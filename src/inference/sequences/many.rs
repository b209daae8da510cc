//! Routines for many sequences, in lanes where the model allows it, and in parallel with the
//! feature `rayon`.
//!
//! Each pairs the routine for one sequence with its counterpart for eight in lanes, and falls back
//! to the former for any lane that leaves the range of doubles. Chunks of consecutive sequences are
//! the work of one thread; within a chunk, groups of eight have nearly the same length.
//!
//! Results are visited in the order of the sequences, and neither chunks nor groups depend on the
//! number of threads. Rows of a chunk share one block of scratch.

use std::convert::Infallible;
use std::iter;
use std::ops::ControlFlow;
use std::sync::Arc;

use super::forward_backward::{FilteredSequence, Posteriors, SharedRows, SmoothedSequence};
use crate::error::{HmmError, SequenceError};
use crate::hmm::Hmm;
use crate::inference::decoding::viterbi::ViterbiPath;
use crate::inference::engines::choice::{CHUNKS_AHEAD, ChunkSize, ManyPlan, STREAMED};
use crate::inference::engines::lanes::{Group, LaneModel, LaneScratch};
use crate::inference::engines::parallel;
use crate::inference::engines::parallel::ScratchPool;
use crate::likelihood::Likelihood;
use crate::sequence::{Sequence, by_length};
use crate::transition::{Transition, TransitionEntries};
use wayfix_kernels as kernels;
use wayfix_kernels::{Aligned, Eight, LANES};

/// # Many sequences
///
/// Each method for one sequence has a counterpart for a slice of them, of any lengths. Results
/// equal those for one sequence up to rounding (paths and errors exactly). With the feature
/// `rayon`, sequences run in parallel, with the same results to the bit.
///
/// With a [`SparseTransition`](crate::SparseTransition) or a
/// [`DenseTransition`](crate::DenseTransition) of more than eight states, groups of eight
/// sequences of nearly the same length run side by side, one in each lane of a vector, wherever
/// that makes a step faster: most with dense matrices, not with large sparse ones. A group takes
/// 128 n T bytes in addition to its results. Groups are found among all sequences of a slice.
///
/// More sequences than fit in memory are passed in slices of some thousands. Posteriors of a
/// slice share blocks of up to 32 MB: a result that is kept keeps its whole block alive; a clone
/// has memory of its own.
///
/// **A sequence that fails** does not affect the others. Its [`SequenceError`] names it, so that
/// results can also be collected into a single `Result`.
///
/// ```
/// # let hmm = wayfix::canberra::hmm(5, 1.0)?;
/// let drives = [vec![4, 5, 6], vec![4, 4, 5, 5], vec![80]];
/// let smoothed = hmm.smooth_all(&drives);
/// assert_eq!(smoothed[1].as_ref().unwrap().posteriors().steps(), 4);
/// let scores: Result<Vec<f64>, _> = hmm.log_likelihood_all(&drives[..2]).into_iter().collect();
/// # assert_eq!(scores?.len(), 2);
///
/// // Any number of drives, as they are read, with a word on progress.
/// let mut source = (0..3_000).map(|k| vec![4; 1 + k % 3]);
/// let mut steps = 0;
/// loop {
///     let drives: Vec<_> = source.by_ref().take(1_000).collect();
///     if drives.is_empty() {
///         break;
///     }
///     for smoothed in hmm.smooth_all(&drives) {
///         match smoothed {
///             Ok(smoothed) => steps += smoothed.posteriors().steps(),
///             Err(error) => eprintln!("{error}"),
///         }
///     }
///     println!("{steps} steps");
/// }
/// assert_eq!(steps, 6_000);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
impl<A: Transition + Sync, B: Likelihood + Sync> Hmm<A, B> {
    /// Runs [`forward`](Self::forward) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn forward_all<S>(&self, sequences: &[S]) -> Vec<Result<FilteredSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        collect_all(self, sequences, &forward())
    }

    /// Runs [`smooth`](Self::smooth) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn smooth_all<S>(&self, sequences: &[S]) -> Vec<Result<SmoothedSequence, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        collect_all(self, sequences, &smooth())
    }

    /// Runs [`log_likelihood`](Self::log_likelihood) on each sequence. The result at index i is
    /// that of sequence i.
    pub fn log_likelihood_all<S>(&self, sequences: &[S]) -> Vec<Result<f64, SequenceError>>
    where
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        collect_all(self, sequences, &log_likelihood())
    }

    /// Runs [`viterbi`](Self::viterbi) on each sequence. The result at index i is that of
    /// sequence i.
    pub fn viterbi_all<S>(&self, sequences: &[S]) -> Vec<Result<ViterbiPath, SequenceError>>
    where
        A: TransitionEntries,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        collect_all(self, sequences, &viterbi())
    }
}

/// [`Hmm::forward`] in lanes: log-likelihoods of each step and of all steps, and the rows.
fn forward<A: Transition, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, (Vec<f64>, f64), FilteredSequence> {
    LaneRoutine {
        has_rows: true,
        single: Hmm::forward,
        group: |model, group, scratch| {
            // Logarithms of an invalid lane are dropped with it: its sum is `None`.
            let mut logs: [Vec<f64>; LANES] = group.steps.map(Vec::with_capacity);
            let forward = model.forward(group, scratch, true, |lane, log| logs[lane].push(log));
            let mut sums = forward.log_likelihoods().into_iter();
            logs.map(|logs| sums.next().flatten().map(|sum| (logs, sum)))
        },
        result: |(logs, log), rows| FilteredSequence::new(Posteriors::from_shared(rows), logs, log),
    }
}

/// [`Hmm::smooth`] in lanes: log-likelihoods, and the rows.
fn smooth<A: Transition, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, f64, SmoothedSequence> {
    LaneRoutine {
        has_rows: true,
        single: Hmm::smooth,
        group: |model, group, scratch| {
            // The log-likelihoods are read after the backward pass, which may find further lanes
            // out of range and clear them in `valid`.
            let mut forward = model.forward(group, scratch, true, |_, _| ());
            model.backward(group, scratch, &mut forward.valid, None);
            forward.log_likelihoods()
        },
        result: |log, rows| SmoothedSequence::new(Posteriors::from_shared(rows), log),
    }
}

/// [`Hmm::log_likelihood`] in lanes, which stores nothing for each step.
fn log_likelihood<A: Transition, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, f64, f64> {
    LaneRoutine {
        has_rows: false,
        single: Hmm::log_likelihood,
        group: |model, group, scratch| {
            model.forward(group, scratch, false, |_, _| ()).log_likelihoods()
        },
        result: |log, _| log,
    }
}

/// [`Hmm::viterbi`] in lanes: paths and their log-probabilities.
fn viterbi<A: TransitionEntries, B: Likelihood, S: Sequence<A::Control, B::Observation>>()
-> LaneRoutine<A, B, S, (Vec<usize>, f64), ViterbiPath> {
    LaneRoutine {
        has_rows: false,
        single: Hmm::viterbi,
        group: |model, group, scratch| model.viterbi(group, scratch),
        result: |(states, log_probability), _| ViterbiPath { states, log_probability },
    }
}

/// A routine for one sequence that also runs on a group of eight, with results R.
struct LaneRoutine<A: Transition, B, S, P, R> {
    /// True if results have a row for each step from 0, which `group` leaves in the beliefs of its
    /// scratch.
    has_rows: bool,
    /// Runs one sequence: handles any range of numbers, and reports any error.
    single: fn(&Hmm<A, B>, &S) -> Result<R, HmmError>,
    /// Runs a group: returns the numbers of each lane, or `None` for a sequence that has to run by
    /// itself.
    group: GroupRoutine<A, B, S, P>,
    /// Makes the result of a sequence from the numbers of its lane and its rows.
    result: fn(P, SharedRows) -> R,
}

type GroupRoutine<A, B, S, P> =
    fn(&LaneModel<'_, A, B>, &Group<'_, S>, &mut LaneScratch) -> [Option<P>; LANES];

/// Runs a routine on all sequences. The result at index i is that of sequence i.
fn collect_all<'s, A, B, S, P, R>(
    hmm: &Hmm<A, B>,
    sequences: &'s [S],
    routine: &LaneRoutine<A, B, &'s S, P, R>,
) -> Vec<Result<R, SequenceError>>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Sync,
    P: Send,
    R: Send,
{
    // All sequences are sorted together, so nearly all groups have sequences of one length.
    let steps: Vec<usize> = sequences.iter().map(Sequence::steps).collect();
    let order = by_length(&steps);
    let mut plan = ManyPlan::new(hmm.states(), routine.has_rows);
    let model = plan.may_use_lanes(sequences.len()).then(|| LaneModel::new(hmm)).flatten();
    plan.entries = model.as_ref().map(|model| model.rows.values().len());
    let scratches = ScratchPool::default();
    let run = |sequences: Vec<&'s S>| match &model {
        Some(model) => in_groups(model, &sequences, routine, plan, &scratches),
        // Without lanes the sequences of a chunk run one by one, and share nothing.
        None => sequences.iter().map(|sequence| (routine.single)(hmm, sequence)).collect(),
    };
    let mut results: Vec<_> = order.iter().map(|_| None).collect();
    let mut taken = order.iter();
    let take = |chunk: Vec<Result<R, HmmError>>| {
        // The chunk comes first in `zip`, which would otherwise take a sequence of the next chunk
        // before it finds the end of this one.
        for (result, &sequence) in chunk.into_iter().zip(taken.by_ref()) {
            results[sequence] = Some(result.map_err(|source| SequenceError { sequence, source }));
        }
        ControlFlow::<Infallible>::Continue(())
    };
    let sorted = order.iter().map(|&sequence| &sequences[sequence]);
    let ControlFlow::Continue(()) =
        parallel::in_order(chunks(sorted, plan), CHUNKS_AHEAD, run, take);
    results.into_iter().flatten().collect()
}

/// Takes sequences off an iterator, a chunk at a time.
fn chunks<S: Sequence<U, Y>, U, Y: ?Sized>(
    sequences: impl Iterator<Item = S>,
    plan: ManyPlan,
) -> impl Iterator<Item = Vec<S>> {
    let mut sequences = sequences.fuse();
    iter::from_fn(move || {
        let (mut chunk, mut size) = (Vec::new(), ChunkSize::default());
        // Asked before a sequence is taken, so that none is left over for the next chunk.
        while !plan.is_full(size)
            && let Some(sequence) = sequences.next()
        {
            size.add(sequence.steps());
            chunk.push(sequence);
        }
        (!chunk.is_empty()).then_some(chunk)
    })
}

/// Runs a routine on a chunk, in groups of nearly the same length, and one by one on the sequences
/// that have to run by themselves.
fn in_groups<A, B, S, P, R>(
    model: &LaneModel<'_, A, B>,
    sequences: &[S],
    routine: &LaneRoutine<A, B, S, P, R>,
    plan: ManyPlan,
    scratches: &ScratchPool<LaneScratch>,
) -> Vec<Result<R, HmmError>>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Sync,
    P: Send,
    R: Send,
{
    // Sorted by length, so that few lanes idle at the end of a group.
    let ordered: Vec<_> = sequences.iter().enumerate().collect();
    let in_lanes = |count, longest| plan.runs_in_lanes(count, longest);
    let groups: Vec<_> = ordered.chunks(LANES).map(|some| Group::new(some, in_lanes)).collect();

    // The rows of each lane begin on a cache line, so that whole vectors of eight can be written.
    let eights = |steps: usize| (plan.states * (steps + 1)).div_ceil(LANES);
    let eights_of = |group: &Group<'_, S>| -> usize {
        let lanes = if routine.has_rows && group.in_lanes { group.sequences.len() } else { 0 };
        group.steps[..lanes].iter().map(|steps| eights(*steps)).sum()
    };
    let numbers = groups.iter().map(eights_of).sum::<usize>() * LANES;
    let mut block = Aligned::new(numbers, 0.0);
    // Split before the threads start, so that each group writes its own part.
    let mut free = block.as_chunks_mut().0;
    let mut items = Vec::with_capacity(groups.len());
    for group in groups.iter().filter(|group| group.in_lanes) {
        let (rows, others) = free.split_at_mut(eights_of(group));
        items.push((group, rows));
        free = others;
    }
    let lanes = parallel::map(items, |(group, rows), (): &mut ()| {
        let mut scratch = scratches.pop().unwrap_or_default();
        let lanes = (routine.group)(model, group, &mut scratch);
        if routine.has_rows {
            let valid = lanes.each_ref().map(Option::is_some);
            unpack_rows(group, &scratch, valid, rows, eights, numbers > STREAMED);
        }
        scratches.push(scratch);
        lanes
    });

    let block = Arc::new(block);
    let mut results: Vec<_> = sequences.iter().map(|_| None).collect();
    let mut start = 0;
    for (group, lanes) in groups.iter().filter(|group| group.in_lanes).zip(lanes) {
        for ((&(sequence, _), lane), steps) in group.sequences.iter().zip(lanes).zip(group.steps) {
            let (rows, next) =
                if routine.has_rows { (steps + 1, eights(steps) * LANES) } else { (0, 0) };
            let range = start..start + plan.states * rows;
            start += next;
            // The rows of an invalid lane stay unused.
            let rows = SharedRows { states: plan.states, block: block.clone(), range };
            results[sequence] = lane.map(|numbers| Ok((routine.result)(numbers, rows)));
        }
    }
    // Sequences that did not run in a lane, or whose lane became invalid. Each is an item of its
    // own, since one in logarithms takes many times as long.
    let remaining = (0..sequences.len()).filter(|sequence| results[*sequence].is_none()).collect();
    let single = |i: usize, (): &mut ()| (i, (routine.single)(model.hmm, &sequences[i]));
    for (sequence, result) in parallel::map(remaining, single) {
        results[sequence] = Some(result);
    }
    results.into_iter().flatten().collect()
}

/// Writes the rows of the valid lanes of a group, whose beliefs are interleaved in `scratch`.
fn unpack_rows<S>(
    group: &Group<'_, S>,
    scratch: &LaneScratch,
    valid: [bool; LANES],
    mut free: &mut [Eight],
    eights: impl Fn(usize) -> usize,
    streamed: bool,
) {
    let mut rows: [&mut [Eight]; LANES] = std::array::from_fn(|_| &mut [][..]);
    for (l, row) in rows.iter_mut().enumerate().take(group.sequences.len()) {
        // Every lane has its part, valid or not, so that the ranges of results are known in
        // advance.
        let (own, others) = free.split_at_mut(eights(group.steps[l]));
        free = others;
        if valid[l] {
            *row = own;
        }
    }
    kernels::unpack_rows(&scratch.beliefs[..eights(group.longest) * LANES], rows, streamed);
}
