//! The fixed-lag smoother: a live answer that has seen a little of what came
//! after.

use std::collections::VecDeque;
use std::ops::Deref;

use super::backward::Backward;
use super::filter::Filter;
use super::filter_state::FilterState;
use super::step::Step;
use crate::belief::{Belief, BeliefView};
use crate::error::InferenceError;
use crate::hmm::Hmm;
use crate::likelihood::Likelihood;
use crate::transition::Transition;

/// The fixed-lag smoother: after each step k, p(X_j | y_1 … y_k) for the last
/// steps j = k − L … k.
///
/// It goes back from the filtered belief through the window, as the batch
/// smoother does, and gives, but for rounding, what [`Hmm::smooth`] would of the
/// observations so far. A step costs one product for the filter and two for
/// each step of the window, O(L) products in all; memory is 2 n (L + 1) numbers.
/// After an error it is as it was before the call.
///
/// `M` is how the model is held, as for [`Filter`].
///
/// ```
/// # use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};
/// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
/// # let table = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
/// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?, table)?;
/// let mut smoother = hmm.fixed_lag(2);
/// for sighting in [0, 0, 1, 0, 0] {
///     smoother.step(&sighting)?;
/// }
/// // What was two steps ago, after all five sightings.
/// let smoothing = hmm.smooth(&[0, 0, 1, 0, 0])?;
/// let (stream, batch) = (smoother.get(3).unwrap(), smoothing.posteriors().get(3).unwrap());
/// assert!((stream.as_slice()[0] - batch.as_slice()[0]).abs() < 1e-15);
/// assert_eq!(smoother.lagged().mode(), 1);
/// assert_eq!(smoother.get(2), None); // no longer in the window
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct FixedLag<M, U> {
    filter: Filter<M>,
    lag: usize,
    /// What the filter knew before each of the last L steps, oldest first, and
    /// what drove the step.
    past: VecDeque<(FilterState, U)>,
    /// γ of the present step, of the one before, and so on.
    window: Vec<Vec<f64>>,
    backward: Backward,
    /// Memory of a state that has left the window.
    spare: Option<FilterState>,
}

/// All that a fixed-lag smoother knows: plain data, to be kept, compared, sent
/// elsewhere, and restored.
///
/// Made by [`FixedLag::snapshot`].
#[derive(Debug, Clone, PartialEq)]
pub struct FixedLagState<U> {
    pub(crate) lag: usize,
    pub(crate) present: FilterState,
    pub(crate) past: Vec<(FilterState, U)>,
}

impl<A: Transition<Control: Clone>, B: Likelihood> Hmm<A, B> {
    /// A smoother that looks `lag` steps back, at the prior; it borrows the
    /// model. A lag of 0 is the filter.
    #[must_use]
    pub fn fixed_lag(&self, lag: usize) -> FixedLag<&Self, A::Control> {
        FixedLag::new(self, lag)
    }
}

