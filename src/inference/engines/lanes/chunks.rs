//! Any number of sequences in lanes: chunks of consecutive sequences, each the work of one thread,
//! and groups of eight of nearly the same length within a chunk.
//!
//! Results are visited in the order of the sequences, and neither chunks nor groups depend on the
//! number of threads. Rows of a chunk share one block of memory.

use std::convert::Infallible;
use std::iter;
use std::ops::{ControlFlow, Deref, Range};
use std::sync::Arc;

use super::{Group, LaneMemory, LaneModel};
use crate::error::{InferenceError, SequenceError};
use crate::hmm::Hmm;
use crate::inference::engines::choice::{CHUNKS_AHEAD, ChunkSize, ManyPlan, STREAMED};
use crate::inference::engines::parallel::{self, MemoryPool};
use crate::likelihood::Likelihood;
use crate::sequence::{Sequence, by_length};
use crate::transition::Transition;
use wayfix_kernels::{self as kernels, Aligned, Eight, LANES};

/// A routine for one sequence that also runs on a group of eight, with results R.
pub(crate) struct LaneRoutine<A: Transition, B, S, P, R> {
    /// True if results have a row for each step from 0, which `group` leaves in the beliefs of its
    /// memory.
    pub(crate) has_rows: bool,
    /// Runs one sequence: handles any range of numbers, and reports any error.
    pub(crate) single: fn(&Hmm<A, B>, &S) -> Result<R, InferenceError>,
    /// Runs a group: returns the numbers of each lane, or `None` for a sequence that has to run by
    /// itself.
    pub(crate) group: GroupRoutine<A, B, S, P>,
    /// Makes the result of a sequence from the numbers of its lane and its rows.
    pub(crate) result: fn(P, SharedRows) -> R,
}

type GroupRoutine<A, B, S, P> =
    fn(&LaneModel<'_, A, B>, &Group<'_, S>, &mut LaneMemory) -> [Option<P>; LANES];

/// Rows of one sequence, in a block shared with others.
pub(crate) struct SharedRows {
    pub(crate) states: usize,
    block: Arc<Aligned>,
    range: Range<usize>,
}

impl Deref for SharedRows {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.block[self.range.clone()]
    }
}

/// Runs a routine on all sequences. The result at index i is that of sequence i.
pub(crate) fn collect_all<'s, A, B, S, P, R>(
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
    // All sequences are sorted together, so that nearly all groups have one length.
    let steps: Vec<usize> = sequences.iter().map(Sequence::steps).collect();
    let order = by_length(&steps);
    let mut results: Vec<_> = order.iter().map(|_| None).collect();
    let sorted = order.iter().map(|&sequence| &sequences[sequence]);
    let ControlFlow::Continue(()) = visit_all(hmm, sorted, true, routine, |position, result| {
        let sequence = order[position];
        results[sequence] = Some(result.map_err(|error| SequenceError { sequence, ..error }));
        ControlFlow::<Infallible>::Continue(())
    });
    results.into_iter().flatten().collect()
}

/// Runs a routine on all sequences, and visits the results in order, each with the index of its
/// sequence, until the visitor breaks. `sorted` says that the sequences are sorted by length, and
/// that all results are collected.
pub(crate) fn visit_all<A, B, S, P, R, Stop>(
    hmm: &Hmm<A, B>,
    sequences: impl Iterator<Item = S>,
    sorted: bool,
    routine: &LaneRoutine<A, B, S, P, R>,
    mut visit: impl FnMut(usize, Result<R, SequenceError>) -> ControlFlow<Stop>,
) -> ControlFlow<Stop>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Send + Sync,
    P: Send,
    R: Send,
{
    // An iterator of unknown length may be long.
    let most = sequences.size_hint().1.unwrap_or(usize::MAX);
    let mut plan = ManyPlan::new(hmm.states(), routine.has_rows, sorted);
    let model = plan.may_use_lanes(most).then(|| LaneModel::new(hmm)).flatten();
    plan.entries = model.as_ref().map(|model| model.rows.values().len());
    let (memories, blocks) = (MemoryPool::default(), MemoryPool::default());
    let work = |sequences: Vec<S>| match &model {
        Some(model) => in_groups(model, &sequences, routine, plan, &memories, blocks.pop()),
        // Without lanes the sequences of a chunk run one by one, and share nothing.
        None => Chunk {
            results: sequences.iter().map(|sequence| (routine.single)(hmm, sequence)).collect(),
            block: Arc::new(Aligned::new(0, 0.0)),
        },
    };
    let mut sequence = 0;
    let take = |Chunk { results, block }| {
        for result in results {
            visit(sequence, result.map_err(|source| SequenceError { sequence, source }))?;
            sequence += 1;
        }
        // The block is reused unless the visitor has kept a result.
        Arc::into_inner(block).into_iter().for_each(|block| blocks.push(block));
        ControlFlow::Continue(())
    };
    parallel::in_order(chunks(sequences, plan), CHUNKS_AHEAD, work, take)
}

