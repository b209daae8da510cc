//! Many sequences through one model, eight at a time, one in each lane of a vector: products with
//! a stored matrix need no gathers, and its entries are read once for all eight.
//!
//! The recursions are those of one sequence (sections 2, 3, 7 and 9 of the
//! [formulas](crate::guide::formulas)). Forward–backward is here: α_k = (A α_{k-1}) ∘ b / N_k, then
//! q = A' (q ∘ b / N), γ = α ∘ q. Linear space with lifted beliefs is sufficient for nearly all
//! sequences (`limits`, "In lanes"). A lane for which it might not be, or that would cause an
//! error, becomes invalid for good, and its sequence runs by itself afterwards: the routine for one
//! sequence can use logarithms, and reports errors. No lane reads what another has written, so that
//! a result does not depend on the other sequences of the group.
//!
//! Beliefs are lifted at all steps, as those of a single sequence are where they must be, so that
//! both have the same digits. The largest likelihood of each lane is within `UNSCALED` and the
//! others are at least `TINY`, or the lane becomes invalid. With entries of at least `LEAST_ENTRY`,
//! no lifted product then becomes 0 unnoticed. In a model with rounded tails, small ones may.
//!
//! One long sequence can fill all lanes with its own segments, if the model forgets ([`segments`]).

mod expectations;
mod segments;
mod smooth_long;
mod verified;
mod viterbi;

use std::sync::OnceLock;

use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::step::SensorScratch;
use crate::likelihood::{Likelihood, Values};
use crate::sequence::Sequence;
use crate::transition::{Transition, constant_control};
use wayfix_kernels as kernels;
use wayfix_kernels::limits::{BACK_LIFT, LEAST_NORMALIZER, LIFT, TINY, UNSCALED, exponent, power};
use wayfix_kernels::{Eight, LANES, Lines, Packed, limits};

pub(crate) use self::expectations::LaneExpectations;
pub(crate) use self::smooth_long::smooth;

/// A model with a stored matrix, whose entries are large enough for linear space.
pub(crate) struct LaneModel<'m, A, B> {
    pub(crate) hmm: &'m Hmm<A, B>,
    pub(crate) rows: Lines<'m>,
    columns: Lines<'m>,
    /// Likelihoods for a lane whose sequence has ended, and their logarithms.
    ones: Vec<f64>,
    zeros: Vec<f64>,
    /// Logarithms of the rows, computed by the first decoding.
    log2: OnceLock<Vec<f64>>,
}

impl<'m, A: Transition, B: Likelihood> LaneModel<'m, A, B> {
    /// Creates the model; `None` if it does not suit lanes.
    pub(crate) fn new(hmm: &'m Hmm<A, B>) -> Option<Self> {
        let control = constant_control::<A>()?;
        hmm.transition().check_control(control).ok()?;
        if hmm.transition().evidence(control).is_some() {
            return None;
        }
        // No entry is below `LEAST_ENTRY`. With normal beliefs and likelihoods of at least `TINY`,
        // no product then becomes 0 unnoticed.
        let (rows, columns) =
            hmm.transition().stored(control).filter(|matrix| matrix.has_no_tiny_entries())?.lines();
        // A subnormal prior could let a lifted product become 0 unnoticed.
        let prior = hmm.prior().belief().as_slice();
        if prior.iter().any(|p| 0.0 < *p && *p < f64::MIN_POSITIVE) {
            return None;
        }
        let (ones, zeros) = (vec![1.0; prior.len()], vec![0.0; prior.len()]);
        Some(Self { hmm, rows, columns, ones, zeros, log2: OnceLock::new() })
    }

    fn states(&self) -> usize {
        self.ones.len()
    }
}

/// Up to eight sequences, each with its index.
pub(crate) struct Group<'s, S> {
    pub(crate) sequences: &'s [(usize, &'s S)],
    /// Number of steps; 0 for lanes without a sequence.
    pub(crate) steps: [usize; LANES],
    pub(crate) longest: usize,
    /// True if the group runs in lanes according to the plan; otherwise its sequences run one by
    /// one.
    pub(crate) in_lanes: bool,
}

