//! Many sequences through one model in lock-step: eight at a time, one in each
//! lane of a vector, so that products with a stored matrix need no gathers and
//! its entries are read once for all eight.
//!
//! Doubles suffice for nearly all sequences. A lane in which they might not, or that
//! gives reason for an error, is marked, and its sequence is done by itself
//! afterwards: the general routine knows about logarithms and errors.

mod backward;
mod each;
mod filter;
mod forward;
mod learn;
mod score;
mod sense;
mod smooth;
mod viterbi;

use std::sync::OnceLock;

use crate::hmm::Hmm;
use crate::kernels::LANES;
use crate::kernels::lockstep::{Abreast, Lines};
use crate::likelihood::{Likelihood, Scratch};
use crate::sequence::Sequence;
use crate::transition::Transition;

pub(super) use each::{Room, Rows, each};
pub(super) use filter::filter;
pub(super) use learn::expect;
pub(super) use score::score;
pub(super) use smooth::smooth;
pub(super) use viterbi::viterbi;

/// Fewer sequences are faster one by one.
const FEWEST: usize = 4;
/// The same for learning, which gains more.
pub(super) const FEWEST_TO_LEARN: usize = 2;
/// Models of fewer states have routines of their own.
const FEWEST_STATES: usize = 9;
/// What a group may keep for its steps: 64 MB.
const MOST_KEPT: usize = (64 << 20) / size_of::<Abreast>();

/// A model whose matrix is stored, and has nothing so small that doubles need
/// more care.
pub(super) struct Plan<'m, A, B> {
    hmm: &'m Hmm<A, B>,
    rows: Lines<'m>,
    columns: Lines<'m>,
    /// The likelihoods of a sequence that has ended.
    ones: Vec<f64>,
    /// Their logarithms.
    zeros: Vec<f64>,
    /// Those of the rows, made when first decoded with.
    log2: OnceLock<Vec<f64>>,
}

impl<'m, A: Transition, B: Likelihood> Plan<'m, A, B> {
    /// `None` if the model does not allow for it.
    pub(super) fn new(hmm: &'m Hmm<A, B>) -> Option<Self> {
        let control = hmm.transition().no_control()?;
        hmm.transition().check_control(control).ok()?;
        if hmm.transition().evidence(control).is_some() {
            return None;
        }
        let (rows, columns) = hmm.transition().stored(control)?.plain_lines()?;
        let prior = hmm.prior().belief().as_slice();
        let tiny = |p: &f64| 0.0 < *p && *p < f64::MIN_POSITIVE;
        if prior.iter().any(tiny) {
            return None;
        }
        let (ones, zeros) = (vec![1.0; prior.len()], vec![0.0; prior.len()]);
        Some(Self { hmm, rows, columns, ones, zeros, log2: OnceLock::new() })
    }
}

/// Up to eight sequences.
pub(super) struct Group<'s, S> {
    sequences: &'s [(usize, &'s S)],
    /// How many steps they have; 0 for lanes without one.
    steps: [usize; LANES],
    longest: usize,
}

/// Memory for groups, kept from one to the next.
#[derive(Default)]
pub(super) struct Memory {
    /// Beliefs of steps 0 to T, or only the last one.
    alpha: Vec<Abreast>,
    /// Likelihoods of steps 1 to T, likewise.
    likelihoods: Vec<Abreast>,
    /// One over the normalisers of steps 1 to T.
    inverse: Vec<Abreast>,
    /// The belief, lifted, and the next.
    x: Vec<Abreast>,
    next: Vec<Abreast>,
    /// γ / α and γ / p, lifted, and γ.
    q: Vec<Abreast>,
    ratio: Vec<Abreast>,
    gamma: Vec<Abreast>,
    lanes: [Lane; LANES],
}

/// What each lane has for itself.
#[derive(Default)]
struct Lane {
    scratch: Scratch,
    values: Vec<f64>,
}

/// What a routine gives for each lane; `None` where the sequence has to be done by
/// itself.
pub(super) type Outcome<R> = [Option<R>; LANES];

/// Does something with each item, in parallel with the feature `rayon`.
pub(super) fn in_parallel<T: Send, R: Send>(
    items: Vec<T>,
    work: impl Fn(T, &mut Memory) -> R + Sync,
) -> Vec<R> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        items.into_par_iter().map_init(Memory::default, |memory, item| work(item, memory)).collect()
    }
    #[cfg(not(feature = "rayon"))]
    {
        let mut memory = Memory::default();
        items.into_iter().map(|item| work(item, &mut memory)).collect()
    }
}

impl<'s, S> Group<'s, S> {
    pub(super) fn new<U, Y: ?Sized>(sequences: &'s [(usize, &'s S)]) -> Self
    where
        S: Sequence<U, Y>,
    {
        let mut steps = [0; LANES];
        steps.iter_mut().zip(sequences).for_each(|(steps, (_, s))| *steps = s.steps());
        let longest = steps.iter().copied().max().unwrap_or(0);
        Self { sequences, steps, longest }
    }

    /// Whether to go through it in lock-step.
    pub(super) fn pays(&self, states: usize, fewest: usize) -> bool {
        let kept = states.saturating_mul(2).saturating_mul(self.longest);
        self.sequences.len() >= fewest && kept <= MOST_KEPT
    }

    /// Which lanes have something to do.
    fn lanes(&self) -> [bool; LANES] {
        self.steps.map(|steps| steps > 0)
    }
}
