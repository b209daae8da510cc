//! Sequences in chunks, groups of eight in a chunk, and the memory that results of a chunk share.

use std::iter;
use std::ops::ControlFlow;
use std::sync::Arc;

use super::{BatchMemory, BatchModel, Group, Outcome};
use crate::error::{InferenceError, SequenceError};
use crate::hmm::Hmm;
use crate::inference::engines::choice::{
    self, CHUNKS_AHEAD, ChunkSize, Engine, GroupSize, STREAMED,
};
use crate::inference::engines::parallel::{self, MemoryPool};
use crate::inference::sequences::posteriors::Part;
use crate::kernels::{self, Aligned, Eight, LANES, Packed};
use crate::likelihood::Likelihood;
use crate::sequence::{Sequence, by_length};
use crate::transition::Transition;

/// Room for results that a routine needs, beside what it returns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Room {
    Nothing,
    /// A row for each step from 0.
    Rows,
}

/// Room for the rows of a group: those of each lane begin on a cache line.
pub(crate) struct GroupRows<'a> {
    states: usize,
    eights: &'a mut [Eight],
    streamed: bool,
}

/// Number of eights for a sequence of so many steps.
fn eights(states: usize, steps: usize) -> usize {
    (states * (steps + 1)).div_ceil(LANES)
}

impl GroupRows<'_> {
    /// Writes the rows of lanes that are held, which `all` has side by side.
    pub(crate) fn fill<S>(self, group: &Group<'_, S>, all: &[Packed], held: [bool; LANES]) {
        let mut left = self.eights;
        let mut rows: [&mut [Eight]; LANES] = std::array::from_fn(|_| &mut [][..]);
        for (l, row) in rows.iter_mut().enumerate().take(group.sequences.len()) {
            let (own, others) = left.split_at_mut(eights(self.states, group.steps[l]));
            left = others;
            if held[l] {
                *row = own;
            }
        }
        let all = &all[..eights(self.states, group.longest) * LANES];
        kernels::unpack_rows(all, rows, self.streamed);
    }
}

/// A routine for many sequences.
///
/// `together` gets room for the rows of a group; `finish` puts what it returns together with those
/// of its lane; `single` is the routine for a sequence by itself.
pub(crate) struct Routine<Together, Finish, Single> {
    pub(crate) room: Room,
    /// True if the results of all sequences are kept.
    pub(crate) kept: bool,
    pub(crate) together: Together,
    pub(crate) finish: Finish,
    pub(crate) single: Single,
}