impl<'s, S> Group<'s, S> {
    /// Creates a group, and asks the plan whether this number of sequences, with this number of
    /// steps of the longest, runs in lanes.
    pub(crate) fn new<U, Y: ?Sized>(
        sequences: &'s [(usize, &'s S)],
        runs_in_lanes: impl Fn(usize, usize) -> bool,
    ) -> Self
    where
        S: Sequence<U, Y>,
    {
        let mut steps = [0; LANES];
        steps.iter_mut().zip(sequences).for_each(|(steps, (_, s))| *steps = s.steps());
        let longest = steps.iter().copied().max().unwrap_or(0);
        Self { sequences, steps, longest, in_lanes: runs_in_lanes(sequences.len(), longest) }
    }

    /// Lanes with a step to take. Empty sequences run by themselves.
    fn lanes(&self) -> [bool; LANES] {
        self.steps.map(|steps| steps > 0)
    }
}

/// Memory of a group, reused by the next.
#[derive(Default)]
pub(crate) struct LaneScratch {
    /// Beliefs of steps 0 to T, or only the last one.
    pub(crate) beliefs: Vec<Packed>,
    /// Likelihoods of steps 1 to T, or only the last ones.
    likelihoods: Vec<Packed>,
    /// One over the normalisers of steps 1 to T.
    inverse: Vec<Packed>,
    /// Lifted belief, or scores, and those of the next step.
    x: Vec<Packed>,
    next: Vec<Packed>,
    /// γ / α and γ / p, lifted.
    q: Vec<Packed>,
    ratio: Vec<Packed>,
    backpointers: Vec<[u32; LANES]>,
    lanes: [SensorScratch; LANES],
}

impl LaneScratch {
    /// Makes room for beliefs and likelihoods of `stored` steps, and for `steps` normalisers.
    /// Values left by earlier groups are not cleared: routines write before they read.
    fn fit(&mut self, states: usize, stored: usize, steps: usize) {
        let grow = |room: &mut Vec<Packed>, count: usize| {
            if room.len() < count {
                room.resize(count, Packed::default());
            }
        };
        // `unpack_rows` reads whole blocks of eight, even beyond the last row.
        grow(&mut self.beliefs, (states * (stored + 1)).next_multiple_of(LANES));
        grow(&mut self.likelihoods, states * stored.max(1));
        grow(&mut self.inverse, steps);
        for room in [&mut self.x, &mut self.next, &mut self.q, &mut self.ratio] {
            room.resize(states, Packed::default());
        }
    }

    /// Sets the belief that a lane starts from.
    fn start(&mut self, lane: usize, belief: &[f64]) {
        for ((x, first), p) in self.x.iter_mut().zip(&mut self.beliefs).zip(belief) {
            (x[lane], first[lane]) = (p * LIFT, *p);
        }
    }

    /// Prepares the backward pass. A lane whose sequence is shorter than the longest begins later,
    /// and until then has these zeros: values left by an earlier group may be infinite, and 0 times
    /// infinity is NaN.
    fn begin_back(&mut self) {
        self.q.fill(Packed::default());
    }
}

/// Results of the passes for each lane.
pub(crate) struct LaneForward {
    /// True while linear space holds the sequence of a lane, without an error.
    pub(crate) valid: [bool; LANES],
    log_likelihoods: [LogSum; LANES],
}

