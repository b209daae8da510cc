//! The streaming filter for very large maps: it follows the places that matter,
//! and proves how far it is from the exact one.

mod envelope;

use std::mem;
use std::ops::{Deref, RangeInclusive};

use super::LogSum;
use super::frontier::Frontier;
use super::step::is_one;
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::likelihood::{LocalLikelihood, Scratch};
use crate::transition::TransitionEntries;
use envelope::{Envelope, Rows, Weights};

/// How much a [`PrunedFilter`] may leave out.
///
/// ```
/// use wayfix::Pruning;
///
/// let pruning = Pruning { tolerance: 1e-9, ..Pruning::default() };
/// assert_eq!(pruning.most_active, usize::MAX);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pruning {
    /// How far the belief may be from the exact one, in total variation; 1e-6
    /// unless changed. At 0 (or less, or NaN) nothing is left out that a double
    /// holds.
    pub tolerance: f64,
    /// How many states may be followed at most, whatever that costs in certainty;
    /// any number unless changed. It bounds the time of a step.
    pub most_active: usize,
}

impl Default for Pruning {
    fn default() -> Self {
        Self { tolerance: 1e-6, most_active: usize::MAX }
    }
}

/// What is proven of a pruned belief: how far it is at most from the exact one,
/// in total variation, and whether that is within the tolerance.
///
/// The total variation is the most by which the probability of any event can be
/// wrong: half the sum of all differences.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use = "the bound may be above the tolerance"]
pub enum Certificate {
    /// The bound, which is at most the tolerance.
    Held(f64),
    /// The bound, which is above the tolerance. The belief is still the best
    /// guess, and the bound may come back.
    Exceeded(f64),
}

impl Certificate {
    /// The bound, from 0 to 1.
    #[must_use]
    pub fn bound(self) -> f64 {
        let (Self::Held(bound) | Self::Exceeded(bound)) = self;
        bound
    }

    /// Whether the bound is at most the tolerance.
    #[must_use]
    pub fn holds(self) -> bool {
        matches!(self, Self::Held(_))
    }
}

/// The part of the tolerance that a step may drop, at first.
const FIRST_SHARE: f64 = 1e-8;
/// Its limits.
const LEAST_SHARE: f64 = 1e-30;
const LARGEST_SHARE: f64 = 1e-8;

/// A streaming filter that follows only the states that matter, and proves a
/// bound on its distance from the exact belief.
#[derive(Debug, Clone)]
pub struct PrunedFilter<M> {
    model: M,
    pruning: Pruning,
    rows: Rows,
    steps: usize,
    belief: Envelope,
    bound: f64,
    /// ln p(y_1 … y_k) is at least `log`, and at most that and `log_excess`, but
    /// for what the deficit is.
    log: LogSum,
    log_excess: LogSum,
    /// The part of the tolerance that a step may drop.
    share: f64,
    next: Envelope,
    frontier: Frontier,
    wanted: Vec<usize>,
    values: Vec<f64>,
    scratch: Scratch,
}

/// # Streams
impl<A: TransitionEntries<Control = ()>, B: LocalLikelihood> Hmm<A, B> {
    /// A streaming filter for very large models, which follows only the states
    /// that matter; it borrows the model.
    #[must_use]
    pub fn pruned_filter(&self, pruning: Pruning) -> PrunedFilter<&Self> {
        PrunedFilter::new(self, pruning)
    }
}

