//! Streaming filter for very large maps: follows only the active states, and proves a bound on its
//! distance from the exact filter (section 13 of the [formulas](crate::guide::formulas)).
//!
//! The invariant is that of [`Envelope`]: lower and upper bounds on the exact belief, up to one
//! common factor. Each part of a step keeps them valid: prediction, update, pruning. Dropping a
//! state operator its upper bound to that of the inactive states.
//!
//! Underflow is handled differently than by [`limits`](wayfix_kernels::limits). There is one form
//! only: products are always lifted, by 2^900 instead of 2^1000, since upper bounds may be far
//! above one. A loss does not lead to a step in logarithms but is counted: every number that may
//! have lost digits, or has become 0, adds more than the loss to its bound. So no state needs a
//! logarithm, and if nothing is known of a belief, its bound says so. Entries beyond doubles, for
//! which an exact filter uses logarithms, are used as powers of two with a common one taken out.

pub(crate) mod active_set;
pub(crate) mod beam;
mod envelope;
mod operator;
pub(crate) mod snapshot;
mod wide;

use std::mem;
use std::ops::{Deref, RangeInclusive};

use self::active_set::ActiveSet;
use self::envelope::{Envelope, LikelihoodScale};
use self::operator::{Bounds, StepOperator};
use self::wide::{Exact, Wide};
use super::step::Step;
use super::step::state::next_step;
use crate::belief::Belief;
use crate::error::HmmError;
use crate::hmm::{Hmm, ModelPointer};
use crate::likelihood::{Diagonal, LocalLikelihood, Scratch, check_local};
use crate::transition::{NoControl, TransitionEntries};
use wayfix_kernels::limits;

pub use self::snapshot::{Certificate, PrunedFilterSnapshot, Pruning};

/// Streaming filter for very large models, which follows only an active set of states. After every
/// step it proves a bound on the total variation between its belief and that of the exact
/// [`Filter`](crate::Filter).
///
/// A step costs O(entries into and out of the active states and the states that the sensor names),
/// regardless of n: about as much on a map of ten million places as on one of thirty thousand. It
/// allocates nothing unless the active set is larger than ever before. Memory: 4 n bytes and n bits
/// to know which states are active, and some 80 bytes for each active state, at their largest
/// number so far.
///
/// ```
/// use wayfix::inference::Pruning;
/// use wayfix::likelihood::SparseObservation;
/// use wayfix::{Belief, Hmm, Prior, SparseLikelihood, SparseTransition};
///
/// // A loop of a hundred thousand places: stay, or move on by one.
/// let n = 100_000;
/// let operator = (0..n).flat_map(|j| [(j, j, 0.5), ((j + 1) % n, j, 0.5)]);
/// let motion = SparseTransition::from_triplets(n, operator)?;
/// let prior = Prior::AtFirstObservation(Belief::certain(n, 7)?);
/// let hmm = Hmm::new(prior, motion, SparseLikelihood::new(n))?;
///
/// let mut filter = hmm.pruned_filter(Pruning::default().with_tolerance(1e-6));
/// for place in [7, 8, 8, 90_000, 9] {
///     // A camera that is right nine times out of ten.
///     let seen = SparseObservation::new(vec![(place, 0.9)], 0.1 / n as f64)?;
///     let certificate = filter.step(&seen)?;
///     assert!(certificate.holds() && certificate.bound() <= 1e-6);
/// }
/// assert_eq!(filter.mode(), 9);
/// assert!(filter.active().len() < 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Pruning and the bound
///
/// States whose probability after a step is below a small part of the tolerance are dropped, and
/// counted: upper bounds on the mass that was dropped, or stems from dropped mass, are kept for
/// each active state and for all others together. The bound is their sum and includes rounding;
/// section 13 of the [formulas](crate::guide::formulas) proves it. As the bound approaches the
/// tolerance, less is dropped and more states are active.
///
/// The bound depends on the sensor's own bound for the states that it is not asked about
/// ([`LocalLikelihood`]). It falls while observations speak against those states, and recovers
/// after a period of doubt as soon as most of the belief is in one state. If it cannot be kept
/// within the tolerance, as under [`Pruning::most_active`] or when a vehicle turns up where no path
/// led, the [`Certificate`] of the step says so. That is not an error: the belief is still the best
/// estimate.
///
/// # Wide priors
///
/// At first all states that the prior allows are active. From a uniform prior the first steps
/// cost O(n), until the sensor has told some places from the others. As long as nothing has been
/// dropped and more than a fiftieth of all states are active, a step is that of an exact
/// [`Filter`](crate::Filter), at less than twice its cost after the first one; meanwhile nothing is
/// dropped. This requires a stored matrix ([`Transition::stored`](crate::Transition::stored)) that
/// is the same at all steps, and some 90 n additional bytes of memory. If more than a fifth of all
/// states become active after something was dropped, a step computes its sums by three or four
/// products with that matrix, and takes 40 n additional bytes.
///
/// Likelihoods are used as the sensor gives them, divided by a factor near the largest among the
/// states that the belief leads to. For likelihoods outside the range of `f64` after the division,
/// a bound is counted. Probabilities below 1e-290 of the whole are dropped, and counted too: a
/// sensor that contradicts the belief by more than that leaves nothing proven, and the bound says
/// so.
///
/// [`state`](Self::state) is the filter's state as plain data.
#[derive(Debug, Clone)]
pub struct PrunedFilter<M> {
    model: M,
    /// Bounds on the operator, if it is the same at all steps.
    bounds: Option<Bounds>,
    state: PrunedFilterSnapshot,
    scratch: PrunedScratch,
}

