//! Fixed-lag smoother: a live estimate of the step L steps ago that takes the observations since
//! then into account (sections 3 and 5 of the [formulas](crate::guide::formulas)).
//!
//! It is a filter with a window of its last states and has no recursion of its own: after each step
//! it goes back through the window, as the batch smoother does through the whole sequence.

use std::collections::VecDeque;
use std::ops::Deref;

use super::filter::Filter;
use crate::belief::{Belief, BeliefView};
use crate::error::HmmError;
use crate::hmm::{Hmm, ModelPointer};
use crate::inference::step::Step;
use crate::inference::step::forward_backward::Backward;
use crate::inference::step::state::FilterSnapshot;
use crate::likelihood::Likelihood;
use crate::transition::{NoControl, Transition};

/// Fixed-lag smoother: after each step k, p(X_j | y_1 … y_k) for the last steps j = k − L … k.
///
/// It goes back from the filtered belief through the window, as the batch smoother does. Up to
/// rounding, the result equals that of [`Hmm::smooth`] for the observations so far. A step costs
/// one product for the filter and two for each step of the window, O(L) products in all; memory is
/// 2 n (L + 1) numbers. Once the window is full, steps and updates allocate nothing. After an error
/// the smoother is as it was before the call.
///
/// `M` is a pointer to the model, as for [`Filter`].
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
/// // Belief of two steps ago, after all five sightings.
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
    window: Window<U>,
    /// γ of the present step, of the previous one, and so on; further rows are spare memory.
    smoothed: Vec<Vec<f64>>,
    backward: Backward,
    /// Memory of states that have left the window.
    spare: Vec<FilterSnapshot>,
}

impl<A: Transition<Control: Clone>, B: Likelihood> Hmm<A, B> {
    /// Returns a smoother at the prior that looks back `lag` steps and borrows the model. With a
    /// lag of 0 it is the filter.
    #[must_use]
    pub fn fixed_lag(&self, lag: usize) -> FixedLag<&Self, A::Control> {
        FixedLag::new(self, lag)
    }
}

impl<M, U> FixedLag<M, U> {
    /// Creates a smoother at the prior, with any pointer to a model.
    #[must_use]
    pub fn new(model: M, lag: usize) -> Self
    where
        M: ModelPointer<Transition: Transition<Control = U>>,
    {
        let backward = Backward::new(model.hmm().states());
        let smoothed = vec![model.hmm().prior().belief().as_slice().to_vec()];
        let window = Window { lag, past: VecDeque::new() };
        Self { filter: Filter::new(model), window, smoothed, backward, spare: Vec::new() }
    }
}