impl<M, A, B> PrunedFilter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries<Control = ()>,
    B: LocalLikelihood,
{
    /// A filter at the prior. O(n + E), to look through the entries once.
    #[must_use]
    pub fn new(model: M, pruning: Pruning) -> Self {
        let mut filter = Self {
            pruning,
            rows: Rows::of(model.transition()),
            steps: 0,
            belief: Envelope::default(),
            bound: 0.0,
            log: LogSum::default(),
            log_excess: LogSum::default(),
            share: FIRST_SHARE,
            next: Envelope::default(),
            frontier: Frontier::new(model.states()),
            wanted: Vec::new(),
            values: Vec::new(),
            scratch: Scratch::default(),
            model,
        };
        filter.restart();
        filter
    }

    /// Back to the prior, with no steps taken. O(n).
    pub fn restart(&mut self) {
        let Self { model, belief, next, frontier, .. } = self;
        next.start(model.prior().belief().as_slice());
        frontier.follow(&belief.states, &next.states);
        mem::swap(belief, next);
        (self.steps, self.share) = (0, FIRST_SHARE);
        (self.log, self.log_excess) = (LogSum::default(), LogSum::default());
        self.bound = 0.0;
    }

    /// One time step: prediction, then update with `observation`.
    ///
    /// # Errors
    ///
    /// x
    pub fn step(&mut self, observation: &B::Observation) -> Result<Certificate, InferenceError> {
        let number = self.steps + 1;
        self.advance(number, self.model.prior().moves_at(number), Some(observation))
    }

    /// Prediction alone: one time step without an observation.
    ///
    /// # Errors
    ///
    /// x
    pub fn predict(&mut self) -> Result<Certificate, InferenceError> {
        let number = self.steps + 1;
        self.advance(number, self.model.prior().moves_at(number), None)
    }

    /// What is proven of the present belief.
    pub fn certificate(&self) -> Certificate {
        let held = self.bound <= self.pruning.tolerance;
        if held { Certificate::Held(self.bound) } else { Certificate::Exceeded(self.bound) }
    }

    /// The states that are followed, in ascending order.
    #[must_use]
    pub fn active(&self) -> &[usize] {
        &self.belief.states
    }

    /// The probabilities of the states that are followed, in the same order; they
    /// sum to one.
    #[must_use]
    pub fn probabilities(&self) -> &[f64] {
        &self.belief.estimate
    }

    /// The most probable state; of several, the lowest. O(active states).
    #[must_use]
    pub fn mode(&self) -> usize {
        let mut best = (0, f64::NEG_INFINITY);
        for (&state, &p) in self.belief.states.iter().zip(&self.belief.estimate) {
            if p > best.1 {
                best = (state, p);
            }
        }
        best.0
    }

    /// The probability of one state, 0 if it is not followed, or `None` if there
    /// is no such state.
    #[must_use]
    pub fn probability(&self, state: usize) -> Option<f64> {
        let followed = || self.frontier.place(state).map_or(0.0, |at| self.belief.estimate[at]);
        (state < self.model.states()).then(followed)
    }

    /// Between what ln p(y_1 … y_k) lies, over the observations made.
    #[must_use]
    pub fn log_likelihood(&self) -> RangeInclusive<f64> {
        if !self.belief.is_known() {
            return f64::NEG_INFINITY..=f64::INFINITY;
        }
        let low = self.log.value();
        low..=low + self.log_excess.value() + self.belief.deficit().ln_1p()
    }

    /// How many steps have been taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    fn advance(
        &mut self,
        number: usize,
        moves: bool,
        observation: Option<&B::Observation>,
    ) -> Result<Certificate, InferenceError> {
        let Self { model, belief, next, frontier, wanted, values, scratch, .. } = self;
        let transition = moves.then(|| (model.transition(), self.rows));
        wanted.clear();
        if let Some(observation) = observation.filter(|_| belief.is_open()) {
            model.likelihood().standing_out(observation, wanted);
        }
        frontier.list(&belief.states, transition.map(|part| (part.0, &())), wanted);
        let candidates = frontier.candidates();
        values.clear();
        values.resize(candidates.len(), 1.0);
        let (mut others, mut log_factor) = (1.0, 0.0);
        if let Some(observation) = observation {
            let wrap = |source| InferenceError::Likelihood { step: number, source };
            let local = model.likelihood().local(observation, candidates, values, scratch);
            let unlisted = local.map_err(wrap)?;
            let largest = unlisted.check(candidates, values).map_err(wrap)?;
            others = unlisted.largest();
            log_factor = unlisted.log_factor();
            if largest > 0.0 && !(2f64.powi(-16)..=2f64.powi(16)).contains(&largest) {
                values.iter_mut().for_each(|b| *b /= largest);
                others /= largest;
                log_factor += largest.ln();
            }
        }
        let weights = Weights { listed: values, others };
        let raw = next.advance(belief, transition, frontier, &weights);
        if !is_one(raw.predicted) {
            return Err(InferenceError::PredictedSum { step: number, sum: raw.predicted });
        }
        if raw.estimate < f64::MIN_POSITIVE {
            let proven = raw.excess == 0.0;
            return Err(if proven {
                InferenceError::Impossible { step: number }
            } else {
                InferenceError::Pruned { step: number }
            });
        }
        let each = self.pruning.tolerance.max(0.0) * self.share / candidates.len() as f64;
        let log = next.settle(&raw, each.clamp(1e-290, 1e-3), self.pruning.most_active.max(1));
        let (rescaled, unknown) = next.rebase();
        frontier.follow(&belief.states, &next.states);
        mem::swap(belief, next);
        self.steps = number;
        self.log.add(log + log_factor);
        self.log.add(rescaled);
        self.log_excess.add(unknown);
        self.bound = self.belief.bound();
        self.adapt();
        Ok(self.certificate())
    }

    /// Drops less where the bound nears the tolerance, and slowly more where it is
    /// far from it.
    fn adapt(&mut self) {
        let used = self.bound / self.pruning.tolerance;
        let factor = if used > 1e-3 { 0.1 } else { 1.01 };
        self.share = (self.share * factor).clamp(LEAST_SHARE, LARGEST_SHARE);
    }
}