impl LaneForward {
    /// Returns ln p(y_1 … y_T) of the valid lanes.
    pub(crate) fn log_likelihoods(&self) -> [Option<f64>; LANES] {
        std::array::from_fn(|l| self.valid[l].then(|| self.log_likelihoods[l].value()))
    }
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Filters a group, and keeps beliefs and likelihoods of all steps if `stores` is true. Passes
    /// ln p(y_k | y_1 … y_{k-1}) of each lane and step to `visit`.
    pub(crate) fn forward<S>(
        &self,
        group: &Group<'_, S>,
        scratch: &mut LaneScratch,
        stores: bool,
        visit: impl FnMut(usize, f64),
    ) -> LaneForward
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let prior = self.hmm.prior();
        scratch.fit(self.states(), 0, 0);
        (0..LANES).for_each(|l| scratch.start(l, prior.belief().as_slice()));
        self.forward_on(group, scratch, stores, prior.moves_at(1), visit)
    }

    /// Filters a group as [`forward`](Self::forward) does, but from the beliefs in scratch. `moves`
    /// says whether a transition leads to the first step.
    pub(crate) fn forward_on<S>(
        &self,
        group: &Group<'_, S>,
        scratch: &mut LaneScratch,
        stores: bool,
        moves: bool,
        mut visit: impl FnMut(usize, f64),
    ) -> LaneForward
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let start = self.hmm.prior().belief().as_slice();
        let n = self.states();
        scratch.fit(n, if stores { group.longest } else { 0 }, group.longest);
        let LaneScratch { beliefs, likelihoods, inverse, x, next, lanes, .. } = scratch;
        let (mut valid, mut log_likelihoods) = (group.lanes(), [LogSum::default(); LANES]);
        for step in 1..=group.longest {
            let row = if stores { step } else { 0 };
            let belief = &mut beliefs[row * n..][..n];
            let likelihoods = &mut likelihoods[row.saturating_sub(1) * n..][..n];
            let scales = self.likelihoods(group, step, lanes, &mut valid, likelihoods);
            let matrix = (step > 1 || moves).then_some(self.rows);
            let sums = kernels::batch_forward(matrix, x, likelihoods, next);
            let lost = kernels::batch_normalize(next, belief, sums);
            std::mem::swap(x, next);
            let inverse = &mut inverse[step - 1];
            for l in 0..LANES {
                let normalizer = sums[l] / LIFT;
                inverse[l] = 1.0 / normalizer;
                // The conditions of `limits::linear_holds` for predictions that sum to one; NaN
                // fails them. A lane whose sequence has ended continues with likelihoods of one,
                // unchecked.
                valid[l] &= step > group.steps[l]
                    || normalizer >= LEAST_NORMALIZER * scales.largest[l]
                        && normalizer.is_finite()
                        && (!lost[l] || self.hmm.rounds_tails());
                if valid[l] && step <= group.steps[l] {
                    let log = normalizer.ln() + scales.logs[l];
                    log_likelihoods[l].add(log);
                    visit(l, log);
                }
                if !inverse[l].is_normal() {
                    // An invalid lane continues from the prior, so that no infinity or NaN stays in
                    // memory that later groups reuse.
                    inverse[l] = 1.0;
                    for ((x, belief), p) in x.iter_mut().zip(&mut *belief).zip(start) {
                        (x[l], belief[l]) = (p * LIFT, *p);
                    }
                }
            }
            if valid == [false; LANES] {
                break;
            }
        }
        LaneForward { valid, log_likelihoods }
    }

    /// Replaces the stored beliefs by smoothed ones, from the last step back, and adds the lifted
    /// α(j) γ(i) / p(i) to the counts of the columns' entries.
    pub(crate) fn backward<S>(
        &self,
        group: &Group<'_, S>,
        scratch: &mut LaneScratch,
        valid: &mut [bool; LANES],
        mut counts: Option<&mut [Packed]>,
    ) {
        let n = self.states();
        let mut sums = [1.0; LANES];
        scratch.begin_back();
        for step in (1..=group.longest).rev() {
            if *valid == [false; LANES] {
                break;
            }
            if !self.hmm.prior().moves_at(step) {
                scratch.beliefs.copy_within(n..2 * n, 0); // X_0 is the same state as X_1
                continue;
            }
            self.step_back(&group.steps, step, scratch, valid, &mut sums, |before, ratio| {
                if let Some(counts) = &mut counts {
                    kernels::count_moves(self.columns, before, ratio, counts);
                }
            });
        }
    }

    /// Takes all lanes one step back, to the beliefs before `step`, and passes α and γ / p to
    /// `count`. `steps` are the lengths of the lanes; `sums` are Σ γ at the step, and become those
    /// before it.
    pub(crate) fn step_back(
        &self,
        steps: &[usize; LANES],
        step: usize,
        scratch: &mut LaneScratch,
        valid: &mut [bool; LANES],
        sums: &mut Eight,
        count: impl FnOnce(&[Packed], &[Packed]),
    ) {
        let n = self.states();
        let LaneScratch { beliefs, likelihoods, inverse, q, ratio, .. } = scratch;
        // A factor of 0 leaves the belief of a lane unchanged: its sequence has ended before this
        // step, or it is invalid.
        let mut factors = [0.0; LANES];
        for l in 0..LANES {
            if step == steps[l] {
                // γ_T = α_T, so γ / α is one in all states.
                q.iter_mut().for_each(|q| q[l] = BACK_LIFT);
                sums[l] = 1.0;
            }
            if step <= steps[l] && valid[l] {
                // Divided by the sum of γ at this step, whose rounding would otherwise accumulate.
                factors[l] = inverse[step - 1][l] / sums[l];
            }
        }
        let before = &mut beliefs[(step - 1) * n..][..n];
        let likelihoods = &likelihoods[(step - 1) * n..][..n];
        // γ_k / p_k = q_k ∘ b_k / N_k, then q_{k−1} = A' (γ_k / p_k) and γ_{k−1} = α_{k−1} ∘
        // q_{k−1} (section 3 of `guide::formulas`, "Two products or three").
        kernels::batch_ratio(q, likelihoods, factors, ratio);
        count(before, ratio);
        *sums = kernels::batch_backward(self.columns, factors, ratio, before, q);
        for (l, valid) in valid.iter_mut().enumerate() {
            // A step back conserves Σ γ, so any overflow or loss shows up there (`limits`, "The way
            // back").
            if *valid && step <= steps[l] && !limits::is_one(sums[l]) {
                *valid = false;
                q.iter_mut().for_each(|q| q[l] = 0.0);
            }
        }
    }
}

