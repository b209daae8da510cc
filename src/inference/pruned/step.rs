//! Steps of the pruned filter: prediction, update, pruning (section 13 of the
//! [formulas](crate::guide::formulas)).
//!
//! Each part keeps the bounds of the [`Envelope`](super::Envelope) valid. Dropping a state moves
//! its upper bound to that of the inactive states.

use std::mem;
use std::ops::Deref;

use super::active_set::ActiveSet;
use super::envelope::{Envelope, LEAST_KEPT};
use super::exact::Exact;
use super::moves::Moves;
use super::weights::Weights;
use super::wide::Wide;
use super::{Certificate, PrunedFilter, PrunedFilterSnapshot};
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::step::state::next_step;
use crate::likelihood::{Diagonal, LocalLikelihood, Scratch, check_local};
use crate::transition::{NoControl, TransitionEntries};
use wayfix_kernels::limits;

/// Initial and largest share of the tolerance that a step may drop. It is this small because an
/// observation that contradicts the belief multiplies the dropped mass, and because a tenth of the
/// share needs hardly more states.
pub(crate) const LARGEST_SHARE: f64 = 1e-8;
/// Sums of predictions with evidence in linear form. Within this range, lifted and weighted values
/// stay within `f64`.
const SUMS: std::ops::RangeInclusive<f64> = 1e-100..=1e30;
/// Smallest share of the tolerance that a step may drop.
pub(crate) const LEAST_SHARE: f64 = 1e-30;
/// Share of the tolerance above which the bound makes steps drop less.
const NEAR: f64 = 1e-3;
/// Factors on the share from one step to the next: if the bound is above [`NEAR`], and otherwise.
const LESS: f64 = 0.1;
const MORE: f64 = 1.01;

/// Memory of steps, and the index of the active states.
#[derive(Debug, Clone)]
pub(super) struct PrunedScratch {
    pub(super) next: Envelope,
    /// Index of the active states of the present belief.
    pub(super) active_set: ActiveSet,
    exact: Exact,
    wide: Wide,
    wanted: Vec<usize>,
    values: Vec<f64>,
    sensor: Scratch,
}

impl PrunedScratch {
    pub(super) fn new(states: usize) -> Self {
        Self {
            next: Envelope::default(),
            active_set: ActiveSet::new(states),
            exact: Exact::default(),
            wide: Wide::default(),
            wanted: Vec::new(),
            values: Vec::new(),
            sensor: Scratch::default(),
        }
    }

    /// Replaces a state by another whose belief is in `next`. The memory of the old belief becomes
    /// that of `next`.
    pub(super) fn replace(
        &mut self,
        state: &mut PrunedFilterSnapshot,
        other: &PrunedFilterSnapshot,
    ) {
        self.exact.forget();
        // Touches only the states of both beliefs: the index of n entries is never cleared.
        self.active_set.follow(&state.belief.states, &self.next.states);
        mem::swap(&mut state.belief, &mut self.next);
        let belief = mem::take(&mut state.belief);
        *state = PrunedFilterSnapshot { belief, ..*other };
    }
}

impl<M, A, B> PrunedFilter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: LocalLikelihood,
{
    /// Takes one time step: prediction under `control`, then update with `observation`. Returns
    /// the certificate of the belief.
    ///
    /// Under [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) the first step has
    /// no transition, and its control is ignored.
    ///
    /// With [evidence on the move](crate::Transition::evidence), a step takes O(E) once something
    /// has been dropped, for bounds on its entries; it is then no faster than that of a
    /// [`Filter`](crate::Filter).
    ///
    /// # Errors
    ///
    /// [`InferenceError`] with the step; the filter is then unchanged.
    /// [`Impossible`](InferenceError::Impossible) if the model rules out the observation,
    /// [`Pruned`](InferenceError::Pruned) if it is ruled out in all active states, but perhaps
    /// not in one that was dropped.
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<Certificate, InferenceError> {
        let number = next_step(self.state.steps)?;
        let control = Some(control).filter(|_| self.model.prior().moves_at(number));
        self.advance(number, control, Some(observation))
    }

