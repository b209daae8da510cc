//! Many sequences through one model, eight at a time, one in each lane of a vector: products with
//! a stored matrix need no gathers, and its entries are read once for all eight.
//!
//! The recursions are those of one sequence (sections 2, 3, 7 and 9 of the
//! [formulas](crate::guide::formulas)), in linear space with lifted beliefs, which suffices for
//! nearly all sequences (`limits`, "In lanes"). A lane in which it might not suffice, or that gives
//! reason for an error, becomes invalid for good, and its sequence is taken by itself afterwards:
//! the routine for one sequence knows about logarithms and errors. No lane reads what another has
//! written, so that a result does not depend on the other sequences of the group.
//!
//! One long sequence fills the lanes with segments of its own, if the model forgets ([`segments`]).

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

/// A model whose matrix is stored, without entries so small that linear space needs more care.
pub(crate) struct LaneModel<'m, A, B> {
    hmm: &'m Hmm<A, B>,
    rows: Lines<'m>,
    columns: Lines<'m>,
    /// Likelihoods of a sequence that has ended, and their logarithms.
    ones: Vec<f64>,
    zeros: Vec<f64>,
    /// Logarithms of the rows, made by the first decoding.
    log2: OnceLock<Vec<f64>>,
}

impl<'m, A: Transition, B: Likelihood> LaneModel<'m, A, B> {
    /// `None` if the model is not for lanes.
    pub(crate) fn new(hmm: &'m Hmm<A, B>) -> Option<Self> {
        let control = hmm.transition().no_control()?;
        hmm.transition().check_control(control).ok()?;
        if hmm.transition().evidence(control).is_some() {
            return None;
        }
        // No entry is below `LEAST_ENTRY`: with normal beliefs and likelihoods of at least `TINY`,
        // no product then becomes 0 unseen.
        let (rows, columns) =
            hmm.transition().stored(control).filter(|matrix| matrix.is_plain())?.lines()?;
        // A prior that is not normal could make a lifted product 0 unseen.
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
    /// True if the group runs in lanes, as the plan says; otherwise its sequences run one by one.
    pub(crate) in_lanes: bool,
}

impl<'s, S> Group<'s, S> {
    /// Creates a group, and asks the plan whether so many sequences, the longest of so many steps,
    /// run in lanes.
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

    /// Lanes with a step to take. An empty sequence is taken by itself.
    fn lanes(&self) -> [bool; LANES] {
        self.steps.map(|steps| steps > 0)
    }
}

/// Memory for groups, kept from one to the next.
#[derive(Default)]
pub(crate) struct LaneMemory {
    /// Beliefs of steps 0 to T, or only the last one.
    beliefs: Vec<Packed>,
    /// Likelihoods of steps 1 to T, likewise.
    likelihoods: Vec<Packed>,
    /// One over the normalisers of steps 1 to T.
    inverse: Vec<Packed>,
    /// Belief, lifted, or scores; and the next.
    x: Vec<Packed>,
    next: Vec<Packed>,
    /// γ / α and γ / p, lifted.
    q: Vec<Packed>,
    ratio: Vec<Packed>,
    backpointers: Vec<[u32; LANES]>,
    lanes: [Workspace; LANES],
}

impl LaneMemory {
    /// Makes room for beliefs and likelihoods of `stored` steps, and for `steps` normalisers. What
    /// earlier groups left in it is not cleared: a routine writes before it reads.
    fn fit(&mut self, states: usize, stored: usize, steps: usize) {
        let grow = |room: &mut Vec<Packed>, count: usize| {
            if room.len() < count {
                room.resize(count, Packed::default());
            }
        };
        // Whole blocks of eight rows are unpacked, beyond the last row too.
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

    /// Prepares the way back. A lane whose sequence is shorter than the longest begins later, from
    /// these zeros: 0 times an infinity that an earlier group left would be NaN.
    fn begin_back(&mut self) {
        self.q.fill(Packed::default());
    }
}
