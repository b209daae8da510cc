//! Streaming filter (paper section III-A; section 2 of the [formulas](crate::guide::formulas)): a
//! model, a state and scratch memory. The state is plain data: [`step::state`](crate::inference::step::state)
//! takes its steps, `snapshot.rs` reads, copies and stores it.
//!
//! The invariant of all its methods: an error leaves the state as it was. Steps inherit that from
//! [`FilterSnapshot::advance`], which commits last; the other methods check before they write.

use std::ops::Deref;

use crate::belief::{Belief, BeliefView};
use crate::error::HmmError;
use crate::hmm::{Hmm, ModelPointer};
use crate::inference::step::Step;
use crate::inference::step::state::{FilterSnapshot, StepOutcome, StepScratch};
use crate::likelihood::Likelihood;
use crate::transition::{NoControl, Transition};

/// Streaming filter: the distribution of the present state given all observations so far,
/// p(X_k | y_1 … y_k) (paper eq. 8).
///
/// A step costs one product with A and O(n). Only the first may allocate, if the sensor fills
/// memory of its own. After an error the filter is as it was before the call, so that the caller
/// can skip the observation, [`predict`](Self::predict) only, or [`restart`](Self::restart).
///
/// `M` is a pointer to the model: [`Hmm::filter`] borrows the model; [`Filter::new`] also takes an
/// `Arc`, a `Box` or another pointer.
///
/// Probabilities outside the range of `f64` (below 2.2e-308 of the whole) are kept in logarithms,
/// at some cost in time, so that the filter can come back to such a state. They become 0 only in a
/// model with [rounded tails](Hmm::with_rounded_tails).
///
/// ```
/// use std::sync::Arc;
/// use wayfix::{Belief, Filter, Hmm, Prior, SparseTransition, TableLikelihood};
///
/// type Model = Hmm<SparseTransition, TableLikelihood>;
///
/// struct Car {
///     position: Filter<Arc<Model>>,
/// }
///
/// let model: Arc<Model> = Arc::new(Hmm::new(
///     Prior::BeforeFirstTransition(Belief::uniform(2)?),
///     SparseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?,
///     TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?,
/// )?);
/// let mut car = Car { position: Filter::new(Arc::clone(&model)) };
/// car.position.step(&0)?;
/// assert!((car.position.belief().as_slice()[0] - 0.45 / 0.55).abs() < 1e-15);
/// assert!((car.position.log_likelihood() - 0.55f64.ln()).abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// [`state`](Self::state) is the filter's state as plain data.
#[derive(Debug)]
pub struct Filter<M> {
    model: M,
    state: FilterSnapshot,
    scratch: StepScratch,
}

impl<M> Filter<M> {
    /// Creates a filter at the prior, from a pointer to a model: `&hmm`, or `Arc::new(hmm)` for a
    /// filter that owns it. Allocates all memory that its steps need.
    #[must_use]
    pub fn new(model: M) -> Self
    where
        M: ModelPointer,
    {
        let prior = model.hmm().prior().belief().as_slice();
        let (state, scratch) = (FilterSnapshot::start(prior), StepScratch::new(prior));
        Self { model, state, scratch }
    }

    /// Present belief: p(X_k | y_1 … y_k) after an update, the predicted one after a prediction,
    /// the prior before any step.
    #[must_use]
    pub fn belief(&self) -> BeliefView<'_> {
        self.state.belief()
    }

    /// Log-likelihood ln p(y_1 … y_k) of the observations so far, and of evidence on moves.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.state.log_likelihood()
    }

    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.state.steps()
    }

    /// Number of these steps taken in logarithms, as counted by
    /// [`FilterSnapshot::steps_in_logs`].
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.state.steps_in_logs()
    }

    /// State of the filter, without a copy.
    #[must_use]
    pub fn state(&self) -> &FilterSnapshot {
        &self.state
    }
}

impl<M: Clone> Clone for Filter<M> {
    fn clone(&self) -> Self {
        // `FilterSnapshot::clone` makes a compact copy at rest; a running filter needs aligned
        // memory, with room for logarithms.
        let mut state = FilterSnapshot::start(&self.state.belief);
        state.copy(&self.state);
        Self { model: self.model.clone(), state, scratch: self.scratch.clone() }
    }
}

