//! Many sequences through one model, eight at a time, one in each lane of a vector: products with
//! a stored matrix need no gathers, and its entries are read once for all eight.
//!
//! The recursions are those of one sequence (sections 2, 3, 7 and 9 of the
//! [formulas](crate::guide::formulas)), in linear space with lifted beliefs, which is sufficient
//! for nearly all sequences (`limits`, "In lanes"). A lane for which it might not be, or that would
//! cause an error, becomes invalid for good, and its sequence runs by itself afterwards: the
//! routine for one sequence can use logarithms, and reports errors. No lane reads what another has
//! written, so that a result does not depend on the other sequences of the group.
//!
//! One long sequence can fill all lanes with its own segments, if the model forgets ([`segments`]).

mod chunks;
mod cut;
mod expectations;
mod forward_backward;
mod segments;
mod smooth_long;
mod verified;
mod viterbi;

use std::sync::OnceLock;

use crate::hmm::Hmm;
use crate::inference::step::Workspace;
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;
use wayfix_kernels::limits::LIFT;
use wayfix_kernels::{LANES, Lines, Packed};

pub(crate) use chunks::{LaneRoutine, SharedRows, collect_all, visit_all};
pub(crate) use expectations::LaneExpectations;
pub(crate) use smooth_long::smooth;

/// A model with a stored matrix, whose entries are large enough for linear space.
pub(crate) struct LaneModel<'m, A, B> {
    hmm: &'m Hmm<A, B>,
    rows: Lines<'m>,
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
        let control = hmm.transition().no_control()?;
        hmm.transition().check_control(control).ok()?;
        if hmm.transition().evidence(control).is_some() {
            return None;
        }
        // No entry is below `LEAST_ENTRY`. With normal beliefs and likelihoods of at least `TINY`,
        // no product then becomes 0 unnoticed.
        let (rows, columns) =
            hmm.transition().stored(control).filter(|matrix| matrix.is_plain())?.lines();
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
    longest: usize,
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
pub(crate) struct LaneMemory {
    /// Beliefs of steps 0 to T, or only the last one.
    beliefs: Vec<Packed>,
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
    lanes: [Workspace; LANES],
}

impl LaneMemory {
    /// Makes room for beliefs and likelihoods of `stored` steps, and for `steps` normalisers.
    /// Values left by earlier groups are not cleared: routines write before they read.
    fn fit(&mut self, states: usize, stored: usize, steps: usize) {
        let grow = |room: &mut Vec<Packed>, count: usize| {
            if room.len() < count {
                room.resize(count, Packed::default());
            }
        };
        // `unpack_rows` reads whole blocks of eight, beyond the last row too.
        grow(&mut self.beliefs, (states * (stored + 1)).next_multiple_of(LANES));
        grow(&mut self.likelihoods, states * stored.max(1));
        grow(&mut self.inverse, steps);
        for room in [&mut self.x, &mut self.next, &mut self.q, &mut self.ratio] {
            room.resize(states, Packed::default());
        }
    }

    /// Sets the belief from which a lane starts.
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