impl<M, A, B> FixedLag<M, A::Control>
where
    M: Deref<Target = Hmm<A, B>>,
    A: Transition<Control: Clone>,
    B: Likelihood,
{
    /// Takes one time step under a control, which drives the transition to this step: prediction,
    /// update, and the backward pass through the window. Returns ln p(y_k | y_1 … y_{k-1}).
    ///
    /// # Errors
    ///
    /// As [`Filter::step_with`].
    pub fn step_with(
        &mut self,
        control: &A::Control,
        observation: &B::Observation,
    ) -> Result<f64, HmmError> {
        self.advance(Some(control), |filter| filter.step_with(control, observation))
    }

    /// Takes one time step without an observation.
    ///
    /// # Errors
    ///
    /// As [`Filter::predict_with`].
    pub fn predict_with(&mut self, control: &A::Control) -> Result<(), HmmError> {
        self.advance(Some(control), |filter| filter.predict_with(control))
    }

    /// Updates with an observation alone, without a time step: for another sensor at the same
    /// step, or after [`predict_with`](Self::predict_with). All steps of the window take it into
    /// account, as if it had come with the last observation. Returns the logarithm of its
    /// probability given everything before.
    ///
    /// Before any step it acts as [`Filter::update`] does. Costs as much as a step, less the
    /// product of the prediction.
    ///
    /// # Errors
    ///
    /// As [`Filter::step_with`].
    pub fn update(&mut self, observation: &B::Observation) -> Result<f64, HmmError> {
        self.advance(None, |filter| filter.update(observation))
    }

    /// Replaces the present belief, for example when a vehicle is told where it is, or is lost.
    /// The number of steps and the log-likelihood do not change.
    ///
    /// The window restarts with the present step alone and grows from there: after a relocation,
    /// observations say nothing about the steps before it.
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the belief has another number of states.
    pub fn relocate(&mut self, belief: &Belief) -> Result<(), HmmError> {
        self.filter.relocate(belief)?;
        self.begin();
        Ok(())
    }

    /// Smoothed distribution p(X_j | y_1 … y_k) at the far end of the window: j = k − L or, as long
    /// as the window is shorter, the step of the last [relocation](Self::relocate) (0 without one).
    /// Once the window is full, no later step revises it.
    #[must_use]
    pub fn lagged(&self) -> BeliefView<'_> {
        Belief::view(&self.smoothed[self.window.past.len()])
    }

    /// Smoothed distribution p(X_j | y_1 … y_k) of a step j in the window, from k − L (or the last
    /// relocation) to k; `None` outside. After the last observation these complete the smoothed
    /// sequence.
    ///
    /// Under [`Prior::AtFirstObservation`](crate::Prior::AtFirstObservation) X_0 is
    /// the same state as X_1, and `get(0)` equals `get(1)`, also after a relocation at step 1.
    #[must_use]
    pub fn get(&self, step: usize) -> Option<BeliefView<'_>> {
        // Under a prior at the first observation no move leads to X_1, and the window has no entry
        // for X_0, which shares the row of X_1.
        let steps = self.filter.steps();
        let back = steps.checked_sub(step).filter(|back| *back <= self.window.lag)?;
        let same = step == 0 && steps > 0 && !self.filter.model().prior().moves_at(1);
        let row = back - usize::from(same);
        (row <= self.window.past.len()).then(|| Belief::view(&self.smoothed[row]))
    }

    /// The filter inside, with present belief, log-likelihood, steps and forecasts.
    #[must_use]
    pub fn filter(&self) -> &Filter<M> {
        &self.filter
    }

    /// Number of steps taken in logarithms so far, as counted by
    /// [`FilterSnapshot::steps_in_logs`]. While such a step is in the window, the backward pass
    /// over it is in logarithms too.
    #[must_use]
    pub fn steps_in_logs(&self) -> usize {
        self.filter.steps_in_logs()
    }

    /// The lag, L.
    #[must_use]
    pub fn lag(&self) -> usize {
        self.window.lag
    }

    /// Returns a copy of the smoother's state. A smoother that is [restored](Self::restore) from
    /// it continues with identical bits.
    #[must_use]
    pub fn snapshot(&self) -> FixedLagSnapshot<A::Control> {
        FixedLagSnapshot { present: self.filter.snapshot(), window: self.window.clone() }
    }

    /// Restores a snapshot of this smoother or another, and adopts its lag. Only the number of
    /// states and the controls are checked: store a version of the model with snapshots that
    /// outlive it.
    ///
    /// # Errors
    ///
    /// [`HmmError::StateCount`] if the snapshot has another number of states, or
    /// [`HmmError::Control`] for a control that is not valid for the model. The smoother is
    /// then unchanged.
    pub fn restore(&mut self, snapshot: &FixedLagSnapshot<A::Control>) -> Result<(), HmmError> {
        // The controls are checked by the backward pass, which needs the window in place. So it is
        // replaced first, and put back if the pass fails.
        let before = self.snapshot();
        self.replace(snapshot).or_else(|error| {
            self.replace(&before)?;
            Err(error)
        })
    }

    /// Goes back to the prior, before the first step.
    pub fn restart(&mut self) {
        self.filter.restart();
        self.begin();
    }

    /// Restarts the window at the present belief.
    fn begin(&mut self) {
        self.spare.extend(self.window.past.drain(..).map(|(state, _)| state));
        self.smoothed[0].copy_from_slice(self.filter.belief().as_slice());
    }

    fn replace(&mut self, state: &FixedLagSnapshot<A::Control>) -> Result<(), HmmError> {
        self.filter.restore(&state.present)?;
        self.window.clone_from(&state.window);
        self.smooth()
    }

    /// Takes a step under a control, or an update without one.
    fn advance<R>(
        &mut self,
        control: Option<&A::Control>,
        step: impl FnOnce(&mut Filter<M>) -> Result<R, HmmError>,
    ) -> Result<R, HmmError> {
        // The previous state is kept even for an update, which adds nothing to the window, because
        // the backward pass may fail after the filter has taken the step.
        let mut before = self.spare.pop().unwrap_or_else(|| self.filter.snapshot());
        self.filter.snapshot_to(&mut before);
        let result = match step(&mut self.filter) {
            Ok(result) => result,
            Err(error) => {
                self.spare.push(before);
                return Err(error);
            }
        };
        // Only a step with a transition adds to the window. `unmoved` keeps the state before any
        // other step, for the case of an error.
        let moves = self.filter.model().prior().moves_at(before.steps() + 1);
        let unmoved = match control.filter(|_| moves) {
            Some(control) => {
                self.window.past.push_back((before, control.clone()));
                None
            }
            None => Some(before),
        };
        if let Err(error) = self.smooth() {
            // The operator breaks its contract: restore the state before the step. The backward
            // pass through its window succeeded before, so it does not fail now.
            if let Some(before) = unmoved.or_else(|| self.window.past.pop_back().map(|last| last.0))
            {
                self.filter.restore(&before)?;
                self.spare.push(before);
            }
            self.smooth()?;
            return Err(error);
        }
        self.spare.extend(unmoved);
        if self.window.past.len() > self.window.lag {
            self.spare.extend(self.window.past.pop_front().map(|oldest| oldest.0));
        }
        Ok(result)
    }

    fn smooth(&mut self) -> Result<(), HmmError> {
        let Self { filter, window, smoothed, backward, .. } = self;
        window.smooth(filter.model(), filter.belief().as_slice(), smoothed, backward)
    }

    /// Takes one time step: prediction, update, and the backward pass through the window. Returns
    /// ln p(y_k | y_1 … y_{k-1}).
    ///
    /// # Errors
    ///
    /// As [`Filter::step_with`].
    pub fn step(&mut self, observation: &B::Observation) -> Result<f64, HmmError>
    where
        A::Control: NoControl,
    {
        self.step_with(&A::Control::NONE, observation)
    }

    /// Takes one time step without an observation.
    ///
    /// # Errors
    ///
    /// As [`Filter::predict_with`].
    pub fn predict(&mut self) -> Result<(), HmmError>
    where
        A::Control: NoControl,
    {
        self.predict_with(&A::Control::NONE)
    }
}

