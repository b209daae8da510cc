//! One long sequence in lanes: eight consecutive segments of it at a time, each with warm-ups.
//!
//! A segment does not know the belief before its first step, nor γ / α after its last. It starts
//! from a positive vector some steps earlier and, in the backward pass, from ones some steps later.
//! If the model forgets, the vectors have become the right ones by then, up to rounding. A warm-up
//! is as long as the model takes to forget its state, as found by trials at some places of the
//! sequence.
//!
//! That is verified at every joint, where two segments both have the vectors, in Hilbert's
//! projective metric d(x, y) = ln max(x/y) − ln min(x/y), which is infinite unless both have the
//! same zeros. No product with A, A' or a diagonal increases d (Birkhoff 1957). The first segment
//! starts from the prior, and the last ends at T. So all vectors differ from those of the sequence
//! in one piece by at most the sum of the distances at the joints, which is that of rounding: at
//! most [`AGREEMENT`] each, usually a hundredth of that. The relative errors of γ and of the moves
//! are bounded by the sum over both passes, and the error of the log-likelihood by one such sum for
//! each segment.

use super::{Group, LaneModel, LaneScratch};
use crate::inference::LogSum;
use crate::inference::engines::choice;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels as kernels;
use wayfix_kernels::{LANES, Packed};

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
        scratch: &mut LaneScratch,
    ) -> Option<Segments<'s, S>>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let first = usize::from(!self.hmm.prior().moves_at(1));
        let steps = sequence.steps().checked_sub(first)?;
        let trial = choice::longest_trial(steps, longest)?;
        // Twice the length found, since there are many more joints than trials.
        let warm_up = 2 * self.forgets_within(sequence, trial, scratch)?;
        let groups = choice::segment_groups(self.states(), steps, warm_up, longest)?;
        let head = self.head(sequence, first, scratch)?;
        Some(Segments { sequence, head, first, groups, warm_up, longest })
    }

    /// Returns the belief before the first transition, and the log-likelihood up to there.
    fn head<S>(
        &self,
        sequence: &S,
        first: usize,
        scratch: &mut LaneScratch,
    ) -> Option<(Vec<f64>, f64)>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        if first == 0 {
            return Some((self.hmm.prior().belief().as_slice().to_vec(), 0.0));
        }
        with_group(sequence, [(0, first); LANES], |group| {
            let log = self.forward(group, scratch, false, |_, _| ()).log_likelihoods()[0]?;
            Some((scratch.beliefs[..self.states()].iter().map(|belief| belief[0]).collect(), log))
        })
    }

    /// Returns the number of steps after which beliefs no longer depended on where they started, in
    /// trials at some places; `None` if they still did after `longest`.
    fn forgets_within<S>(
        &self,
        sequence: &S,
        longest: usize,
        scratch: &mut LaneScratch,
    ) -> Option<usize>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let n = self.states();
        scratch.fit(n, 0, 0);
        // Two starts: uniform, and weights without a pattern that the model could share, from the
        // fractional parts of multiples of the golden ratio.
        let weights = (0..n).map(|i| 0.5 + (i as f64 * 0.618_033_988_749_894_9).fract());
        let total: f64 = weights.clone().sum();
        let starts = [vec![1.0 / n as f64; n], weights.map(|weight| weight / total).collect()];
        (0..LANES).for_each(|l| scratch.start(l, &starts[l % 2]));
        let space = sequence.steps() / TRIALS;
        let mut steps = 0;
        while steps < longest {
            let next = (steps + LOOK).min(longest);
            // Trials start in the middle of each quarter, and so after step 1, which may have no
            // transition.
            let range = |l: usize| l / 2 * space + space / 2;
            let ranges = std::array::from_fn(|l| (range(l) + steps, range(l) + next));
            let valid = with_group(sequence, ranges, |group| {
                self.forward_on(group, scratch, false, true, |_, _| ()).valid
            });
            if valid != [true; LANES] {
                return None;
            }
            steps = next;
            let beliefs = &scratch.beliefs[..n];
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

/// Largest distance allowed between the vectors of two segments at their joint. It exceeds the
/// rounding of a step, which is at most n / 2^53, and usually √n / 2^53.
const AGREEMENT: f64 = 1e-13;

/// Reason why a group of segments is not valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Invalid {
    /// A warm-up was too short.
    WarmUp,
    /// Linear space cannot hold the sequence, or it has an error.
    Range,
}

