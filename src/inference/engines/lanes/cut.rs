//! Cut of a long sequence into segments: where they begin, and how long their warm-ups are.
//!
//! A warm-up is as long as the model takes to forget its state, as found by trials at some places
//! of the sequence. Every joint verifies later that it was long enough there
//! ([`segments`](super::segments)).

use super::segments::agree;
use super::{Group, LaneMemory, LaneModel};
use crate::inference::engines::choice;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::LANES;

/// Distance up to which two beliefs count as having forgotten where they started. It is less than
/// what a joint allows.
const FORGOTTEN: f64 = 2e-14;
/// Steps of a trial between two checks of the distance.
const LOOK: usize = 8;
/// Number of places of a sequence at which forgetting is tried, with two lanes each.
const TRIALS: usize = LANES / 2;

/// Cut of a sequence into groups of eight segments.
pub(crate) struct Segments<'s, S: ?Sized> {
    pub(crate) sequence: &'s S,
    /// Filtered belief at step `first`, where the first segment starts (that of X_0, or of X_1 if
    /// no move leads to it), and the log-likelihood up to there.
    pub(crate) head: (Vec<f64>, f64),
    pub(crate) first: usize,
    pub(crate) groups: usize,
    /// Steps of the warm-up before and after a segment.
    pub(crate) warm_up: usize,
    /// Largest number of steps of a segment with the warm-up after it.
    longest: usize,
}

impl<S: ?Sized> Segments<'_, S> {
    /// Returns the steps at which the segments of a group start and end.
    pub(crate) fn bounds<U, Y: ?Sized>(&self, group: usize) -> [usize; LANES + 1]
    where
        S: Sequence<U, Y>,
    {
        let (steps, parts) = (self.sequence.steps() - self.first, self.groups * LANES);
        // Lengths differ by at most one. Computed from quotient and remainder, since a product with
        // the number of steps could overflow.
        let (length, longer) = (steps / parts, steps % parts);
        std::array::from_fn(|l| {
            let part = group * LANES + l;
            self.first + part * length + part.min(longer)
        })
    }

    /// Returns true if segments are at least as long as a warm-up of this length, and both together
    /// not too long.
    pub(crate) fn has_room_for<U, Y: ?Sized>(&self, warm_up: usize) -> bool
    where
        S: Sequence<U, Y>,
    {
        let length = (self.sequence.steps() - self.first) / (self.groups * LANES);
        length >= warm_up && length.saturating_add(warm_up) < self.longest
    }
}

/// Part of a sequence: the `steps` steps after `start`.
pub(crate) struct Stretch<'s, S: ?Sized> {
    sequence: &'s S,
    start: usize,
    steps: usize,
}

impl<U, Y: ?Sized, S: Sequence<U, Y> + ?Sized> Sequence<U, Y> for Stretch<'_, S> {
    fn steps(&self) -> usize {
        self.steps
    }

    fn control(&self, step: usize) -> &U {
        self.sequence.control(self.start + step)
    }

    fn observation(&self, step: usize) -> &Y {
        self.sequence.observation(self.start + step)
    }
}

/// Calls `run` with a group of stretches, given by the steps at which they start and end.
pub(crate) fn with_group<'s, U, Y: ?Sized, S: Sequence<U, Y> + ?Sized, R>(
    sequence: &'s S,
    ranges: [(usize, usize); LANES],
    run: impl FnOnce(&Group<'_, Stretch<'s, S>>) -> R,
) -> R {
    let stretches = ranges.map(|(start, end)| Stretch { sequence, start, steps: end - start });
    let lanes: [_; LANES] = std::array::from_fn(|l| (l, &stretches[l]));
    run(&Group::new(&lanes, |_, _| true))
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Cuts a sequence if it is long and the model forgets fast enough. `longest` limits the steps
    /// of a group.
    pub(crate) fn segments<'s, S>(
        &self,
        sequence: &'s S,
        longest: usize,
        memory: &mut LaneMemory,
    ) -> Option<Segments<'s, S>>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let first = usize::from(!self.hmm.prior().moves_at(1));
        let steps = sequence.steps().checked_sub(first)?;
        let trial = choice::longest_trial(steps, longest)?;
        // Twice the length found, since there are many more joints than trials.
        let warm_up = 2 * self.forgets_within(sequence, trial, memory)?;
        let groups = choice::segment_groups(self.states(), steps, warm_up, longest)?;
        let head = self.head(sequence, first, memory)?;
        Some(Segments { sequence, head, first, groups, warm_up, longest })
    }

    /// Returns the belief before the first transition, and the log-likelihood up to there.
    fn head<S>(
        &self,
        sequence: &S,
        first: usize,
        memory: &mut LaneMemory,
    ) -> Option<(Vec<f64>, f64)>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        if first == 0 {
            return Some((self.hmm.prior().belief().as_slice().to_vec(), 0.0));
        }
        with_group(sequence, [(0, first); LANES], |group| {
            let log = self.forward(group, memory, false, |_, _| ()).log_likelihoods()[0]?;
            Some((memory.beliefs[..self.states()].iter().map(|belief| belief[0]).collect(), log))
        })
    }

    /// Returns the number of steps after which beliefs no longer depended on where they started, in
    /// trials at some places; `None` if they still did after `longest`.
    fn forgets_within<S>(
        &self,
        sequence: &S,
        longest: usize,
        memory: &mut LaneMemory,
    ) -> Option<usize>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let n = self.states();
        memory.fit(n, 0, 0);
        // Two starts: uniform, and weights without a pattern that the model could share, from the
        // fractional parts of multiples of the golden ratio.
        let weights = (0..n).map(|i| 0.5 + (i as f64 * 0.618_033_988_749_894_9).fract());
        let total: f64 = weights.clone().sum();
        let starts = [vec![1.0 / n as f64; n], weights.map(|weight| weight / total).collect()];
        (0..LANES).for_each(|l| memory.start(l, &starts[l % 2]));
        let space = sequence.steps() / TRIALS;
        let mut steps = 0;
        while steps < longest {
            let next = (steps + LOOK).min(longest);
            // In the middle of each quarter, and so after step 1, to which no transition may lead.
            let range = |l: usize| l / 2 * space + space / 2;
            let ranges = std::array::from_fn(|l| (range(l) + steps, range(l) + next));
            let valid = with_group(sequence, ranges, |group| {
                self.forward_on(group, memory, false, true, |_, _| ()).valid
            });
            if valid != [true; LANES] {
                return None;
            }
            steps = next;
            let beliefs = &memory.beliefs[..n];
            let forgotten = |l: usize| {
                agree(beliefs.iter().map(|belief| (belief[l], belief[l + 1])), FORGOTTEN)
            };
            if (0..LANES).step_by(2).all(forgotten) {
                return Some(steps);
            }
        }
        None
    }
}
