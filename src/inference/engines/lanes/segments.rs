//! One long sequence in lanes: eight consecutive segments of it at a time, each with a warm-up.
//!
//! A segment does not know the belief before its first step, nor γ / α after its last. It starts
//! from a positive vector some steps earlier and, on the way back, from ones some steps later: a
//! model that forgets has the same vectors by then, up to rounding. That they are the same is
//! verified at every joint of two segments, where both have them, in Hilbert's projective metric
//! d(x, y) = ln max(x/y) − ln min(x/y), infinite unless both have the same zeros. No product with
//! A, A' or a diagonal expands d (Birkhoff 1957). So, as the first segment starts from the prior,
//! and the last ends at T, all vectors differ from those of the sequence in one piece by no more
//! than the sum of the distances at the joints, which is that of rounding: [`AGREEMENT`] each at
//! most, usually a hundredth of that. Relative errors of γ and of the moves are bounded by the sum
//! of both ways, and the log-likelihood by one such sum for each segment.

use super::cut::{Segments, with_group};
use super::{LaneMemory, LaneModel};
use crate::inference::LogSum;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::{self as kernels, LANES, Packed};

/// Largest distance of the vectors of two segments at their joint. Above the rounding of a step,
/// n / 2^53 at most, and usually of its root.
const AGREEMENT: f64 = 1e-13;

/// Reason why a group of segments is not valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Invalid {
    /// A warm-up was too short.
    WarmUp,
    /// Linear space does not hold the sequence, or there is an error in it.
    Range,
}

/// A group of segments whose joints are verified but for its first and its last.
pub(crate) struct SegmentGroup {
    /// Beliefs, and γ / α, where the segments start and where they end.
    starts: [Vec<Packed>; 2],
    ends: [Vec<Packed>; 2],
    /// Number of steps of each segment, without warm-ups.
    pub(crate) lengths: [usize; LANES],
    /// Log-likelihood of each segment given what was observed before.
    pub(crate) logs: [f64; LANES],
}

impl SegmentGroup {
    /// True if the beliefs of a lane of this group at its end are those at the start of another.
    pub(crate) fn joins_forward(&self, lane: usize, next: &Self, first: usize) -> bool {
        let pairs = self.ends[0].iter().zip(&next.starts[0]);
        agree(pairs.map(|(end, start)| (end[lane], start[first])), AGREEMENT)
    }

    /// The same on the way back, for γ / α.
    pub(crate) fn joins_backward(&self, lane: usize, next: &Self, first: usize) -> bool {
        let pairs = self.ends[1].iter().zip(&next.starts[1]).zip(&self.ends[0]);
        // Over the states that are possible: no other is in any γ, nor leads to or comes from one
        // in a product.
        let possible = pairs.filter(|(_, belief)| belief[lane] > 0.0);
        agree(possible.map(|((end, start), _)| (end[lane], start[first])), AGREEMENT)
    }
}

