//! Many sequences through one model, eight at a time, one in each lane of a vector: products with
//! a stored matrix need no gathers, and its entries are read once for all eight.
//!
//! Linear space suffices for nearly all sequences. A lane in which it might not, or that gives
//! reason for an error, is marked, and its sequence is processed by itself afterwards: the general
//! routine knows about logarithms and errors.

mod backward;
mod each;
mod forward;
mod learn;
mod likelihoods;
mod viterbi;

use std::sync::OnceLock;

use super::choice::{self, Engine};
use crate::hmm::Hmm;
use crate::kernels::{LANES, Lines, Packed};
use crate::likelihood::{Likelihood, Scratch};
use crate::sequence::Sequence;
use crate::transition::Transition;

pub(crate) use backward::smooth;
pub(crate) use each::{GroupRows, Room, Routine, each};
pub(crate) use forward::{filter, log_likelihood};
pub(crate) use learn::expect;
pub(crate) use viterbi::viterbi;

/// A model whose matrix is stored, without entries so small that linear space needs more care.
pub(crate) struct BatchModel<'m, A, B> {
    hmm: &'m Hmm<A, B>,
    rows: Lines<'m>,
    columns: Lines<'m>,
    /// Likelihoods of a sequence that has ended, and their logarithms.
    ones: Vec<f64>,
    zeros: Vec<f64>,
    /// Logarithms of the rows, made by the first decoding.
    log2: OnceLock<Vec<f64>>,
}

impl<'m, A: Transition, B: Likelihood> BatchModel<'m, A, B> {
    /// `None` if the model is not for lanes.
    pub(crate) fn new(hmm: &'m Hmm<A, B>) -> Option<Self> {
        let control = hmm.transition().no_control()?;
        hmm.transition().check_control(control).ok()?;
        if hmm.transition().evidence(control).is_some() {
            return None;
        }
        let (rows, columns) = hmm.transition().stored(control)?.plain_lines()?;
        let prior = hmm.prior().belief().as_slice();
        if prior.iter().any(|p| 0.0 < *p && *p < f64::MIN_POSITIVE) {
            return None;
        }
        let (ones, zeros) = (vec![1.0; prior.len()], vec![0.0; prior.len()]);
        Some(Self { hmm, rows, columns, ones, zeros, log2: OnceLock::new() })
    }
}

/// Up to eight sequences, with their numbers.
pub(crate) struct Group<'s, S> {
    sequences: &'s [(usize, &'s S)],
    /// Number of steps; 0 for lanes without a sequence.
    steps: [usize; LANES],
    longest: usize,
}

/// Memory for groups, kept from one to the next.
#[derive(Default)]
pub(crate) struct BatchMemory {
    /// Beliefs of steps 0 to T, or only the last one.
    alpha: Vec<Packed>,
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
    from: Vec<[u32; LANES]>,
    lanes: [Lane; LANES],
}

/// Memory of a lane.
#[derive(Default)]
pub(crate) struct Lane {
    scratch: Scratch,
    values: Vec<f64>,
}

/// Results of the lanes; `None` where the sequence has to be processed by itself.
pub(crate) type Outcome<R> = [Option<R>; LANES];

impl BatchMemory {
    /// Makes room for `kept` steps of beliefs and likelihoods, and for `steps` normalisers.
    fn fit(&mut self, states: usize, kept: usize, steps: usize) {
        let grow = |room: &mut Vec<Packed>, count: usize| {
            if room.len() < count {
                room.resize(count, Packed::default());
            }
        };
        grow(&mut self.alpha, (states * (kept + 1)).next_multiple_of(LANES));
        grow(&mut self.likelihoods, states * kept.max(1));
        grow(&mut self.inverse, steps);
        for room in [&mut self.x, &mut self.next, &mut self.q, &mut self.ratio] {
            room.resize(states, Packed::default());
        }
    }
}

impl<'s, S> Group<'s, S> {
    pub(crate) fn new<U, Y: ?Sized>(sequences: &'s [(usize, &'s S)]) -> Self
    where
        S: Sequence<U, Y>,
    {
        let mut steps = [0; LANES];
        steps.iter_mut().zip(sequences).for_each(|(steps, (_, s))| *steps = s.steps());
        let longest = steps.iter().copied().max().unwrap_or(0);
        Self { sequences, steps, longest }
    }

    /// Returns true if the group is for lanes, by the engine of so many sequences.
    pub(crate) fn is_in_lanes(&self, states: usize, engine: fn(usize, usize) -> Engine) -> bool {
        let engine = engine(self.sequences.len(), states);
        choice::for_group(engine, states, self.longest) == Engine::Lanes
    }

    /// Lanes that have a step.
    fn lanes(&self) -> [bool; LANES] {
        self.steps.map(|steps| steps > 0)
    }
}
