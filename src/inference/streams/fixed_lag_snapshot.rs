//! State of a fixed-lag smoother as plain data, its backward pass through the window (sections 3
//! and 5 of the [formulas](crate::guide::formulas)), and its bytes. (Its self-describing format is
//! in the module `persistence`, since it is generic in the type of controls.)

use std::collections::VecDeque;

use super::bytes::{Kind, Reader, Writer, contents};
use crate::error::{InferenceError, SnapshotError};
use crate::hmm::Hmm;
use crate::inference::step::Step;
use crate::inference::step::forward_backward::Backward;
use crate::inference::step::state::FilterSnapshot;
use crate::likelihood::Likelihood;
use crate::transition::Transition;

/// State of a fixed-lag smoother: plain data that can be kept, compared, sent elsewhere and
/// restored.
///
/// Made by [`FixedLag::snapshot`](crate::FixedLag::snapshot). [`to_bytes`](Self::to_bytes) stores
/// it; for a model with controls, [`to_bytes_with`](Self::to_bytes_with) does, with the controls of
/// the window.
#[derive(Debug, Clone, PartialEq)]
pub struct FixedLagSnapshot<U> {
    pub(crate) present: FilterSnapshot,
    pub(crate) window: Window<U>,
}

/// Filter states of the steps that may still be smoothed.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Window<U> {
    /// The lag, L.
    pub(crate) lag: usize,
    /// State of the filter before each of the last moves (at most L, oldest first), with the
    /// control of the move.
    pub(crate) past: VecDeque<(FilterSnapshot, U)>,
}

impl<U> Window<U> {
    /// Goes back from the filtered belief through the window, and writes a row for each step.
    pub(crate) fn smooth<A: Transition<Control = U>, B: Likelihood>(
        &self,
        hmm: &Hmm<A, B>,
        filtered: &[f64],
        smoothed: &mut Vec<Vec<f64>>,
        backward: &mut Backward,
    ) -> Result<(), InferenceError> {
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

impl<U> FixedLagSnapshot<U> {
    /// Creates a snapshot from parts that may be damaged.
    pub(crate) fn checked(
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
        // The states are of consecutive steps, and the last is of the step before the present one.
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

impl FixedLagSnapshot<()> {
    /// Returns the state as bytes, for a model without controls. The size is about that of L + 1
    /// [filter states](FilterSnapshot::to_bytes).
    ///
    /// ```
    /// # use wayfix::inference::FixedLagSnapshot;
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let hmm = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?, LikelihoodVector::linear(2))?;
    /// let mut smoother = hmm.fixed_lag(2);
    /// smoother.step(&[0.9, 0.2])?;
    /// let bytes = smoother.snapshot().to_bytes();
    /// assert_eq!(FixedLagSnapshot::from_bytes(&bytes)?, smoother.snapshot());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        self.to_bytes_with(|(), _| ())
    }

    /// Reads a state from bytes.
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not of such a state.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        Self::from_bytes_with(bytes, |control| control.is_empty().then_some(()))
    }
}

impl<U> FixedLagSnapshot<U> {
    /// Returns the state as bytes. `write` appends the bytes of a control, of any length.
    ///
    /// ```
    /// # use wayfix::inference::FixedLagSnapshot;
    /// # use wayfix::transition::SwitchedTransition;
    /// # use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
    /// # let prior = Prior::BeforeFirstTransition(Belief::uniform(2)?);
    /// # let a = DenseTransition::from_rows(&[[0.9, 0.1], [0.1, 0.9]])?;
    /// # let hmm = Hmm::new(prior, SwitchedTransition::new(vec![a])?, LikelihoodVector::linear(2))?;
    /// let mut smoother = hmm.fixed_lag(2);
    /// smoother.step_with(&0, &[0.9, 0.2])?;
    /// let state = smoother.snapshot();
    /// let bytes = state.to_bytes_with(|gear: &usize, out| out.push(*gear as u8));
    /// let read = |bytes: &[u8]| bytes.first().map(|gear| usize::from(*gear));
    /// assert_eq!(FixedLagSnapshot::from_bytes_with(&bytes, read)?, state);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn to_bytes_with(&self, mut write: impl FnMut(&U, &mut Vec<u8>)) -> Vec<u8> {
        Writer::whole(Kind::FixedLag, |out| {
            out.integer(self.window.lag);
            self.present.write(out);
            out.integer(self.window.past.len());
            let mut bytes = Vec::new();
            for (state, control) in &self.window.past {
                state.write(out);
                bytes.clear();
                write(control, &mut bytes);
                out.integer(bytes.len());
                out.bytes.extend_from_slice(&bytes);
            }
        })
    }

    /// Reads a state from bytes. `read` decodes a control from the bytes that were written for it,
    /// or returns `None` if they are invalid.
    ///
    /// # Errors
    ///
    /// [`SnapshotError`] if the bytes are damaged, or not of such a state.
    pub fn from_bytes_with(
        bytes: &[u8],
        mut read: impl FnMut(&[u8]) -> Option<U>,
    ) -> Result<Self, SnapshotError> {
        let state = |from: &mut Reader<'_>| FilterSnapshot::read(from)?.checked().map_err(contents);
        let (lag, present, past) = Reader::whole(bytes, Kind::FixedLag, |from| {
            let (lag, present) = (from.integer()?, state(from)?);
            // No capacity in advance: the count may be damaged. Reading fails when bytes run out.
            let mut past = VecDeque::new();
            for index in 0..from.integer()? {
                let state = state(from)?;
                let length = from.integer()?;
                let control = read(from.take(length)?).ok_or(SnapshotError::Control { index })?;
                past.push_back((state, control));
            }
            Ok((lag, present, past))
        })?;
        Self::checked(lag, present, past).map_err(contents)
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
