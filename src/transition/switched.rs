//! [`SwitchedTransition`]: one of several operators at each step, chosen by the control.

use super::{Stored, Transition, TransitionEntries, delegate};
use crate::error::TransitionError;

/// A family of operators. The control of a step is the index of its operator. For gears, times of
/// day, or a matrix for each step.
///
/// ```
/// use wayfix::transition::SwitchedTransition;
/// use wayfix::{Belief, DenseTransition, Hmm, LikelihoodVector, Prior};
///
/// let park = DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]])?;
/// let drive = DenseTransition::from_rows(&[[0.2, 0.0], [0.8, 1.0]])?;
/// let gears = SwitchedTransition::new(vec![park, drive])?;
/// let prior = Prior::BeforeFirstTransition(Belief::certain(2, 0)?);
/// let hmm = Hmm::new(prior, gears, LikelihoodVector::linear(2))?;
///
/// let mut filter = hmm.filter();
/// filter.step_with(&0, &[0.5, 0.5])?;
/// assert_eq!(filter.belief().as_slice(), [1.0, 0.0]);
/// filter.step_with(&1, &[0.5, 0.5])?;
/// assert_eq!(filter.belief().as_slice(), [0.2, 0.8]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SwitchedTransition<A> {
    pub(crate) operators: Vec<A>,
}

impl<A: Transition<Control = ()>> SwitchedTransition<A> {
    /// Creates a family of operators with the same number of states. Control u chooses
    /// `operators[u]`.
    ///
    /// # Errors
    ///
    /// [`TransitionError::Empty`] without operators, [`TransitionError::StateCount`] if
    /// their numbers of states differ, or [`TransitionError::ColumnSum`] for an operator that is
    /// not stochastic.
    pub fn new(operators: Vec<A>) -> Result<Self, TransitionError> {
        let expected = operators.first().ok_or(TransitionError::Empty)?.states();
        for (operator, a) in operators.iter().enumerate() {
            let found = a.states();
            if found != expected {
                return Err(TransitionError::StateCount { operator, found, expected });
            }
            // Validated here, since a model can't check an operator that depends on its control.
            super::validate_with(a, &())?;
        }
        Ok(Self { operators })
    }

    /// The operators, by control.
    #[must_use]
    pub fn operators(&self) -> &[A] {
        &self.operators
    }
}

impl<A: Transition<Control = ()>> Transition for SwitchedTransition<A> {
    type Control = usize;

    delegate!(a, control => a.operators[*control], &(); products evidence needs_logs);

    fn states(&self) -> usize {
        // `new` has checked that there is at least one operator, and that all have the same number
        // of states.
        self.operators[0].states()
    }

    fn has_restarts(&self) -> bool {
        self.operators.iter().any(Transition::has_restarts)
    }

    fn stored(&self, &control: &usize) -> Option<Stored<'_>> {
        self.operators.get(control)?.stored(&())
    }

    fn check_control(&self, &control: &usize) -> Result<(), TransitionError> {
        let count = self.operators.len();
        if control >= count {
            let last = count - 1;
            let text = format!("operator {control}, expected one of {count} (0 to {last})");
            return Err(TransitionError::Control(text));
        }
        self.operators[control].check_control(&())
    }
}

impl<A: TransitionEntries<Control = ()>> TransitionEntries for SwitchedTransition<A> {
    delegate!(a, control => a.operators[*control], &(); all_entries);
}

#[cfg(feature = "serde")]
crate::stored! {
    [A: Transition<Control = ()>] SwitchedTransition<A>: [A], |a| {
        operators: Vec<A> = a.operators,
    } => Self::new(operators);
}
