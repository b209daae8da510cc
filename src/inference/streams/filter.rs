//! Streaming filter (paper section III-A).

use std::mem;
use std::ops::Deref;

use super::filter_snapshot::{FilterSnapshot, next_step};
use crate::belief::{Belief, BeliefView};
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::step::belief_form::{
    BeliefForm, BeliefRef, LiftedBelief, StepOutcome, StepOutput, loses, normalize_logs,
};
use crate::inference::step::{Step, Workspace};
use crate::kernels::{self, Aligned};
use crate::likelihood::Likelihood;
use crate::limits::{self, LIFT};
use crate::transition::{NoControl, Transition};

/// Streaming filter: the distribution of the present state given all observations so far,
/// p(X_k | y_1 … y_k) (paper eq. 8).
///
/// Each step costs one product with A and O(n), and allocates nothing after the first (which may,
/// if the sensor fills memory of its own). After an error the filter is as it was before the
/// call, so that the caller can skip the observation, [`predict`](Self::predict) only, or
/// [`restart`](Self::restart).
///
/// `M` is a pointer to the model: [`Hmm::filter`] borrows it; [`Filter::new`] also takes an
/// `Arc`, a `Box` or another pointer.
///
/// Probabilities outside the range of `f64` (below 2.2e-308 of the whole) are kept in logarithms,
/// at some cost in time, so that the filter can come back to such a state. Only in a model with
/// [rounded tails](Hmm::with_rounded_tails) they become 0.
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
#[derive(Debug, Clone)]
pub struct Filter<M> {
    model: M,
    steps: usize,
    steps_in_logs: usize,
    belief: Aligned,
    /// Logarithms of the belief, if it has values outside the range of `f64`.
    logs: Option<Vec<f64>>,
    log_likelihood: LogSum,
    lifted: LiftedBelief,
    predicted: Vec<f64>,
    after: Aligned,
    after_lifted: Aligned,
    after_logs: Vec<f64>,
    /// Memory for the logarithms while there are none.
    spare: Vec<f64>,
    work: Workspace,
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
    /// Creates a filter at the prior, from a pointer to a model: `&hmm`, or `Arc::new(hmm)` for a
    /// filter that owns it. Allocates all memory that its steps need.
    #[must_use]
    pub fn new(model: M) -> Self {
        let n = model.states();
        let mut belief = Aligned::new(n, 0.0);
        belief.copy_from_slice(model.prior().belief().as_slice());
        Self {
            lifted: LiftedBelief::new(&belief),
            steps: 0,
            steps_in_logs: 0,
            belief,
            logs: None,
            log_likelihood: LogSum::default(),
            predicted: vec![0.0; n],
            after: Aligned::new(n, 0.0),
            after_lifted: Aligned::new(n, 0.0),
            after_logs: vec![0.0; n],
            spare: vec![0.0; n],
            work: Workspace::new(n),
            model,
        }
    }

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
        Ok(self.step_in_full(control, observation)?.log)
    }

    /// Takes a step, and returns its full outcome.
    pub(crate) fn step_in_full(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<StepOutcome, InferenceError> {
        let number = next_step(self.steps)?;
        let control = self.model.prior().moves_at(number).then_some(control);
        self.advance(number, control, observation)
    }

    /// Predicts under `control` alone: one time step without an observation. The log-likelihood
    /// stays, unless the control is [evidence on the move](crate::Transition::evidence): then the
    /// belief is conditioned on the evidence, whose log-likelihood is added.
    ///
    /// # Errors
    ///
    /// [`InferenceError`] if the control is not valid, or if it is evidence that is
    /// [impossible](InferenceError::ImpossibleMove).
    pub fn predict_with(&mut self, control: &A::Control) -> Result<(), InferenceError> {
        let number = next_step(self.steps)?;
        let control = self.model.prior().moves_at(number).then_some(control);
        let Self { model, belief, logs, lifted, predicted, .. } = self;
        let Self { after, after_lifted, after_logs, work, .. } = self;
        let step = Step { hmm: &**model, number, control };
        let evidence = step.evidence()?;
        let mut by_logs = logs.is_some() || (evidence.is_some() && step.needs_logs());
        // ln p(u), without the log factor of the evidence.
        let mut log = 0.0;
        if !by_logs {
            step.predict(lifted.values(belief), after);
            let sum = match evidence {
                None => Some(step.check_prediction(after)?),
                Some(_) => step.evidence_sum(after)?,
            };
            match sum {
                Some(sum) => {
                    let loses = normalize(after, sum);
                    (by_logs, log) = (loses && !model.rounds_tails(), (sum / LIFT).ln());
                }
                None => by_logs = true,
            }
        }
        let mut in_logs = false;
        if by_logs {
            let mut results =
                StepOutput { predicted, after, lifted: after_lifted, logs: after_logs };
            let before = BeliefRef { linear: belief, logs: logs.as_deref() };
            step.predict_in_logs(before, evidence, &mut results, &mut work.values)?;
            log = normalize_logs(after_logs, after).unwrap_or(f64::NEG_INFINITY);
            in_logs = !model.rounds_tails() && loses(after_logs, after);
        }
        let log = evidence.map_or(0.0, |log_factor| log + log_factor);
        let form = BeliefForm::Other;
        self.commit(number, &StepOutcome { log, normalizer: 0.0, by_logs, in_logs, form });
        Ok(())
    }

    /// Updates with an observation alone, without a time step: for a further sensor at the same
    /// step, or after [`predict`](Self::predict). Returns the logarithm of its probability given
    /// all before.
    ///
    /// A sensor of another kind is a part of the model: a
    /// [`FusedLikelihood`](crate::FusedLikelihood) of two
    /// [`OptionalLikelihood`](crate::OptionalLikelihood)s, with `step(&(Some(camera), None))` and
    /// then `update(&(None, Some(position)))`.
    ///
    /// Before any step, it is an observation of X_0, and errors call it step 0; but under
    /// [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) it takes step 1.
    ///
    /// # Errors
    ///
    /// As [`step_with`](Self::step_with).
    pub fn update(&mut self, observation: &B::Observation) -> Result<f64, InferenceError> {
        let at_first = !self.model.prior().moves_at(1);
        let number = self.steps.max(usize::from(at_first));
        Ok(self.advance(number, None, observation)?.log)
    }

    /// Returns the distribution `controls.len()` steps ahead, without observations, under one
    /// control a step. Controls that are evidence on moves condition it on their measurements;
    /// for a forecast without measurements, give controls without them. The filter is unchanged.
    /// (From a fresh filter under [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation)
    /// the first step is to X_1, which is distributed as the prior.)
    ///
    /// # Errors
    ///
    /// [`InferenceError`] if a control is not valid.
    pub fn forecast_with(&self, controls: &[A::Control]) -> Result<Belief, InferenceError> {
        let mut ahead = Filter::new(&*self.model);
        ahead.restore(&self.snapshot())?;
        controls.iter().try_for_each(|control| ahead.predict_with(control))?;
        Ok(ahead.belief().to_owned())
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

    /// Number of steps taken, k.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Number of steps so far taken in logarithms, which is several times slower: the belief
    /// before or after was outside the range of `f64`, or the observation contradicted the
    /// prediction too much. A prediction and an update alone count one each.
    ///
    /// If there are many, and the tails of the model are not credible anyway, [rounded
    /// tails](Hmm::with_rounded_tails) are faster.
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

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Hmm<A, B> {
        &self.model
    }

    /// Returns a copy of the filter's state. A filter that is [restored](Self::restore) from it
    /// continues with identical bits.
    #[must_use]
    pub fn snapshot(&self) -> FilterSnapshot {
        FilterSnapshot {
            steps: self.steps,
            steps_in_logs: self.steps_in_logs,
            belief: self.belief().to_owned(),
            logs: self.logs.clone(),
            log_likelihood: self.log_likelihood,
        }
    }

    /// Overwrites a snapshot with a copy of the filter's state, as [`snapshot`](Self::snapshot)
    /// returns it. For many vehicles that share a filter, each with a snapshot of its own. Allocates
    /// nothing if the snapshot is of a model of as many states, unless there are logarithms for the
    /// first time.
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
        (state.steps, state.steps_in_logs) = (self.steps, self.steps_in_logs);
        state.log_likelihood = self.log_likelihood;
        let belief = state.belief.as_mut_vec();
        belief.clear();
        belief.extend_from_slice(&self.belief);
        state.logs.clone_from(&self.logs);
    }

    /// Restores a snapshot, of this filter or another. Allocates nothing. Only the number of states
    /// is compared: keep a version of the model beside snapshots that outlive it.
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if it has another number of states.
    pub fn restore(&mut self, snapshot: &FilterSnapshot) -> Result<(), InferenceError> {
        let (found, expected) = (snapshot.belief.states(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "snapshot", found, expected });
        }
        (self.steps, self.steps_in_logs) = (snapshot.steps, snapshot.steps_in_logs);
        self.log_likelihood = snapshot.log_likelihood;
        self.belief.copy_from_slice(snapshot.belief.as_slice());
        if let Some(logs) = &snapshot.logs {
            self.after_logs.copy_from_slice(logs);
        }
        self.lifted.follow(&self.belief);
        self.keep_logs(snapshot.logs.is_some());
        Ok(())
    }

    /// Returns to the prior, with no steps taken.
    pub fn restart(&mut self) {
        let Self { model, belief, .. } = self;
        belief.copy_from_slice(model.prior().belief().as_slice());
        (self.steps, self.steps_in_logs, self.log_likelihood) = (0, 0, LogSum::default());
        self.lifted.follow(&self.belief);
        self.keep_logs(false);
    }

    /// Replaces the present belief, for example when a vehicle is told where it is, or is lost.
    /// Steps and log-likelihood stay.
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if it has another number of states.
    pub fn relocate(&mut self, belief: &Belief) -> Result<(), InferenceError> {
        let (found, expected) = (belief.states(), self.model.states());
        if found != expected {
            return Err(InferenceError::StateCount { what: "belief", found, expected });
        }
        self.belief.copy_from_slice(belief.as_slice());
        self.lifted.follow(&self.belief);
        self.keep_logs(false);
        Ok(())
    }

    fn advance(
        &mut self,
        number: usize,
        control: Option<&A::Control>,
        observation: &B::Observation,
    ) -> Result<StepOutcome, InferenceError> {
        let Self { model, belief, logs, lifted, predicted, .. } = self;
        let Self { after, after_lifted, after_logs, work, .. } = self;
        let step = Step { hmm: &**model, number, control };
        let before = BeliefRef { linear: belief, logs: logs.as_deref() };
        let mut results = StepOutput { predicted, after, lifted: after_lifted, logs: after_logs };
        let advanced = step.advance(observation, before, lifted, &mut results, work)?;
        self.commit(number, &advanced);
        Ok(advanced)
    }

    pub(crate) fn held(&self) -> BeliefRef<'_> {
        BeliefRef { linear: &self.belief, logs: self.logs.as_deref() }
    }

    /// Applies the outcome of a step; nothing before this changes the filter.
    fn commit(&mut self, number: usize, advanced: &StepOutcome) {
        let belief = &mut self.belief;
        match advanced.form {
            BeliefForm::Plain { .. } => mem::swap(belief, &mut self.after_lifted),
            BeliefForm::Lifted { .. } => mem::swap(belief, &mut self.after),
            BeliefForm::Other => {
                mem::swap(belief, &mut self.after);
                self.lifted.follow(belief);
            }
        }
        self.lifted.commit(advanced.form, &mut self.after_lifted);
        self.keep_logs(advanced.in_logs);
        self.steps = number;
        self.steps_in_logs = self.steps_in_logs.saturating_add(usize::from(advanced.by_logs));
        self.log_likelihood.add(advanced.log);
    }

    /// Keeps the logarithms in `after_logs`, or drops those kept so far.
    fn keep_logs(&mut self, keep: bool) {
        if !keep && self.logs.is_none() {
            return;
        }
        let memory = self.logs.take();
        let mut memory = memory.unwrap_or_else(|| mem::take(&mut self.spare));
        if keep {
            mem::swap(&mut memory, &mut self.after_logs);
            self.logs = Some(memory);
        } else {
            self.spare = memory;
        }
    }
}

impl<M, A, B> Filter<M>
where
    M: Deref<Target = Hmm<A, B>>,
    A: Transition,
    B: Likelihood,
{
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

    /// Predicts alone: one time step without an observation. The log-likelihood stays.
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

/// Normalizes a prediction, which sums to one up to rounding, so that rounding does not
/// accumulate. Returns true if a value rounds to 0.
fn normalize(predicted: &mut [f64], sum: f64) -> bool {
    let loses = predicted.iter().any(|p| limits::rounds_to_zero(*p, sum));
    kernels::normalize(predicted, sum);
    loses
}