/// Applies a routine to all sequences, in groups where the model allows it, else, and where a
/// group fails, one by one; and visits the results in order.
///
/// Chunks of consecutive sequences are the work of one thread, and of others that have nothing to
/// do. Neither they nor the groups in them depend on how many threads there are.
pub(crate) fn each<A, B, S, P, R, Stop>(
    hmm: &Hmm<A, B>,
    sequences: impl Iterator<Item = S>,
    routine: &Routine<
        impl Fn(&BatchModel<'_, A, B>, &Group<'_, S>, &mut BatchMemory, GroupRows<'_>) -> Outcome<P>
        + Sync,
        impl Fn(P, Part) -> R + Sync,
        impl Fn(&S) -> Result<R, InferenceError> + Sync,
    >,
    mut visit: impl FnMut(usize, Result<R, SequenceError>) -> ControlFlow<Stop>,
) -> ControlFlow<Stop>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Send + Sync,
    P: Send,
    R: Send,
{
    let (states, most) = (hmm.states(), sequences.size_hint().1.unwrap_or(usize::MAX));
    let lanes = choice::for_sequences(most, states) == Engine::Lanes;
    let model = lanes.then(|| BatchModel::new(hmm)).flatten();
    let (memories, blocks) = (MemoryPool::default(), MemoryPool::default());
    let size = model.as_ref().map(|model| model.group_size(routine.room));
    let work = |sequences: Vec<S>| match &model {
        Some(model) => in_groups(model, &sequences, routine, &memories, blocks.pop()),
        None => Done {
            results: sequences.iter().map(&routine.single).collect(),
            block: Arc::new(Aligned::new(0, 0.0)),
        },
    };
    let is_full = |chunk: ChunkSize| chunk.is_full(size.as_ref(), states, routine.kept);
    let mut sequence = 0;
    let take = |Done { results, block }| {
        for result in results {
            visit(sequence, result.map_err(|source| SequenceError { sequence, source }))?;
            sequence += 1;
        }
        // Unless the visitor has kept a result.
        Arc::into_inner(block).into_iter().for_each(|block| blocks.push(block));
        ControlFlow::Continue(())
    };
    parallel::in_order(chunks(sequences, is_full), CHUNKS_AHEAD, work, take)
}

/// Results of a chunk, and the memory that they share.
struct Done<R> {
    results: Vec<Result<R, InferenceError>>,
    block: Arc<Aligned>,
}

/// Takes sequences off an iterator, a chunk at a time.
fn chunks<S, U, Y>(
    sequences: impl Iterator<Item = S>,
    is_full: impl Fn(ChunkSize) -> bool,
) -> impl Iterator<Item = Vec<S>>
where
    S: Sequence<U, Y>,
    Y: ?Sized,
{
    let mut sequences = sequences.fuse();
    iter::from_fn(move || {
        let (mut chunk, mut size) = (Vec::new(), ChunkSize::default());
        while !is_full(size)
            && let Some(sequence) = sequences.next()
        {
            size.add(sequence.steps());
            chunk.push(sequence);
        }
        (!chunk.is_empty()).then_some(chunk)
    })
}

/// Applies a routine to the sequences of a chunk, in groups of nearly the same length. `block` is
/// memory to use again.
fn in_groups<A, B, S, P, R>(
    model: &BatchModel<'_, A, B>,
    sequences: &[S],
    routine: &Routine<
        impl Fn(&BatchModel<'_, A, B>, &Group<'_, S>, &mut BatchMemory, GroupRows<'_>) -> Outcome<P>
        + Sync,
        impl Fn(P, Part) -> R + Sync,
        impl Fn(&S) -> Result<R, InferenceError> + Sync,
    >,
    memories: &MemoryPool<BatchMemory>,
    block: Option<Aligned>,
) -> Done<R>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Sync,
    P: Send,
    R: Send,
{
    let (states, size) = (model.ones.len(), model.group_size(routine.room));
    let steps: Vec<usize> = sequences.iter().map(Sequence::steps).collect();
    let order: Vec<_> = by_length(&steps).into_iter().map(|i| (i, &sequences[i])).collect();
    let in_lanes = |group: &Group<'_, S>| {
        choice::for_sequences(group.sequences.len(), states) == Engine::Lanes
            && size.engine(group.longest) == Engine::Lanes
    };
    let count = |group: &Group<'_, S>| match routine.room {
        Room::Rows if in_lanes(group) => {
            let steps = group.steps[..group.sequences.len()].iter();
            steps.map(|steps| eights(states, *steps)).sum()
        }
        Room::Rows | Room::Nothing => 0,
    };
    let groups: Vec<_> = order.chunks(LANES).map(Group::new).collect();
    let numbers = groups.iter().map(|group| count(group) * LANES).sum();
    let mut block = match block {
        Some(block) if block.len() >= numbers => block,
        _ => Aligned::new(numbers, 0.0),
    };
    let streamed = numbers > STREAMED;
    let mut left = block.as_chunks_mut().0;
    let mut items = Vec::with_capacity(groups.len());
    for group in &groups {
        let (eights, others) = left.split_at_mut(count(group));
        items.push((group, GroupRows { states, eights, streamed }));
        left = others;
    }
    let done = parallel::map(items, |(group, rows), (): &mut ()| {
        let outcome = if in_lanes(group) {
            let mut memory = memories.pop().unwrap_or_default();
            let outcome = (routine.together)(model, group, &mut memory, rows);
            memories.push(memory);
            outcome
        } else {
            [const { None }; LANES]
        };
        let one = |(&(_, s), outcome): (&(usize, &S), Option<P>)| match outcome {
            Some(p) => Lane::Together(p),
            None => Lane::Alone((routine.single)(s)),
        };
        group.sequences.iter().zip(outcome).map(one).collect::<Vec<_>>()
    });
    let block = Arc::new(block);
    let mut results: Vec<_> = sequences.iter().map(|_| None).collect();
    let mut start = 0;
    for (group, lanes) in groups.iter().zip(done) {
        let rows = count(group) > 0;
        for (&(sequence, s), lane) in group.sequences.iter().zip(lanes) {
            let steps = if rows { s.steps() } else { 0 };
            let range = start..start + states * (steps + 1);
            start += if rows { eights(states, steps) * LANES } else { 0 };
            results[sequence] = Some(match lane {
                Lane::Together(p) => Ok((routine.finish)(p, Part { all: block.clone(), range })),
                Lane::Alone(result) => result,
            });
        }
    }
    Done { results: results.into_iter().flatten().collect(), block }
}

/// Result of a sequence, in a group or by itself.
enum Lane<P, R> {
    Together(P),
    Alone(Result<R, InferenceError>),
}

impl<A, B> BatchModel<'_, A, B> {
    /// Size of a step of a group of eight sequences.
    fn group_size(&self, room: Room) -> GroupSize {
        let (states, entries) = (self.ones.len(), self.rows.values().len());
        GroupSize { states, entries, keeps: room == Room::Rows }
    }
}