/// A group of segments whose inner joints are verified.
pub(crate) struct SegmentGroup {
    /// Beliefs, and γ / α, at the starts and at the ends of the segments.
    starts: [Vec<Packed>; 2],
    ends: [Vec<Packed>; 2],
    /// Number of steps of each segment, without warm-ups.
    pub(crate) lengths: [usize; LANES],
    /// Log-likelihood of each segment given all observations before it.
    pub(crate) logs: [f64; LANES],
}

impl SegmentGroup {
    /// Returns true if the belief at the end of a lane agrees with that at the start of lane
    /// `first` of the group `next`.
    pub(crate) fn joins_forward(&self, lane: usize, next: &Self, first: usize) -> bool {
        let pairs = self.ends[0].iter().zip(&next.starts[0]);
        agree(pairs.map(|(end, start)| (end[lane], start[first])), AGREEMENT)
    }

    /// Returns true if γ / α, from the backward pass, agree at the same joint.
    pub(crate) fn joins_backward(&self, lane: usize, next: &Self, first: usize) -> bool {
        let pairs = self.ends[1].iter().zip(&next.starts[1]).zip(&self.ends[0]);
        // Only possible states count. An impossible one has no γ, and in a step back it adds
        // nothing to a possible state: either none leads to it, or its likelihood is 0.
        let possible = pairs.filter(|(_, belief)| belief[lane] > 0.0);
        agree(possible.map(|((end, start), _)| (end[lane], start[first])), AGREEMENT)
    }
}