impl<M> PrunedFilter<M> {
    /// Creates a filter at the prior, with any pointer to a model. O(n + E), for one look at every
    /// entry.
    #[must_use]
    pub fn new(model: M, pruning: Pruning) -> Self
    where
        M: ModelPointer<Transition: TransitionEntries, Likelihood: LocalLikelihood>,
    {
        let hmm = model.hmm();
        let states = hmm.states();
        let mut scratch = PrunedScratch::new(states);
        let bounds = Bounds::constant(hmm.transition());
        scratch.next.start(hmm.prior().belief().as_slice());
        let mut state = PrunedFilterSnapshot::start(states, pruning);
        let start = state.clone();
        scratch.replace(&mut state, &start);
        Self { model, bounds, state, scratch }
    }

    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.state.steps()
    }

    /// Certificate of the belief after these steps.
    #[must_use]
    pub fn certificate(&self) -> Certificate {
        self.state.certificate()
    }

    /// Active states, in ascending order.
    #[must_use]
    pub fn active(&self) -> &[usize] {
        self.state.active()
    }

    /// Probabilities of the active states, in the same order; they sum to one.
    #[must_use]
    pub fn probabilities(&self) -> &[f64] {
        self.state.probabilities()
    }

    /// Most probable state; ties go to the lowest. O(active states).
    #[must_use]
    pub fn mode(&self) -> usize {
        self.state.mode()
    }

    /// Interval that contains the log-likelihood ln p(y_1 … y_k) of the observations so far, up to
    /// rounding.
    #[must_use]
    pub fn log_likelihood(&self) -> RangeInclusive<f64> {
        self.state.log_likelihood()
    }

    /// State of the filter, without a copy.
    #[must_use]
    pub fn state(&self) -> &PrunedFilterSnapshot {
        &self.state
    }
}

/// # Streams
impl<A: TransitionEntries, B: LocalLikelihood> Hmm<A, B> {
    /// Returns a streaming filter for very large models at the prior, which follows only an
    /// active set of states, proves a bound on its distance from the exact filter, and borrows the
    /// model. O(n + E), for one look at every entry.
    #[must_use]
    pub fn pruned_filter(&self, pruning: Pruning) -> PrunedFilter<&Self> {
        PrunedFilter::new(self, pruning)
    }
}