    /// Predicts under `control` alone: one time step without an observation. The log-likelihood
    /// does not change, except by evidence on the move.
    ///
    /// # Errors
    ///
    /// [`InferenceError`] if the operator does not give a distribution, or if the control
    /// is not valid.
    pub fn predict_with(&mut self, control: &A::Control) -> Result<Certificate, InferenceError> {
        let number = next_step(self.state.steps)?;
        let control = Some(control).filter(|_| self.model.prior().moves_at(number));
        self.advance(number, control, None)
    }

    /// Updates with an observation alone, without a time step: for another sensor at the same
    /// step, or after [`predict_with`](Self::predict_with). Returns the certificate of the
    /// belief.
    ///
    /// Before any step this is an observation of X_0, and errors name step 0; but under
    /// [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) it takes step 1.
    ///
    /// # Errors
    ///
    /// As [`step_with`](Self::step_with).
    pub fn update(&mut self, observation: &B::Observation) -> Result<Certificate, InferenceError> {
        let at_first = !self.model.prior().moves_at(1);
        let number = self.state.steps.max(usize::from(at_first));
        self.advance(number, None, Some(observation))
    }

    /// Takes one time step: prediction, then update with `observation`. Returns the certificate
    /// of the belief.
    ///
    /// # Errors
    ///
    /// As [`step_with`](Self::step_with).
    pub fn step(&mut self, observation: &B::Observation) -> Result<Certificate, InferenceError>
    where
        A::Control: NoControl,
    {
        self.step_with(&A::Control::NONE, observation)
    }

    /// Predicts alone: one time step without an observation. The log-likelihood does not change.
    ///
    /// # Errors
    ///
    /// As [`predict_with`](Self::predict_with).
    pub fn predict(&mut self) -> Result<Certificate, InferenceError>
    where
        A::Control: NoControl,
    {
        self.predict_with(&A::Control::NONE)
    }

