//! Streaming filter (paper section III-A; section 2 of the [formulas](crate::guide::formulas)): a
//! model, a state and scratch memory. The state as plain data follows below: its accessors, copies
//! at rest, bytes and format. (The struct is defined where steps are taken, in
//! [`step::state`](crate::inference::step::state).)
//!
//! The invariant of all its methods: an error leaves the state as it was. Steps inherit that from
//! [`FilterSnapshot::advance`], which commits last; the other methods check before they write.
//! [`FilterSnapshot::checked`] establishes for a state from outside what steps guarantee for a
//! running filter: the belief is a distribution, and its logarithms, if any, agree with it.

use std::ops::Deref;

use super::bytes::{Kind, Reader, Writer, contents};
use crate::belief::{Belief, BeliefView, SUM_TOLERANCE};
use crate::error::{InferenceError, SnapshotError};
use crate::hmm::{Hmm, ModelPointer};
use crate::inference::step::Step;
use crate::inference::step::state::{FilterSnapshot, LogSum, MOST_STEPS, StepOutcome, StepScratch};
use crate::likelihood::Likelihood;
use crate::transition::{NoControl, Transition};
use wayfix_kernels::Aligned;

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
    ) -> Result<StepOutcome, InferenceError> {
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
    /// [`InferenceError`] with the step, if the observation is impossible, or if control or
    /// likelihood are not valid. The filter is then unchanged.
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<f64, InferenceError> {
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
    /// [`InferenceError`] if the control is not valid, or if it is evidence that is
    /// [impossible](InferenceError::ImpossibleMove).
    pub fn predict_with(&mut self, control: &A::Control) -> Result<(), InferenceError> {
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
    pub fn update(&mut self, observation: &B::Observation) -> Result<f64, InferenceError> {
        // A prior at the first observation is the distribution of X_1, the first state to observe.
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
    /// [`InferenceError`] if a control is not valid.
    pub fn forecast_with(&self, controls: &[A::Control]) -> Result<Belief, InferenceError> {
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
    /// [`InferenceError::StateCount`] if the snapshot has another number of states.
    pub fn restore(&mut self, snapshot: &FilterSnapshot) -> Result<(), InferenceError> {
        let (found, expected) = (snapshot.belief.len(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "snapshot", found, expected });
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
    /// [`InferenceError::StateCount`] if the belief has another number of states.
    pub fn relocate(&mut self, belief: &Belief) -> Result<(), InferenceError> {
        let (found, expected) = (belief.states(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "belief", found, expected });
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
    pub fn step(&mut self, observation: &B::Observation) -> Result<f64, InferenceError>
    where
        A::Control: NoControl,
    {
        self.step_with(&A::Control::NONE, observation)
    }

    /// Predicts alone: one time step without an observation. The log-likelihood does not change.
    ///
    /// # Errors
    ///
    /// [`InferenceError`] if the operator does not give a distribution.
    pub fn predict(&mut self) -> Result<(), InferenceError>
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
    pub fn forecast(&self, steps: usize) -> Result<Belief, InferenceError>
    where
        A::Control: NoControl,
    {
        self.forecast_with(&vec![A::Control::NONE; steps])
    }
}

impl Clone for FilterSnapshot {
    /// Copies the state into as little memory as possible.
    fn clone(&self) -> Self {
        // A state at rest needs no aligned memory: there may be millions of a few hundred bytes.
        let belief = Aligned::from(self.belief.to_vec());
        Self { belief, logs: self.logs.clone(), ..*self }
    }

    /// Copies the state into existing memory. Allocates nothing if both have the same number of
    /// states, unless only the source has logarithms.
    fn clone_from(&mut self, other: &Self) {
        self.copy(other);
        // A vehicle that needed logarithms once should not keep the memory for them.
        if other.logs.is_empty() {
            self.logs = Vec::new();
        }
    }
}

impl FilterSnapshot {
    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Number of these steps taken in logarithms, which is several times slower: the belief
    /// before or after was outside the range of `f64`, or the observation contradicted the
    /// prediction too strongly. A prediction alone and an update alone count as one each.
    ///
    /// If there are many, and the tails of the model are not credible anyway, [rounded
    /// tails](crate::Hmm::with_rounded_tails) are faster.
    ///
    /// ```
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let stay = DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?;
    /// let hmm = Hmm::new(prior, stay, LikelihoodVector::log(2))?;
    /// let mut filter = hmm.filter();
    /// filter.step(&[0.0, -10.0])?;
    /// assert_eq!(filter.steps_in_logs(), 0);
    /// filter.step(&[0.0, -1000.0])?; // e^-1010 is beyond doubles
    /// filter.step(&[0.0, -10.0])?;
    /// assert_eq!(filter.steps_in_logs(), 2);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.steps_in_logs
    }

    /// Present belief: p(X_k | y_1 … y_k) after an update, the predicted one after a prediction,
    /// the prior before any step.
    #[must_use]
    pub fn belief(&self) -> BeliefView<'_> {
        Belief::view(&self.belief)
    }

    /// Log-likelihood ln p(y_1 … y_k) of the observations so far, and of evidence on moves.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood.value()
    }

    /// True if a state may be the true one, also where its probability is below the range of
    /// doubles.
    #[doc(hidden)]
    #[must_use]
    pub fn is_possible(&self, state: usize) -> bool {
        self.belief_ref().log(state) > f64::NEG_INFINITY
    }

    /// Replaces the belief, its logarithms if there are any (with −∞ for nothing), and the number
    /// of steps, for models that get more states. A filter checks the result when it is restored.
    #[doc(hidden)]
    #[must_use]
    pub fn remade(&self, steps: usize, mut values: impl FnMut(&[f64], f64) -> Vec<f64>) -> Self {
        let belief = Aligned::from(values(&self.belief, 0.0));
        let logs = values(&self.logs, f64::NEG_INFINITY);
        Self { steps, belief, logs, ..self.clone() }
    }

    /// Memory on the heap in bytes, in addition to the snapshot itself: 8 for each state, or 16 if
    /// the belief is held in logarithms too. (The state within a filter keeps room for steps.)
    #[must_use]
    pub fn heap_bytes(&self) -> usize {
        (self.belief.capacity() + self.logs.capacity()) * size_of::<f64>()
    }

    /// Returns the state as bytes: 8 bytes for each possible state, one bit for each state, and
    /// about 60 bytes more. Needs no feature.
    ///
    /// ```
    /// # use wayfix::inference::FilterSnapshot;
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?, LikelihoodVector::linear(2))?;
    /// let mut filter = hmm.filter();
    /// filter.step(&[0.9, 0.2])?;
    /// let mut bytes = filter.snapshot().to_bytes();
    ///
    /// let mut next = hmm.filter();
    /// next.restore(&FilterSnapshot::from_bytes(&bytes)?)?;
    /// assert_eq!(next.snapshot(), filter.snapshot()); // to the bit
    ///
    /// bytes[20] ^= 1;
    /// assert!(FilterSnapshot::from_bytes(&bytes).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # The format
    ///
    /// The bytes begin with `wayfix`, the kind of state and the version, 1, and end with a
    /// checksum, which detects damage. They mean the same on all machines; other versions of the
    /// format are refused.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Writer::new(Kind::Filter);
        out.integer(self.steps);
        out.integer(self.steps_in_logs);
        out.log_sum(self.log_likelihood);
        out.doubles(&self.belief, 0.0);
        out.doubles(&self.logs, f64::NEG_INFINITY);
        out.finish()
    }

    /// Reads a state from bytes. O(length).
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let mut from = Reader::new(bytes, Kind::Filter)?;
        let (steps, steps_in_logs) = (from.integer()?, from.integer()?);
        let log_likelihood = from.log_sum()?;
        let belief =
            Belief::new(from.doubles(0.0)?).map_err(|error| contents(error.to_string()))?;
        let logs = from.doubles(f64::NEG_INFINITY)?;
        // Before the checks of the state, since leftover bytes explain a wrong number.
        from.finish()?;
        let belief = belief.into_vec().into();
        let state = Self { steps, steps_in_logs, belief, logs, log_likelihood };
        state.checked().map_err(contents)
    }

    /// Checks that the numbers, which may be damaged, can be those of a filter.
    fn checked(self) -> Result<Self, String> {
        let Self { steps, belief, logs, log_likelihood, .. } = &self;
        if *steps > MOST_STEPS {
            return Err(format!("{steps} steps, expected at most {MOST_STEPS}"));
        }
        if !logs.is_empty() {
            let (found, expected) = (logs.len(), belief.len());
            if found != expected {
                return Err(format!("{found} logarithms for a belief over {expected} states"));
            }
            for (state, (log, p)) in logs.iter().zip(&**belief).enumerate() {
                // Steps read the logarithms, accessors the belief: the two must agree. (The
                // comparison is false for NaN.)
                let agree = (log.exp() - p).abs() <= SUM_TOLERANCE;
                if !agree {
                    return Err(format!(
                        "state {state} has probability {p}, expected exp({log}) as its logarithm says"
                    ));
                }
            }
        }
        let LogSum { sum, compensation } = *log_likelihood;
        if !log_likelihood.is_finite() {
            return Err(format!(
                "the log-likelihood is the sum of {sum} and {compensation}, expected finite values"
            ));
        }
        Ok(self)
    }
}

#[cfg(feature = "serde")]
use crate::stored::{finite_logs, logs as logs_of};

#[cfg(feature = "serde")]
crate::stored! {
    [] FilterSnapshot: [], |state| {
        steps: usize = state.steps,
        steps_in_logs: usize = state.steps_in_logs,
        belief: Belief = Belief::view(&state.belief).to_owned(),
        logs: Option<Vec<Option<f64>>> = (!state.logs.is_empty()).then(|| finite_logs(&state.logs)),
        log_likelihood: [f64; 2] = [state.log_likelihood.sum, state.log_likelihood.compensation],
    } => {
        let [sum, compensation] = log_likelihood;
        let state = self::FilterSnapshot {
            steps,
            steps_in_logs,
            belief: belief.into_vec().into(),
            logs: logs.map_or_else(Vec::new, logs_of),
            log_likelihood: LogSum { sum, compensation },
        };
        state.checked()
    };
}