impl<M, A, B> PrunedFilter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: TransitionEntries,
    B: LocalLikelihood,
{
    /// Goes back to the prior, before the first step. O(n).
    pub fn restart(&mut self) {
        let Self { model, state, scratch, .. } = self;
        scratch.next.start(model.prior().belief().as_slice());
        let start = PrunedFilterSnapshot::start(state.states, state.pruning);
        scratch.replace(state, &start);
    }

    /// Replaces the present belief, for example when a vehicle is told where it is, or is lost. The
    /// number of steps and the log-likelihood do not change; the bound is again that of an exact
    /// belief. O(n).
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the belief has another number of states.
    pub fn relocate(&mut self, belief: &Belief) -> Result<(), HmmError> {
        let (found, expected) = (belief.states(), self.model.states());
        if found != expected {
            return Err(HmmError::StateCount { part: "belief", found, first: "model", expected });
        }
        let Self { state, scratch, .. } = self;
        let mut log_excess = state.log_excess;
        // The interval of the likelihood stays: ln(1 + D), the deficit of the old belief, becomes
        // part of the accumulated excess, since the new belief has none.
        log_excess.add(state.belief.deficit().ln_1p());
        scratch.next.start(belief.as_slice());
        let PrunedFilterSnapshot { share, bound, belief, .. } =
            PrunedFilterSnapshot::start(expected, state.pruning);
        let log_excess = log_excess.known();
        let start = PrunedFilterSnapshot { belief, bound, log_excess, share, ..*state };
        scratch.replace(state, &start);
        Ok(())
    }

    /// Returns a copy of the filter's state. A filter that is [restored](Self::restore) from it
    /// continues with identical bits. O(active states).
    #[must_use]
    pub fn snapshot(&self) -> PrunedFilterSnapshot {
        self.state.clone()
    }

    /// Restores a snapshot of this filter or another, and adopts its limits on the pruning.
    /// Allocates nothing unless there are more active states than ever before. O(active states).
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the snapshot has another number of states.
    pub fn restore(&mut self, snapshot: &PrunedFilterSnapshot) -> Result<(), HmmError> {
        let (found, expected) = (snapshot.states, self.model.states());
        if found != expected {
            return Err(HmmError::StateCount { part: "snapshot", found, first: "model", expected });
        }
        // Copied into the memory of the next belief, which is swapped in as after a step.
        self.scratch.next.copy_from(&snapshot.belief);
        self.scratch.replace(&mut self.state, snapshot);
        Ok(())
    }

    /// Probability of one state: 0 if it is not active, `None` if it does not exist.
    #[must_use]
    pub fn probability(&self, state: usize) -> Option<f64> {
        let position = |state| self.scratch.active_set.position(state);
        let probability = || position(state).map_or(0.0, |at| self.state.belief.estimate[at]);
        (state < self.model.states()).then(probability)
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }
}

/// Sums of predictions with evidence in linear form. Within this range, lifted and weighted values
/// stay within `f64`.
const SUMS: std::ops::RangeInclusive<f64> = 1e-100..=1e30;

/// Memory of steps, and the index of the active states.
#[derive(Debug, Clone)]
pub(super) struct PrunedScratch {
    pub(super) next: Envelope,
    /// Index of the active states of the present belief.
    pub(super) active_set: ActiveSet,
    exact: Exact,
    wide: Wide,
    named: Vec<usize>,
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
            named: Vec::new(),
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
        self.active_set.replace(&state.belief.states, &self.next.states);
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
    /// [`HmmError`] with the step; the filter is then unchanged.
    /// [`Impossible`](HmmError::Impossible) if the model rules out the observation,
    /// [`Pruned`](HmmError::Pruned) if it is ruled out in all active states, but perhaps
    /// not in one that was dropped.
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<Certificate, HmmError> {
        let number = next_step(self.state.steps)?;
        let control = Some(control).filter(|_| self.model.prior().moves_at(number));
        self.advance(number, control, Some(observation))
    }