/// Returns true if the projective distance of the vectors of these pairs is no more than `limit`.
pub(crate) fn agree(pairs: impl Iterator<Item = (f64, f64)>, limit: f64) -> bool {
    let (mut least, mut largest) = (f64::INFINITY, 0.0);
    for (x, y) in pairs.filter(|pair| *pair != (0.0, 0.0)) {
        // 0 or infinite if one is 0.
        let ratio = x / y;
        if !(ratio > 0.0 && ratio.is_finite()) {
            return false;
        }
        least = f64::min(least, ratio);
        largest = f64::max(largest, ratio);
    }
    largest <= least * (1.0 + limit)
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Takes the segments of a group forward and back, with warm-ups of so many steps. Beliefs of
    /// the steps of each segment from its start are smoothed then, and the moves of its steps added
    /// to the counts of the columns' entries.
    pub(crate) fn run_segments<S>(
        &self,
        segments: &Segments<'_, S>,
        group: usize,
        warm_up: usize,
        memory: &mut LaneMemory,
        counts: &mut [Packed],
    ) -> Result<SegmentGroup, Invalid>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let (n, sequence, bounds) = (self.states(), segments.sequence, segments.bounds(group));
        let lengths: [usize; LANES] = std::array::from_fn(|l| bounds[l + 1] - bounds[l]);
        let before = |l: usize| (bounds[l].saturating_sub(warm_up).max(segments.first), bounds[l]);
        self.warm_up(sequence, std::array::from_fn(before), memory)?;
        let mut logs = [LogSum::default(); LANES];
        if group == 0 {
            memory.start(0, &segments.head.0);
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
            self.forward_on(group, memory, true, true, add_log).valid
        });
        if valid != [true; LANES] {
            return Err(Invalid::Range);
        }
        // Copies: the way back makes γ of them.
        let at = |steps: [usize; LANES]| -> Vec<Packed> {
            let belief = |i: usize| std::array::from_fn(|l| memory.beliefs[steps[l] * n + i][l]);
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
        self.back_through(&steps, memory, &mut found, counts)?;
        if (1..LANES).any(|l| !found.joins_backward(l - 1, &found, l)) {
            return Err(Invalid::WarmUp);
        }
        Ok(found)
    }

    /// Takes a uniform belief through the steps before each segment.
    fn warm_up<S>(
        &self,
        sequence: &S,
        ranges: [(usize, usize); LANES],
        memory: &mut LaneMemory,
    ) -> Result<(), Invalid>
    where
        S: Sequence<A::Control, B::Observation> + ?Sized,
    {
        let n = self.states();
        let uniform = vec![1.0 / n as f64; n];
        memory.fit(n, 0, 0);
        (0..LANES).for_each(|l| memory.start(l, &uniform));
        with_group(sequence, ranges, |group| {
            let valid = self.forward_on(group, memory, false, true, |_, _| ()).valid;
            // A lane without a step, that of the first segment, is not valid either.
            let held = (0..LANES).all(|l| valid[l] || group.steps[l] == 0);
            held.then_some(()).ok_or(Invalid::Range)
        })
    }

    /// Goes back through segments and the warm-ups after them, so many steps in all, and notes
    /// γ / α at the ends and starts of the segments.
    fn back_through(
        &self,
        steps: &[usize; LANES],
        memory: &mut LaneMemory,
        found: &mut SegmentGroup,
        counts: &mut [Packed],
    ) -> Result<(), Invalid> {
        let lengths = found.lengths;
        let (mut valid, mut sums) = ([true; LANES], [1.0; LANES]);
        let mut masked = vec![Packed::default(); self.states()];
        memory.begin_back();
        for step in (1..=steps.iter().copied().max().unwrap_or(0)).rev() {
            // γ / α of this step, before the step back to the one before it. The last segment of a
            // sequence has none yet, and no joint.
            for l in (0..LANES).filter(|l| step == lengths[*l]) {
                found.ends[1].iter_mut().zip(&memory.q).for_each(|(end, q)| end[l] = q[l]);
            }
            let counted = lengths.map(|length| step <= length);
            self.step_back(steps, step, memory, &mut valid, &mut sums, |before, ratio| {
                if counts.is_empty() || counted == [false; LANES] {
                    return;
                }
                if counted == [true; LANES] {
                    kernels::count_moves(self.columns, before, ratio, counts);
                    return;
                }
                // Lengths differ by a step: some lanes are in their warm-up still.
                for (masked, ratio) in masked.iter_mut().zip(ratio) {
                    (0..LANES).for_each(|l| masked[l] = if counted[l] { ratio[l] } else { 0.0 });
                }
                kernels::count_moves(self.columns, before, &masked, counts);
            });
        }
        found.starts[1].copy_from_slice(&memory.q);
        (valid == [true; LANES]).then_some(()).ok_or(Invalid::Range)
    }
}
