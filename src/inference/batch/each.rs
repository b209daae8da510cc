//! Groups of sequences, and the memory that their results share.

use std::sync::Arc;

use super::{BatchMemory, BatchModel, Group, Outcome};
use crate::error::{InferenceError, SequenceError};
use crate::hmm::Hmm;
use crate::inference::in_parallel::{self, Results};
use crate::inference::plan::{self, Engine, MOST_SHARED, STREAMED};
use crate::inference::posteriors::Part;
use crate::kernels::{self, Aligned, Eight, LANES, Packed};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Room for results that a routine needs, beside what it returns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum Room {
    Nothing,
    /// A row for each step from 0.
    Rows,
}

/// Room for the rows of a group: those of each lane begin on a cache line.
pub(in super::super) struct GroupRows<'a> {
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
    pub(super) fn fill<S>(self, group: &Group<'_, S>, all: &[Packed], held: [bool; LANES]) {
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

/// Applies a routine to all sequences: in groups where the model allows it, else,
/// and where a group fails, one by one. The groups do not depend on how many
/// threads there are.
///
/// `together` gets room for the rows of a group; `finish` puts what it returns
/// together with those of its lane.
pub(in super::super) fn each<A, B, S, P, R>(
    hmm: &Hmm<A, B>,
    sequences: &[S],
    room: Room,
    together: impl Fn(
        &BatchModel<'_, A, B>,
        &Group<'_, S>,
        &mut BatchMemory,
        GroupRows<'_>,
    ) -> Outcome<P>
    + Sync,
    finish: impl Fn(P, Part) -> R,
    single: impl Fn(&S) -> Result<R, InferenceError> + Sync,
) -> Results<R>
where
    A: Transition + Sync,
    B: Likelihood + Sync,
    S: Sequence<A::Control, B::Observation> + Sync,
    P: Send,
    R: Send,
{
    let lanes = plan::for_sequences(sequences.len(), hmm.states()) == Engine::Lanes;
    let Some(model) = lanes.then(|| BatchModel::new(hmm)).flatten() else {
        return in_parallel::each(sequences, single);
    };
    let mut order: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
    order.sort_by_key(|(_, sequence)| sequence.steps());
    let states = hmm.states();
    let count = |group: &Group<'_, S>| match room {
        Room::Rows if group.is_in_lanes(states, plan::for_sequences) => {
            let steps = group.steps[..group.sequences.len()].iter();
            steps.map(|steps| eights(states, *steps)).sum()
        }
        Room::Rows | Room::Nothing => 0,
    };
    let mut shared = share(order.chunks(LANES).map(Group::new), count);
    let mut items = Vec::with_capacity(order.len().div_ceil(LANES));
    for Shared { groups, numbers } in &mut shared {
        let streamed = numbers.len() > STREAMED;
        let mut left = numbers.as_chunks_mut().0;
        for group in &*groups {
            let (eights, others) = left.split_at_mut(count(group));
            items.push((group, GroupRows { states, eights, streamed }));
            left = others;
        }
    }
    let done = in_parallel::map(items, |(group, rows), memory: &mut BatchMemory| {
        let outcome = if group.is_in_lanes(states, plan::for_sequences) {
            together(&model, group, memory, rows)
        } else {
            [const { None }; LANES]
        };
        let one = |(&(_, s), outcome): (&(usize, &S), Option<P>)| {
            outcome.map_or_else(|| Done::Alone(single(s)), Done::Together)
        };
        group.sequences.iter().zip(outcome).map(one).collect::<Vec<_>>()
    });
    let mut done = done.into_iter().flatten();
    let mut results = Vec::with_capacity(sequences.len());
    for Shared { groups, numbers } in shared {
        let (all, mut next) = (Arc::new(numbers), 0);
        for group in groups {
            let states = if count(&group) > 0 { states } else { 0 };
            for (&(sequence, s), steps) in group.sequences.iter().zip(group.steps) {
                let start = next;
                next += eights(states, steps) * LANES;
                let range = start..start + states * (steps + 1);
                let result = match done.next() {
                    Some(Done::Together(p)) => Ok(finish(p, Part { all: all.clone(), range })),
                    Some(Done::Alone(result)) => result,
                    None => single(s), // does not happen
                };
                results.push((sequence, result));
            }
        }
    }
    results.sort_unstable_by_key(|(sequence, _)| *sequence);
    let named = |(sequence, result): (usize, Result<R, InferenceError>)| {
        result.map_err(|source| SequenceError { sequence, source })
    };
    results.into_iter().map(named).collect()
}

/// Result of a sequence, in a group or by itself.
enum Done<P, R> {
    Together(P),
    Alone(Result<R, InferenceError>),
}

/// Groups whose results share their memory.
struct Shared<'s, S> {
    groups: Vec<Group<'s, S>>,
    numbers: Aligned,
}

/// Joins groups in order; each needs room for some eights.
fn share<'s, S>(
    groups: impl Iterator<Item = Group<'s, S>>,
    count: impl Fn(&Group<'s, S>) -> usize,
) -> Vec<Shared<'s, S>> {
    let mut all: Vec<(Vec<_>, usize)> = Vec::new();
    for group in groups {
        let more = count(&group) * LANES;
        match all.last_mut() {
            Some((groups, numbers)) if *numbers + more <= MOST_SHARED => {
                groups.push(group);
                *numbers += more;
            }
            _ => all.push((vec![group], more)),
        }
    }
    let room = |(groups, numbers)| Shared { groups, numbers: Aligned::new(numbers, 0.0) };
    all.into_iter().map(room).collect()
}