/// State of a fixed-lag smoother: plain data that can be kept, compared, sent elsewhere and
/// restored.
///
/// Made by [`FixedLag::snapshot`](crate::FixedLag::snapshot), and
/// [stored](crate::guide::storing) with the controls of the window (feature `serde`).
#[derive(Debug, Clone, PartialEq)]
pub struct FixedLagSnapshot<U> {
    present: FilterSnapshot,
    window: Window<U>,
}

/// Filter states of the steps that may still be smoothed.
#[derive(Debug, Clone, PartialEq)]
struct Window<U> {
    /// The lag, L.
    lag: usize,
    /// State of the filter before each of the last moves (at most L, oldest first), with the
    /// control of the move.
    past: VecDeque<(FilterSnapshot, U)>,
}

impl<U> Window<U> {
    /// Goes back from the filtered belief through the window, and writes a row for each step.
    fn smooth<A: Transition<Control = U>, B: Likelihood>(
        &self,
        hmm: &Hmm<A, B>,
        filtered: &[f64],
        smoothed: &mut Vec<Vec<f64>>,
        backward: &mut Backward,
    ) -> Result<(), HmmError> {
        // During a step the window holds one extra state, until this backward pass has succeeded.
        let back = self.past.len().min(self.lag);
        if smoothed.len() <= back {
            smoothed.resize_with(back + 1, || vec![0.0; filtered.len()]);
        }
        // At the present step smoothed and filtered beliefs are the same by definition. The steps
        // back recompute predictions, since the observations of the window were not kept.
        smoothed[0].copy_from_slice(filtered);
        for (row, (state, control)) in (1..=back).zip(self.past.iter().rev()) {
            let step = Step::after(hmm, state.steps(), control)?;
            let (gammas, out) = smoothed.split_at_mut(row);
            backward.step_back(&step, state.belief_ref(), &gammas[row - 1], &mut out[0])?;
        }
        Ok(())
    }
}

#[cfg(feature = "serde")]
impl<U> FixedLagSnapshot<U> {
    /// Creates a snapshot from parts that may be damaged.
    fn checked(
        lag: usize,
        present: FilterSnapshot,
        past: VecDeque<(FilterSnapshot, U)>,
    ) -> Result<Self, String> {
        let (found, steps) = (past.len(), present.steps);
        // A window may be shorter than min(L, k): after a relocation, and under a prior at the
        // first observation, where no move leads to step 1.
        if found > lag.min(steps) {
            return Err(format!(
                "{found} past states after {steps} steps with a lag of {lag}, expected at most {}",
                lag.min(steps)
            ));
        }
        // The states are of consecutive steps, and the last is that of the previous step.
        for (index, (state, _)) in past.iter().enumerate() {
            let expected = steps - found + index;
            if state.steps != expected {
                let found = state.steps;
                return Err(format!("past state {index} is of step {found}, expected {expected}"));
            }
            let (found, expected) = (state.belief.len(), present.belief.len());
            if found != expected {
                return Err(format!(
                    "past state {index} is over {found} states, expected {expected} as the present one"
                ));
            }
        }
        Ok(Self { present, window: Window { lag, past } })
    }
}

#[cfg(feature = "serde")]
crate::stored! {
    [U] FixedLagSnapshot<U>: [U], |state| {
        lag: usize = state.window.lag,
        present: FilterSnapshot = state.present,
        past: VecDeque<(FilterSnapshot, U)> = state.window.past,
    } => self::FixedLagSnapshot::checked(lag, present, past);
}
