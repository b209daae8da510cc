//! Moves of a path that the operator forbids.

use super::EvaluationError;
use super::check::check_lengths;
use crate::transition::TransitionEntries;

/// Counts the moves of a path that the operator does not allow; 0 for a legal drive.
/// The sequence of posterior modes may have some,
/// [`Hmm::viterbi`](crate::Hmm::viterbi) has none.
/// O(path × ways out of a state).
///
/// To check the move into the first state as well, put the state before it in front.
///
/// ```
/// use wayfix::{SparseTransition, evaluate};
///
/// let ahead = SparseTransition::from_triplets(3, [(1, 0, 1.0), (2, 1, 1.0), (2, 2, 1.0)])?;
/// assert_eq!(evaluate::illegal_moves(&ahead, &[0, 1, 0, 2])?, 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`EvaluationError::State`] for a state that does not exist.
pub fn illegal_moves<A: TransitionEntries<Control = ()>>(
    transition: &A,
    path: &[usize],
) -> Result<usize, EvaluationError> {
    illegal_moves_with(transition, &vec![(); path.len()], path)
}

/// Counts [`illegal_moves`] under controls: `controls[i]` drives the move to `path[i]`, and the
/// first one is ignored.
///
/// # Errors
///
/// As [`illegal_moves`], [`EvaluationError::Length`] unless there is a control
/// for each state, or [`EvaluationError::Control`] for one that is not valid.
pub fn illegal_moves_with<A: TransitionEntries>(
    transition: &A,
    controls: &[A::Control],
    path: &[usize],
) -> Result<usize, EvaluationError> {
    check_lengths(path, controls)?;
    let states = transition.states();
    if let Some(index) = path.iter().position(|&state| state >= states) {
        return Err(EvaluationError::State { index, state: path[index], states });
    }
    let mut illegal = 0;
    for (index, moved) in (1..).zip(path.windows(2)) {
        let control = &controls[index];
        transition
            .check_control(control)
            .map_err(|cause| EvaluationError::control(index, cause))?;
        let allowed = transition.outgoing(control, moved[0]).any(|to| to.0 == moved[1]);
        illegal += usize::from(!allowed);
    }
    Ok(illegal)
}
