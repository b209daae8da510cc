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

use crate::transition::TransitionEntries;

/// Why estimates cannot be scored.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// Truth and estimate differ in length.
    #[error("{estimated} estimates for {truth} true states, expected one each")]
    Length {
        /// True states given.
        truth: usize,
        /// Estimates given.
        estimated: usize,
    },
    /// Nothing to score.
    #[error("no states to score, expected at least one")]
    Empty,
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
/// O(path × ways out of a state).
///
/// The path starts with its first state: to check the move into it as well,
/// put the state before it in front.
///
/// # Errors
///
/// [`EvaluationError::State`] for a state that does not exist.
pub fn illegal_moves<A: TransitionEntries<Control = ()>>(
    transition: &A,
    path: &[usize],
) -> Result<usize, EvaluationError> {
    let states = transition.states();
    if let Some(index) = path.iter().position(|&state| state >= states) {
        return Err(EvaluationError::State { index, state: path[index], states });
    }
    let illegal = |moved: &&[usize]| !transition.outgoing(&(), moved[0]).any(|to| to.0 == moved[1]);
    Ok(path.windows(2).filter(illegal).count())
}
