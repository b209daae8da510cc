//! How good estimates are.
//!
//! ```
//! use wayfix::evaluate;
//!
//! let (truth, estimate) = ([0, 1, 2, 2], [0, 1, 1, 2]);
//! assert_eq!(evaluate::accuracy(&truth, &estimate)?, 0.75);
//! let hops = evaluate::mean_error(&truth, &estimate, |i, j| i.abs_diff(j) as f64)?;
//! assert_eq!(hops, 0.25);
//! # Ok::<(), evaluate::EvaluationError>(())
//! ```

use thiserror::Error;

use crate::error::TransitionError;
use crate::transition::TransitionEntries;

/// Why estimates cannot be scored.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// Truth and estimates, or path and controls, differ in length.
    #[error("{estimated} estimates or controls for {truth} states, expected one each")]
    Length {
        /// States given.
        truth: usize,
        /// Estimates, or controls, given.
        estimated: usize,
    },
    /// Nothing to score.
    #[error("no states to score, expected at least one")]
    Empty,
    /// A control that the operator does not know.
    #[error("control {index} is not valid")]
    Control {
        /// Its index, from 0.
        index: usize,
        /// What was wrong.
        source: TransitionError,
    },
    /// A state beyond the last one.
    #[error("state {state} at index {index} does not exist, there are {states} states (0 to {})", states - 1)]
    State {
        /// Where in the sequence, from 0.
        index: usize,
        /// The state, from 0.
        state: usize,
        /// How many states there are.
        states: usize,
    },
}

/// The fraction of states that were estimated correctly (paper eq. 15).
///
/// # Errors
///
/// [`EvaluationError`] if the slices differ in length or are empty.
pub fn accuracy(truth: &[usize], estimate: &[usize]) -> Result<f64, EvaluationError> {
    check(truth, estimate)?;
    let right = truth.iter().zip(estimate).filter(|(i, j)| i == j).count();
    Ok(right as f64 / truth.len() as f64)
}

/// The mean distance from the true to the estimated state, by any measure:
/// hops or metres of a map, for instance, looked up in a table.
///
/// # Errors
///
/// [`EvaluationError`] if the slices differ in length or are empty.
pub fn mean_error(
    truth: &[usize],
    estimate: &[usize],
    mut distance: impl FnMut(usize, usize) -> f64,
) -> Result<f64, EvaluationError> {
    check(truth, estimate)?;
    let sum: f64 = truth.iter().zip(estimate).map(|(&i, &j)| distance(i, j)).sum();
    Ok(sum / truth.len() as f64)
}

fn check(truth: &[usize], estimate: &[usize]) -> Result<(), EvaluationError> {
    let (truth, estimated) = (truth.len(), estimate.len());
    if truth != estimated {
        return Err(EvaluationError::Length { truth, estimated });
    }
    if truth == 0 {
        return Err(EvaluationError::Empty);
    }
    Ok(())
}

/// How many moves of a path the operator does not allow; 0 for a legal drive.
/// The sequence of posterior modes may have some,
/// [`Hmm::viterbi`](crate::Hmm::viterbi) has none.
/// O(path × ways out of a state).
///
/// The path starts with its first state: to check the move into it as well,
/// put the state before it in front.
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

/// The same under controls, where `controls[i]` drives the move to `path[i]`;
/// the first one is not looked at.
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
    if controls.len() != path.len() {
        return Err(EvaluationError::Length { truth: path.len(), estimated: controls.len() });
    }
    let states = transition.states();
    if let Some(index) = path.iter().position(|&state| state >= states) {
        return Err(EvaluationError::State { index, state: path[index], states });
    }
    let mut illegal = 0;
    for (index, moved) in (1..).zip(path.windows(2)) {
        let control = &controls[index];
        transition
            .check_control(control)
            .map_err(|source| EvaluationError::Control { index, source })?;
        let allowed = transition.outgoing(control, moved[0]).any(|to| to.0 == moved[1]);
        illegal += usize::from(!allowed);
    }
    Ok(illegal)
}
