//! All segments of a sequence, group by group, with every joint verified.
//!
//! A group where a warm-up was too short runs again with longer ones. Which groups do depends
//! only on the sequence, not on threads. The invariant: results are passed on only when both joints
//! of their group, with the one before and the one after, are verified.

use super::segments::Segments;
use super::segments::{Invalid, SegmentGroup};
use super::{LaneModel, LaneScratch};
use crate::inference::engines::choice;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::{LANES, Packed};

/// A group of segments to run, with a place for its results.
pub(crate) struct Task<P> {
    pub(crate) group: usize,
    warm_up: usize,
    pub(crate) place: P,
}

/// A task that has run, with its result.
pub(crate) struct Done<P, R> {
    task: Task<P>,
    result: Result<(SegmentGroup, R), Invalid>,
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Runs a task. If the inner joints of its group are verified, `finish` reads its smoothed
    /// beliefs, and its counts for each of `entries`.
    pub(crate) fn run_task<S, P, R>(
        &self,
        segments: &Segments<'_, S>,
        mut task: Task<P>,
        entries: usize,
        scratch: &mut LaneScratch,
        finish: impl FnOnce(&SegmentGroup, &LaneScratch, &[Packed], &mut Task<P>) -> R,
    ) -> Done<P, R>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let mut counts = vec![Packed::default(); entries];
        let found = self.run_segments(segments, task.group, task.warm_up, scratch, &mut counts);
        let result = found.map(|group| {
            let result = finish(&group, scratch, &counts, &mut task);
            (group, result)
        });
        Done { task, result }
    }
}

impl<S: ?Sized> Segments<'_, S> {
    /// Runs all groups by `run`, with a place for each, and passes the results to `take` in order.
    /// Returns `None` if the sequence does not suit segments; results taken so far are then
    /// meaningless.
    pub(crate) fn visit<U, Y: ?Sized, P, R>(
        &self,
        places: impl IntoIterator<Item = P>,
        mut run: impl FnMut(Vec<Task<P>>) -> Vec<Done<P, R>>,
        mut take: impl FnMut(R),
    ) -> Option<()>
    where
        S: Sequence<U, Y>,
    {
        let warm_up = self.warm_up;
        let tasks = places.into_iter().enumerate();
        let mut tasks = tasks.map(|(group, place)| Task { group, warm_up, place });
        let mut round = choice::FIRST_GROUPS;
        let mut done = Vec::new();
        loop {
            let next: Vec<_> = tasks.by_ref().take(round).collect();
            let is_last = next.is_empty();
            // Runs groups again until all joints known so far agree, those between old and new
            // groups included.
            done.extend(run(next));
            loop {
                let short = short(&done)?;
                if !short.contains(&true) {
                    break;
                }
                self.run_again(&mut done, &short, &mut run)?;
            }
            // The last group is held back until the next one verifies its last joint.
            let ready = if is_last { done.len() } else { done.len() - 1 };
            done.drain(..ready).filter_map(|done| done.result.ok()).for_each(|(_, r)| take(r));
            if is_last {
                return Some(());
            }
            round = choice::GROUPS_AT_A_TIME;
        }
    }

    /// Runs some groups again, with longer warm-ups.
    fn run_again<U, Y: ?Sized, P, R>(
        &self,
        done: &mut Vec<Done<P, R>>,
        short: &[bool],
        run: &mut impl FnMut(Vec<Task<P>>) -> Vec<Done<P, R>>,
    ) -> Option<()>
    where
        S: Sequence<U, Y>,
    {
        let mut kept = Vec::with_capacity(done.len());
        let mut again = Vec::new();
        for (done, short) in done.drain(..).zip(short) {
            if *short {
                let warm_up = done.task.warm_up.saturating_mul(choice::LONGER);
                again.push(Task { warm_up, ..done.task });
                kept.push(None);
            } else {
                kept.push(Some(done));
            }
        }
        if again.iter().any(|task| !self.has_room_for(task.warm_up)) {
            return None;
        }
        let mut again = run(again).into_iter();
        done.extend(kept.into_iter().filter_map(|kept| kept.or_else(|| again.next())));
        Some(())
    }
}

/// Returns, for each of some consecutive groups, true if one of its warm-ups was too short; `None`
/// if some group cannot run in lanes.
fn short<P, R>(done: &[Done<P, R>]) -> Option<Vec<bool>> {
    let mut short = Vec::with_capacity(done.len());
    for done in done {
        match done.result {
            Err(Invalid::Range) => return None,
            Err(Invalid::WarmUp) => short.push(true),
            Ok(_) => short.push(false),
        }
    }
    // Joints between groups. If the forward passes disagree, the warm-up before the later group was
    // too short; if the backward passes do, the warm-up after the earlier group was.
    for (at, pair) in done.windows(2).enumerate() {
        if let (Ok((before, _)), Ok((after, _))) = (&pair[0].result, &pair[1].result) {
            short[at + 1] |= !before.joins_forward(LANES - 1, after, 0);
            short[at] |= !before.joins_backward(LANES - 1, after, 0);
        }
    }
    Some(short)
}