impl<M, A, B> FixedLag<M, A::Control>
where
    M: Deref<Target = Hmm<A, B>>,
    A: Transition<Control: Clone>,
    B: Likelihood,
{
    /// A smoother at the prior, with any pointer to a model.
    #[must_use]
    pub fn new(model: M, lag: usize) -> Self {
        let backward = Backward::new(model.states());
        let window = vec![model.prior().belief().as_slice().to_vec()];
        let (filter, past) = (Filter::new(model), VecDeque::new());
        Self { filter, lag, past, window, backward, spare: None }
    }

    /// One time step under a control, which drives the transition that leads
    /// here: prediction, update, and back through the window. Returns
    /// ln p(y_k | y_1 … y_{k-1}).
    ///
    /// # Errors
    ///
    /// As [`Filter::step_with`].
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<f64, InferenceError> {
        self.advance(control, |filter| filter.step_with(control, observation))
    }

    /// One time step without an observation.
    ///
    /// # Errors
    ///
    /// As [`Filter::predict_with`].
    pub fn predict_with(&mut self, control: &A::Control) -> Result<(), InferenceError> {
        self.advance(control, |filter| filter.predict_with(control))
    }

    /// p(X_j | y_1 … y_k) at the far end of the window: j = k − L, or 0 until
    /// there are more steps. It will not be revised.
    #[must_use]
    pub fn lagged(&self) -> BeliefView<'_> {
        Belief::view(&self.window[self.window.len() - 1])
    }

    /// p(X_j | y_1 … y_k) for a step j of the window, k − L to k (from 0 on);
    /// `None` outside. After the last observation these are the rest of the
    /// smoothed drive.
    #[must_use]
    pub fn get(&self, step: usize) -> Option<BeliefView<'_>> {
        let back = self.filter.steps().checked_sub(step)?;
        self.window.get(back).map(|gamma| Belief::view(gamma))
    }

    /// The filter inside: present belief, log-likelihood, steps, forecasts.
    #[must_use]
    pub fn filter(&self) -> &Filter<M> {
        &self.filter
    }

    /// The lag, L.
    #[must_use]
    pub fn lag(&self) -> usize {
        self.lag
    }

    /// A copy of all that the smoother knows. One that is
    /// [restored](Self::restore) from it goes on with identical bits.
    #[must_use]
    pub fn snapshot(&self) -> FixedLagState<A::Control> {
        let past = self.past.iter().cloned().collect();
        FixedLagState { lag: self.lag, present: self.filter.snapshot(), past }
    }

    /// Goes back (or over) to a snapshot, and takes over its lag.
    ///
    /// # Errors
    ///
    /// [`InferenceError::StateCount`] if it has another number of states, or
    /// [`InferenceError::Control`] for a control that is not one of the model.
    /// The smoother then is as before.
    pub fn restore(&mut self, snapshot: &FixedLagState<A::Control>) -> Result<(), InferenceError> {
        let before = self.snapshot();
        self.filter.restore(&snapshot.present)?;
        self.replace(snapshot).or_else(|error| {
            self.filter.restore(&before.present)?;
            self.replace(&before)?;
            Err(error)
        })
    }

    /// Back to the prior, with no steps taken.
    pub fn restart(&mut self) {
        self.filter.restart();
        self.past.clear();
        self.window.truncate(1);
        self.window[0].copy_from_slice(self.filter.belief().as_slice());
    }

    fn replace(&mut self, state: &FixedLagState<A::Control>) -> Result<(), InferenceError> {
        self.lag = state.lag;
        self.past = state.past.iter().cloned().collect();
        self.smooth()
    }

    fn advance<R>(
        &mut self,
        control: &A::Control,
        step: impl FnOnce(&mut Filter<M>) -> Result<R, InferenceError>,
    ) -> Result<R, InferenceError> {
        let mut before = self.spare.take().unwrap_or_else(|| self.filter.snapshot());
        self.filter.snapshot_to(&mut before);
        match step(&mut self.filter) {
            Ok(result) => {
                self.past.push_back((before, control.clone()));
                if let Err(error) = self.smooth() {
                    // The operator breaks its contract: back to where it did not.
                    if let Some((before, _)) = self.past.pop_back() {
                        self.filter.restore(&before)?;
                    }
                    self.smooth()?;
                    return Err(error);
                }
                if self.past.len() > self.lag {
                    self.spare = self.past.pop_front().map(|oldest| oldest.0);
                }
                Ok(result)
            }
            Err(error) => {
                self.spare = Some(before);
                Err(error)
            }
        }
    }

    /// From the filtered belief back through the window.
    fn smooth(&mut self) -> Result<(), InferenceError> {
        let Self { filter, lag, past, window, backward, .. } = self;
        let back = past.len().min(*lag);
        window.resize_with(back + 1, || vec![0.0; filter.belief().states()]);
        window[0].copy_from_slice(filter.belief().as_slice());
        for (row, (state, control)) in (1..=back).zip(past.iter().rev()) {
            let number = state.steps() + 1;
            let control = filter.model().prior().moves_at(number).then_some(control);
            let step = Step { hmm: filter.model(), number, control };
            backward.retreat(&step, state.held(), &window[row - 1])?;
            window[row].copy_from_slice(&backward.gamma);
        }
        Ok(())
    }
}

impl<M, A, B> FixedLag<M, ()>
where
    M: Deref<Target = Hmm<A, B>>,
    A: Transition<Control = ()>,
    B: Likelihood,
{
    /// One time step: prediction, update, and back through the window. Returns
    /// ln p(y_k | y_1 … y_{k-1}).
    ///
    /// # Errors
    ///
    /// As [`Filter::step_with`].
    pub fn step(&mut self, observation: &B::Observation) -> Result<f64, InferenceError> {
        self.step_with(&(), observation)
    }

    /// One time step without an observation.
    ///
    /// # Errors
    ///
    /// As [`Filter::predict_with`].
    pub fn predict(&mut self) -> Result<(), InferenceError> {
        self.predict_with(&())
    }
}