/// Largest likelihood of each lane, and the logarithm of the scale that was taken out.
pub(crate) struct LaneScales {
    pub(crate) largest: Eight,
    pub(crate) logs: Eight,
}

impl<A: Transition, B: Likelihood> LaneModel<'_, A, B> {
    /// Packs the likelihoods of a step, with 1 in lanes that have ended. Lanes whose likelihoods
    /// are invalid, or too small compared with the largest, become invalid.
    // Not inlined: inlining this made each iteration of the loop over the steps a tenth slower.
    #[inline(never)]
    pub(crate) fn likelihoods<S>(
        &self,
        group: &Group<'_, S>,
        step: usize,
        lanes: &mut [SensorScratch; LANES],
        valid: &mut [bool; LANES],
        out: &mut [Packed],
    ) -> LaneScales
    where
        S: Sequence<A::Control, B::Observation>,
    {
        let (mut rows, mut in_logs) = ([&self.ones[..]; LANES], [false; LANES]);
        let rounded = self.hmm.rounds_tails();
        let mut scales = LaneScales { largest: [1.0; LANES], logs: [0.0; LANES] };
        for (l, ((_, sequence), lane)) in group.sequences.iter().zip(lanes).enumerate() {
            if valid[l] && step <= group.steps[l] {
                match self.row(sequence.observation(step), lane) {
                    Some(row) => (rows[l], in_logs[l], scales.logs[l]) = row,
                    // The routine for one sequence finds the error again and reports its step.
                    None => valid[l] = false,
                }
            }
        }
        // Rows are packed as the sensors gave them, and checked by the range found on the way.
        let mut range = kernels::pack(rows, out);
        if in_logs != [false; LANES] {
            let largest = kernels::batch_exp(out, in_logs, &mut range);
            scales.logs.iter_mut().zip(largest).for_each(|(log, largest)| *log += largest);
        }
        for (l, valid) in valid.iter_mut().enumerate() {
            let mut tiny = range.tiny[l];
            scales.largest[l] = range.largest[l];
            // Negative likelihoods fail here. A NaN shows up later, in the sum of the step, even in
            // an impossible state, since 0 times NaN is NaN.
            *valid &= range.least[l] >= 0.0;
            if *valid && !UNSCALED.contains(&range.largest[l]) {
                *valid = scale(out, l, &mut scales, &mut tiny).is_some();
            }
            *valid &= !tiny || rounded;
        }
        scales
    }

    /// Returns the likelihoods of an observation, true if they are logarithms, and the logarithm of
    /// their common factor; `None` if they are not valid.
    fn row<'a>(
        &'a self,
        observation: &'a B::Observation,
        lane: &'a mut SensorScratch,
    ) -> Option<(&'a [f64], bool, f64)> {
        let diagonal = self.hmm.likelihood().diagonal(observation, &mut lane.scratch).ok()?;
        diagonal.check_shape(self.states()).ok()?;
        Some(match diagonal.values {
            Values::Linear(values) | Values::Checked { linear: values, .. } => {
                (values, false, diagonal.log_factor)
            }
            Values::Log(logs) => (logs, true, diagonal.log_factor),
        })
    }
}
/// Scales the likelihoods of a lane by a power of two so that the largest is near one. Returns
/// `None` if it is 0 or infinite.
#[cold]
fn scale(out: &mut [Packed], lane: usize, scales: &mut LaneScales, tiny: &mut bool) -> Option<()> {
    let largest = scales.largest[lane];
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    // Exact; clamped so that 2^-by is itself a double.
    let by = exponent(largest).clamp(-1000, 1000);
    let factor = power(-by);
    *tiny = false;
    for eight in out {
        let b = &mut eight[lane];
        *tiny |= *b > 0.0 && *b * factor < TINY;
        *b *= factor;
    }
    scales.largest[lane] = largest * factor;
    scales.logs[lane] += by as f64 * std::f64::consts::LN_2;
    Some(())
}