/// Returns true if the projective distance between the two vectors of these pairs is at most
/// `limit`.
pub(crate) fn agree(pairs: impl Iterator<Item = (f64, f64)>, limit: f64) -> bool {
    let (mut least, mut largest) = (f64::INFINITY, 0.0);
    for (x, y) in pairs.filter(|pair| *pair != (0.0, 0.0)) {
        // The ratio is 0 or infinite if only one of the two is 0: then the distance is infinite.
        let ratio = x / y;
        if !(ratio > 0.0 && ratio.is_finite()) {
            return false;
        }
        least = f64::min(least, ratio);
        largest = f64::max(largest, ratio);
    }
    // ln largest − ln least ≤ ln (1 + limit).
    largest <= least * (1.0 + limit)
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Takes the segments of a group forward and back, with warm-ups of `warm_up` steps. Afterwards
    /// the beliefs of each segment's steps, its start included, are smoothed, and its moves have
    /// been added to the counts of the columns' entries.
    pub(crate) fn run_segments<S>(
        &self,
        segments: &Segments<'_, S>,
        group: usize,
        warm_up: usize,
        scratch: &mut LaneScratch,
        counts: &mut [Packed],
    ) -> Result<SegmentGroup, Invalid>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (n, sequence, bounds) = (self.states(), segments.sequence, segments.bounds(group));
        let lengths: [usize; LANES] = std::array::from_fn(|l| bounds[l + 1] - bounds[l]);
        let before = |l: usize| (bounds[l].saturating_sub(warm_up).max(segments.first), bounds[l]);
        self.warm_up(sequence, std::array::from_fn(before), scratch)?;
        let mut logs = [LogSum::default(); LANES];
        if group == 0 {
            scratch.start(0, &segments.head.0);
            logs[0].add(segments.head.1);
        }

        let mut passed = [0; LANES];
        let add_log = |l: usize, log: f64| {
            passed[l] += 1;
            if passed[l] <= lengths[l] {
                logs[l].add(log);
            }
        };
        let after = |l: usize| (bounds[l], (bounds[l + 1] + warm_up).min(sequence.steps()));
        let ranges = std::array::from_fn(after);
        let valid = with_group(sequence, ranges, |group| {
            self.forward_on(group, scratch, true, true, add_log).valid
        });
        if valid != [true; LANES] {
            return Err(Invalid::Range);
        }
        // Copied, since the backward pass replaces the beliefs by γ.
        let at = |steps: [usize; LANES]| -> Vec<Packed> {
            let belief = |i: usize| std::array::from_fn(|l| scratch.beliefs[steps[l] * n + i][l]);
            (0..n).map(|i| Packed(belief(i))).collect()
        };
        let (starts, ends, zeros) = (at([0; LANES]), at(lengths), vec![Packed::default(); n]);
        let mut found = SegmentGroup {
            starts: [starts, zeros.clone()],
            ends: [ends, zeros],
            lengths,
            logs: std::array::from_fn(|l| logs[l].value()),
        };
        if (1..LANES).any(|l| !found.joins_forward(l - 1, &found, l)) {
            return Err(Invalid::WarmUp);
        }

        let steps = ranges.map(|(start, end)| end - start);
        self.back_through(&steps, scratch, &mut found, counts)?;
        if (1..LANES).any(|l| !found.joins_backward(l - 1, &found, l)) {
            return Err(Invalid::WarmUp);
        }
        Ok(found)
    }

    /// Takes a uniform belief through the warm-up before each segment.
    fn warm_up<S>(
        &self,
        sequence: &S,
        ranges: [(usize, usize); LANES],
        scratch: &mut LaneScratch,
    ) -> Result<(), Invalid>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let n = self.states();
        let uniform = vec![1.0 / n as f64; n];
        scratch.fit(n, 0, 0);
        (0..LANES).for_each(|l| scratch.start(l, &uniform));
        with_group(sequence, ranges, |group| {
            let valid = self.forward_on(group, scratch, false, true, |_, _| ()).valid;
            // The lane of the first segment has no steps, and is reported as not valid.
            let held = (0..LANES).all(|l| valid[l] || group.steps[l] == 0);
            held.then_some(()).ok_or(Invalid::Range)
        })
    }

    /// Goes back through the warm-ups after the segments and through the segments, which together
    /// have `steps` steps, and stores γ / α at the ends and starts of the segments.
    fn back_through(
        &self,
        steps: &[usize; LANES],
        scratch: &mut LaneScratch,
        found: &mut SegmentGroup,
        counts: &mut [Packed],
    ) -> Result<(), Invalid> {
        let lengths = found.lengths;
        let (mut valid, mut sums) = ([true; LANES], [1.0; LANES]);
        let mut masked = vec![Packed::default(); self.states()];
        scratch.begin_back();
        for step in (1..=steps.iter().copied().max().unwrap_or(0)).rev() {
            // γ / α at the end of a segment, before the step back from there. (The last segment of
            // a sequence has no warm-up after it, and no joint: there q is not set yet.)
            for l in (0..LANES).filter(|l| step == lengths[*l]) {
                found.ends[1].iter_mut().zip(&scratch.q).for_each(|(end, q)| end[l] = q[l]);
            }
            let counted = lengths.map(|length| step <= length);
            self.step_back(steps, step, scratch, &mut valid, &mut sums, |before, ratio| {
                if counts.is_empty() || counted == [false; LANES] {
                    return;
                }
                if counted == [true; LANES] {
                    kernels::count_moves(self.columns, before, ratio, counts);
                    return;
                }
                // Lengths differ by one, so some lanes are still in their warm-up here.
                for (masked, ratio) in masked.iter_mut().zip(ratio) {
                    (0..LANES).for_each(|l| masked[l] = if counted[l] { ratio[l] } else { 0.0 });
                }
                kernels::count_moves(self.columns, before, &masked, counts);
            });
        }
        found.starts[1].copy_from_slice(&scratch.q);
        (valid == [true; LANES]).then_some(()).ok_or(Invalid::Range)
    }
}