/// Results of a chunk in the order of its sequences, with the memory that they share.
struct Chunk<R> {
    results: Vec<Result<R, InferenceError>>,
    block: Arc<Aligned>,
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
/// that have to run by themselves. `block` is memory to reuse.
fn in_groups<A, B, S, P, R>(
    model: &LaneModel<'_, A, B>,
    sequences: &[S],
    routine: &LaneRoutine<A, B, S, P, R>,
    plan: ManyPlan,
    memories: &MemoryPool<LaneMemory>,
    block: Option<Aligned>,
) -> Chunk<R>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Sync,
    P: Send,
    R: Send,
{
    // Sequences of similar length share a group, so that few lanes idle at its end.
    let order: Vec<usize> = if plan.sorted {
        (0..sequences.len()).collect()
    } else {
        by_length(&sequences.iter().map(Sequence::steps).collect::<Vec<_>>())
    };
    let ordered: Vec<_> = order.into_iter().map(|i| (i, &sequences[i])).collect();
    let in_lanes = |count, longest| plan.runs_in_lanes(count, longest);
    let groups: Vec<_> = ordered.chunks(LANES).map(|some| Group::new(some, in_lanes)).collect();

    // The rows of each lane begin on a cache line, so that whole vectors of eight can be written.
    let eights = |steps: usize| (plan.states * (steps + 1)).div_ceil(LANES);
    let eights_of = |group: &Group<'_, S>| -> usize {
        let lanes = if routine.has_rows && group.in_lanes { group.sequences.len() } else { 0 };
        group.steps[..lanes].iter().map(|steps| eights(*steps)).sum()
    };
    let numbers = groups.iter().map(eights_of).sum::<usize>() * LANES;
    let mut block = match block {
        // Values of an earlier chunk are not cleared: a lane either writes all of its rows, or they
        // belong to no result.
        Some(block) if block.len() >= numbers => block,
        _ => Aligned::new(numbers, 0.0),
    };
    // Split before the threads start, so that each group writes its own part.
    let mut free = block.as_chunks_mut().0;
    let mut items = Vec::with_capacity(groups.len());
    for group in groups.iter().filter(|group| group.in_lanes) {
        let (rows, others) = free.split_at_mut(eights_of(group));
        items.push((group, rows));
        free = others;
    }
    let lanes = parallel::map(items, |(group, rows), (): &mut ()| {
        let mut memory = memories.pop().unwrap_or_default();
        let lanes = (routine.group)(model, group, &mut memory);
        if routine.has_rows {
            let valid = lanes.each_ref().map(Option::is_some);
            unpack_rows(group, &memory, valid, rows, eights, numbers > STREAMED);
        }
        memories.push(memory);
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
    Chunk { results: results.into_iter().flatten().collect(), block }
}

/// Writes the rows of the valid lanes of a group, whose beliefs are interleaved in `memory`.
fn unpack_rows<S>(
    group: &Group<'_, S>,
    memory: &LaneMemory,
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
    kernels::unpack_rows(&memory.beliefs[..eights(group.longest) * LANES], rows, streamed);
}