    /// Takes a step. Only its last part changes the filter, so that an error leaves it unchanged.
    pub(crate) fn advance(
        &mut self,
        number: usize,
        control: Option<&A::Control>,
        observation: Option<&B::Observation>,
    ) -> Result<Certificate, InferenceError> {
        let Self { model, bounds, state, scratch } = self;
        let PrunedScratch { next, active_set, exact, wide, wanted, values, sensor } = scratch;
        let step = Step { hmm: &**model, number, control };
        if exact.advance(&step, observation, bounds.as_ref(), state, active_set) {
            state.adapt();
            return Ok(state.certificate());
        }
        let evidence = step.evidence()?;
        let PrunedFilterSnapshot { belief, .. } = state;
        wanted.clear();
        // States that the sensor names matter only if inactive states may have mass.
        if let Some(observation) = observation.filter(|_| belief.is_open()) {
            model.likelihood().listed_states(observation, wanted);
        }
        let operator = control.map(|control| (model.transition(), control));
        let is_wide = Wide::is_for(belief, model.transition(), control, bounds.as_ref());
        // Candidates first, likelihoods second: the sensor is asked only about states that can
        // matter.
        match operator {
            Some(operator) if is_wide => wide.predict(belief, operator, wanted, active_set),
            _ => active_set.list(&belief.states, operator, wanted),
        }
        let candidates = active_set.candidates();
        values.clear();
        let (mut local, mut others, mut largest) = (Diagonal::linear(&[]), 1.0, 1.0);
        if let Some(observation) = observation {
            let wrap = |cause| InferenceError::likelihood(number, cause);
            let found = model.likelihood().local(observation, candidates, sensor);
            (local, others) = found.map_err(wrap)?;
            largest = check_local(&local, others, candidates).map_err(wrap)?;
            values.extend_from_slice(local.as_slice());
        } else {
            values.resize(candidates.len(), 1.0);
        }
        let is_open = belief.is_open();
        let mut moves = control.map(|control| {
            Moves::new(model.transition(), control, evidence, *bounds, (&belief.states, is_open))
        });
        // The bounds for an open belief come from all entries: a column bound of 0 means that there
        // are no entries above 0.
        let nothing = |moves: &Moves<'_, A>| {
            if is_open { moves.bounds.column == 0.0 } else { candidates.is_empty() }
        };
        if evidence.is_some() && moves.as_ref().is_some_and(nothing) && local.is_possible(largest) {
            return Err(InferenceError::ImpossibleMove { step: number });
        }
        let mut predicted = if is_wide {
            next.predict_by(belief, moves.as_ref(), active_set, wide.sums(moves.as_ref()))
        } else {
            next.predict(belief, moves.as_ref(), active_set)
        };
        if evidence.is_none() {
            // A sum other than one means that the operator did not list some states that its
            // entries lead to: it breaks its contract.
            if !limits::is_one(predicted.sum) {
                return Err(InferenceError::PredictedSum { step: number, sum: predicted.sum });
            }
        } else if !SUMS.contains(&predicted.sum)
            && moves.as_ref().is_some_and(|moves| !moves.is_in_powers_of_two())
        {
            // Again with the scale of the evidence taken out of the entries.
            moves = moves.map(|moves| moves.in_powers_of_two(&belief.states, is_open));
            predicted = next.predict(belief, moves.as_ref(), active_set);
        }
        if !(0.0..=f64::MAX).contains(&predicted.sum) {
            return Err(InferenceError::PredictedSum { step: number, sum: predicted.sum });
        }
        // Scaled by the states that the belief leads to, not by all: these must keep their digits,
        // whereas bounds suffice for the others.
        let log_factor = moves.map_or(0.0, |moves| moves.log_factor());
        let likely = values.iter().zip(&next.estimate).filter(|entry| *entry.1 > 0.0);
        let none = if local.is_log() { f64::NEG_INFINITY } else { 0.0 };
        let likely = likely.map(|b| *b.0).fold(none, f64::max);
        let weights = Weights::new(&local, others, largest, likely);
        let raw = next.weigh(predicted, values, &weights);
        // No active state explains the observation. Without any excess that is exact; with some, a
        // state that was dropped might explain it.
        if raw.estimate < f64::MIN_POSITIVE {
            let proven = raw.excess == 0.0;
            return Err(if proven {
                InferenceError::Impossible { step: number }
            } else {
                InferenceError::Pruned { step: number }
            });
        }
        let threshold = state.threshold(candidates.len());
        let PrunedFilterSnapshot { pruning, belief, .. } = state;
        let log = next.settle(&raw, threshold, pruning.most_active.max(1), values);
        let (rescaled, unknown) = next.rebase();
        // Commit: nothing can fail from here.
        exact.forget();
        active_set.follow(&belief.states, &next.states);
        mem::swap(belief, next);
        state.steps = number;
        state.log.add(log + weights.log_factor + log_factor);
        state.log.add(rescaled);
        state.log_excess.add(unknown);
        // Sums that have become infinite stay so; their compensation is NaN then, and cleared.
        (state.log, state.log_excess) = (state.log.known(), state.log_excess.known());
        state.log_lost |= !state.belief.is_known();
        state.bound = state.belief.bound();
        state.adapt();
        Ok(state.certificate())
    }
}

impl PrunedFilterSnapshot {
    /// Returns the probability up to which a step with this number of candidates drops states. It
    /// is below the mean of the candidates, so that the most probable one is kept.
    pub(super) fn threshold(&self, candidates: usize) -> f64 {
        let count = candidates as f64;
        let threshold = self.pruning.tolerance.max(0.0) * self.share / count;
        threshold.clamp(LEAST_KEPT, 0.5 / count)
    }

    /// Adapts the share: less if the bound is near the tolerance, slowly more if it is far below.
    fn adapt(&mut self) {
        let used = self.bound / self.pruning.tolerance;
        // Down fast and up slowly: one observation that contradicts the belief may multiply the
        // mass that was dropped.
        let factor = if used > NEAR { LESS } else { MORE };
        self.share = (self.share * factor).clamp(LEAST_SHARE, LARGEST_SHARE);
    }
}