impl FilterSnapshot {
    /// Takes a step with an observation.
    pub(crate) fn advance<A: Transition, B: Likelihood>(
        &mut self,
        step: &Step<'_, A, B>,
        observation: &B::Observation,
        scratch: &mut StepScratch,
    ) -> Result<StepOutcome, HmmError> {
        let outcome = step.advance(observation, self.belief_ref(), scratch, None)?;
        self.commit(step.number, &outcome, scratch);
        Ok(outcome)
    }
}

/// # Streams
impl<A: Transition, B: Likelihood> Hmm<A, B> {
    /// Returns a streaming filter at the prior, which borrows the model.
    #[must_use]
    pub fn filter(&self) -> Filter<&Self> {
        Filter::new(self)
    }
}

impl<M, A, B> Filter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: Transition,
    B: Likelihood,
{
    /// Takes one time step: prediction under `control`, then update with `observation`. The
    /// control drives the transition to this step. Returns the log-likelihood of the observation,
    /// ln p(y_k | y_1 … y_{k-1}); with evidence on the move, of both, ln p(u_k, y_k | …).
    ///
    /// Under [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) the first step has
    /// no transition, and its control is ignored.
    ///
    /// # Errors
    ///
    /// [`HmmError`] with the step, if the observation is impossible, or if control or
    /// likelihood are not valid. The filter is then unchanged.
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<f64, HmmError> {
        let step = Step::after(&*self.model, self.state.steps, control)?;
        Ok(self.state.advance(&step, observation, &mut self.scratch)?.log)
    }

    /// Predicts under `control` alone: one time step without an observation. The log-likelihood
    /// does not change, unless the control is [evidence on the
    /// move](crate::Transition::evidence): then the belief is conditioned on the evidence, and its
    /// log-likelihood is added.
    ///
    /// # Errors
    ///
    /// [`HmmError`] if the control is not valid, or if it is evidence that is
    /// [impossible](HmmError::ImpossibleMove).
    pub fn predict_with(&mut self, control: &A::Control) -> Result<(), HmmError> {
        let step = Step::after(&*self.model, self.state.steps, control)?;
        let outcome = step.advance_unseen(self.state.belief_ref(), &mut self.scratch)?;
        self.state.commit(step.number, &outcome, &mut self.scratch);
        Ok(())
    }

    /// Updates with an observation alone, without a time step: for another sensor at the same
    /// step, or after [`predict`](Self::predict). Returns the logarithm of its probability given
    /// everything before.
    ///
    /// A sensor of another kind is part of the model: a
    /// [`FusedLikelihood`](crate::FusedLikelihood) of two
    /// [`OptionalLikelihood`](crate::OptionalLikelihood)s, with `step(&(Some(camera), None))` and
    /// then `update(&(None, Some(position)))`.
    ///
    /// Before any step this is an observation of X_0, and errors name step 0; but under
    /// [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) it takes step 1.
    ///
    /// # Errors
    ///
    /// As [`step_with`](Self::step_with).
    pub fn update(&mut self, observation: &B::Observation) -> Result<f64, HmmError> {
        // A prior at the first observation is the distribution of X_1, so the first update is step
        // 1.
        let at_first = !self.model.prior().moves_at(1);
        let number = self.state.steps.max(usize::from(at_first));
        let step = Step { hmm: &*self.model, number, control: None };
        Ok(self.state.advance(&step, observation, &mut self.scratch)?.log)
    }

    /// Returns the distribution `controls.len()` steps ahead, without observations, under one
    /// control a step. Controls that are evidence on moves condition the forecast on their
    /// measurements; for a forecast without measurements, pass controls without evidence. The
    /// filter is unchanged. (From a fresh filter under
    /// [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation), the first step leads to
    /// X_1, whose distribution is the prior.)
    ///
    /// # Errors
    ///
    /// [`HmmError`] if a control is not valid.
    pub fn forecast_with(&self, controls: &[A::Control]) -> Result<Belief, HmmError> {
        // Forecasts are rare: this one gets scratch memory of its own, so that `self` need not be
        // `mut`.
        let mut ahead = Filter::new(&*self.model);
        ahead.restore(&self.state)?;
        controls.iter().try_for_each(|control| ahead.predict_with(control))?;
        Ok(ahead.belief().to_owned())
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Returns a copy of the filter's state. A filter that is [restored](Self::restore) from it
    /// continues with identical bits.
    #[must_use]
    pub fn snapshot(&self) -> FilterSnapshot {
        self.state.clone()
    }

    /// Overwrites a snapshot with a copy of the filter's state, as [`snapshot`](Self::snapshot)
    /// returns it: for many vehicles that share a filter, each with its own snapshot. Allocates
    /// nothing if the snapshot has the same number of states, unless it had no logarithms before
    /// and needs them now.
    ///
    /// ```
    /// let hmm = wayfix::canberra::hmm(5, 1.0)?;
    /// let mut filter = hmm.filter();
    /// let mut vehicles = vec![filter.snapshot(); 3];
    /// for (vehicle, seen) in [(0, 4), (2, 80), (0, 5)] {
    ///     filter.restore(&vehicles[vehicle])?;
    ///     filter.step(&seen)?;
    ///     filter.snapshot_to(&mut vehicles[vehicle]);
    /// }
    /// assert_eq!([0, 1, 2].map(|vehicle| vehicles[vehicle].steps()), [2, 0, 1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn snapshot_to(&self, state: &mut FilterSnapshot) {
        state.clone_from(&self.state);
    }

    /// Restores a snapshot of this filter or another. Allocates nothing. Only the number of states
    /// is compared: store a version of the model with snapshots that outlive it.
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the snapshot has another number of states.
    pub fn restore(&mut self, snapshot: &FilterSnapshot) -> Result<(), HmmError> {
        let (found, expected) = (snapshot.belief.len(), self.model.states());
        if found != expected {
            return Err(HmmError::StateCount { part: "snapshot", found, first: "model", expected });
        }
        // Copied into the filter's own memory, which is aligned and has room for logarithms.
        self.state.copy(snapshot);
        self.scratch.lifted.reset(&self.state.belief);
        Ok(())
    }

    /// Goes back to the prior, before the first step.
    pub fn restart(&mut self) {
        let prior = self.model.prior().belief().as_slice();
        self.state.restart(prior);
        self.scratch.lifted.reset(prior);
    }

    /// Replaces the present belief, for example when a vehicle is told where it is, or is lost.
    /// The number of steps and the log-likelihood do not change.
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the belief has another number of states.
    pub fn relocate(&mut self, belief: &Belief) -> Result<(), HmmError> {
        let (found, expected) = (belief.states(), self.model.states());
        if found != expected {
            return Err(HmmError::StateCount { part: "belief", found, first: "model", expected });
        }
        self.state.relocate(belief.as_slice());
        self.scratch.lifted.reset(&self.state.belief);
        Ok(())
    }

    /// Takes one time step: prediction, then update with `observation`. Returns the
    /// log-likelihood of the observation, ln p(y_k | y_1 … y_{k-1}).
    ///
    /// # Errors
    ///
    /// As [`step_with`](Self::step_with).
    pub fn step(&mut self, observation: &B::Observation) -> Result<f64, HmmError>
    where
        A::Control: NoControl,
    {
        self.step_with(&A::Control::NONE, observation)
    }

    /// Predicts alone: one time step without an observation. The log-likelihood does not change.
    ///
    /// # Errors
    ///
    /// [`HmmError`] if the operator does not give a distribution.
    pub fn predict(&mut self) -> Result<(), HmmError>
    where
        A::Control: NoControl,
    {
        self.predict_with(&A::Control::NONE)
    }

    /// Returns the distribution `steps` ahead, without observations. The filter is unchanged.
    /// Costs `steps` products with A.
    ///
    /// ```
    /// let hmm = wayfix::canberra::hmm(5, 1.0)?;
    /// let mut filter = hmm.filter();
    /// filter.step(&4)?;
    /// let soon = filter.forecast(2)?; // where it will be two steps from now
    /// assert!(soon.entropy() > filter.belief().entropy());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`predict`](Self::predict).
    pub fn forecast(&self, steps: usize) -> Result<Belief, HmmError>
    where
        A::Control: NoControl,
    {
        self.forecast_with(&vec![A::Control::NONE; steps])
    }
}