    /// Predicts under `control` alone: one time step without an observation. The log-likelihood
    /// does not change, except by evidence on the move.
    ///
    /// # Errors
    ///
    /// [`HmmError`] if the operator does not give a distribution, or if the control
    /// is not valid.
    pub fn predict_with(&mut self, control: &A::Control) -> Result<Certificate, HmmError> {
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
    pub fn update(&mut self, observation: &B::Observation) -> Result<Certificate, HmmError> {
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
    pub fn step(&mut self, observation: &B::Observation) -> Result<Certificate, HmmError>
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
    pub fn predict(&mut self) -> Result<Certificate, HmmError>
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
    ) -> Result<Certificate, HmmError> {
        let Self { model, bounds, state, scratch } = self;
        let PrunedScratch { next, active_set, exact, wide, named, values, sensor } = scratch;
        let step = Step { hmm: &**model, number, control };
        if exact.advance(&step, observation, bounds.as_ref(), state, active_set) {
            state.adapt();
            return Ok(state.certificate());
        }
        let evidence = step.evidence()?;
        let PrunedFilterSnapshot { belief, .. } = state;
        named.clear();
        // States that the sensor names matter only if inactive states may have mass.
        if let Some(observation) = observation.filter(|_| belief.is_open()) {
            model.likelihood().listed_states(observation, named);
        }
        let operator = control.map(|control| (model.transition(), control));
        let is_wide = Wide::is_for(belief, model.transition(), control, bounds.as_ref());
        // Candidates first, likelihoods second: the sensor is asked only about states that can
        // matter.
        match operator {
            Some(operator) if is_wide => wide.predict(belief, operator, named, active_set),
            _ => active_set.list(&belief.states, operator, named),
        }
        let candidates = active_set.candidates();
        values.clear();
        let (mut local, mut others, mut largest) = (Diagonal::linear(&[]), 1.0, 1.0);
        if let Some(observation) = observation {
            let wrap = |cause| HmmError::likelihood(number, cause);
            let found = model.likelihood().local(observation, candidates, sensor);
            (local, others) = found.map_err(wrap)?;
            largest = check_local(&local, others, candidates).map_err(wrap)?;
            values.extend_from_slice(local.as_slice());
        } else {
            values.resize(candidates.len(), 1.0);
        }
        let is_open = belief.is_open();
        let mut operator = control.map(|control| {
            StepOperator::new(
                model.transition(),
                control,
                evidence,
                *bounds,
                (&belief.states, is_open),
            )
        });
        // The bounds for an open belief come from all entries: a column bound of 0 means that every
        // entry is 0.
        let nothing = |operator: &StepOperator<'_, A>| {
            if is_open { operator.bounds.column == 0.0 } else { candidates.is_empty() }
        };
        if evidence.is_some()
            && operator.as_ref().is_some_and(nothing)
            && local.is_possible(largest)
        {
            return Err(HmmError::ImpossibleMove { step: number });
        }
        let mut predicted = if is_wide {
            next.predict_by(belief, operator.as_ref(), active_set, wide.sums(operator.as_ref()))
        } else {
            next.predict(belief, operator.as_ref(), active_set)
        };
        if evidence.is_none() {
            // A sum other than one means that the operator did not list some states that its
            // entries lead to: it breaks its contract.
            if !limits::is_one(predicted.sum) {
                return Err(HmmError::PredictedSum { step: number, sum: predicted.sum });
            }
        } else if !SUMS.contains(&predicted.sum)
            && operator.as_ref().is_some_and(|operator| !operator.is_in_powers_of_two())
        {
            // Predicts again, with the scale of the evidence taken out of the entries.
            operator = operator.map(|operator| operator.in_powers_of_two(&belief.states, is_open));
            predicted = next.predict(belief, operator.as_ref(), active_set);
        }
        if !(0.0..=f64::MAX).contains(&predicted.sum) {
            return Err(HmmError::PredictedSum { step: number, sum: predicted.sum });
        }
        // Scaled by the states that the belief leads to, not by all: these must keep their digits,
        // whereas bounds suffice for the others.
        let log_factor = operator.map_or(0.0, |operator| operator.log_factor());
        let likely = values.iter().zip(&next.estimate).filter(|entry| *entry.1 > 0.0);
        let none = if local.is_log() { f64::NEG_INFINITY } else { 0.0 };
        let likely = likely.map(|b| *b.0).fold(none, f64::max);
        let scale = LikelihoodScale::new(&local, others, largest, likely);
        let sums = next.weigh(predicted, values, &scale);
        // No active state explains the observation. Without any excess that is exact; with some, a
        // state that was dropped might explain it.
        if sums.estimate < f64::MIN_POSITIVE {
            let proven = sums.excess == 0.0;
            return Err(if proven {
                HmmError::Impossible { step: number }
            } else {
                HmmError::Pruned { step: number }
            });
        }
        let threshold = state.threshold(candidates.len());
        let PrunedFilterSnapshot { pruning, belief, .. } = state;
        let log = next.scale_and_drop(&sums, threshold, pruning.most_active.max(1), values);
        let (rescaled, unknown) = next.rebase();
        // Commit: nothing can fail from here.
        exact.forget();
        active_set.replace(&belief.states, &next.states);
        mem::swap(belief, next);
        state.steps = number;
        state.log.add(log + scale.log_factor + log_factor);
        state.log.add(rescaled);
        state.log_excess.add(unknown);
        // Sums that have become infinite stay infinite. Their compensation is then NaN, and is
        // cleared.
        (state.log, state.log_excess) = (state.log.known(), state.log_excess.known());
        state.log_lost |= !state.belief.is_known();
        state.bound = state.belief.bound();
        state.adapt();
        Ok(state.certificate())
    }
}
