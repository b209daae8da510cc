//! Estimated states against true ones, and against the moves that an operator allows.

use super::check_lengths;
use crate::error::{OutOfRange, TransitionError};
use crate::transition::TransitionEntries;

/// Fraction of states that were estimated correctly (paper eq. 15). O(N).
///
/// ```
/// use wayfix::evaluate;
///
/// assert_eq!(evaluate::accuracy(&[0, 1, 2, 2], &[0, 1, 1, 2])?, 0.75);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if the slices differ in length or are empty.
pub fn accuracy(truth: &[usize], estimate: &[usize]) -> Result<f64, OutOfRange> {
    mean_error(truth, estimate, |i, j| f64::from(u8::from(i == j)))
}

/// Mean distance from the true to the estimated state, by any measure: hops or metres of a map, for
/// instance, looked up in a table. O(N).
///
/// ```
/// use wayfix::evaluate;
///
/// let (truth, estimate) = ([0, 1, 2, 2], [0, 1, 1, 2]);
/// let hops = evaluate::mean_error(&truth, &estimate, |i, j| i.abs_diff(j) as f64)?;
/// assert_eq!(hops, 0.25);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if the slices differ in length or are empty.
pub fn mean_error(
    truth: &[usize],
    estimate: &[usize],
    mut distance: impl FnMut(usize, usize) -> f64,
) -> Result<f64, OutOfRange> {
    check_lengths(truth, estimate)?;
    if truth.is_empty() {
        return Err(OutOfRange::none("the number of states"));
    }
    let sum: f64 = truth.iter().zip(estimate).map(|(&i, &j)| distance(i, j)).sum();
    Ok(sum / truth.len() as f64)
}

/// Counts the moves of a path that the operator does not allow; 0 for a legal drive. The sequence
/// of posterior modes may have some, [`Hmm::viterbi`](crate::Hmm::viterbi) has none. O(path × ways
/// out of a state).
///
/// To check the move into the first state as well, put its predecessor in front.
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
/// [`TransitionError::Parameter`] for a state that does not exist.
pub fn illegal_moves<A: TransitionEntries<Control = ()>>(
    transition: &A,
    path: &[usize],
) -> Result<usize, TransitionError> {
    illegal_moves_with(transition, &vec![(); path.len()], path)
}

/// Counts [`illegal_moves`] under controls: `controls[i]` belongs to the move to `path[i]`, and the
/// first one is ignored.
///
/// # Errors
///
/// As [`illegal_moves`]; [`TransitionError::Parameter`] unless there is a control for each state, or
/// [`TransitionError::Control`] for one that is not valid, with its index.
pub fn illegal_moves_with<A: TransitionEntries>(
    transition: &A,
    controls: &[A::Control],
    path: &[usize],
) -> Result<usize, TransitionError> {
    check_lengths(path, controls)?;
    let states = transition.states();
    // All states are checked first: operators may panic for a state that they do not have.
    if let Some(index) = path.iter().position(|&state| state >= states) {
        let what = format!("state {index} of the path");
        return Err(OutOfRange::index(what, path[index], states).into());
    }
    let mut illegal = 0;
    // The move to `path[index]` from the previous state, hence controls from 1.
    for (index, moved) in (1..).zip(path.windows(2)) {
        let control = &controls[index];
        transition
            .check_control(control)
            .map_err(|e| TransitionError::Control(format!("control {index} is not valid: {e}")))?;
        let allowed = transition.outgoing(control, moved[0]).any(|to| to.0 == moved[1]);
        illegal += usize::from(!allowed);
    }
    Ok(illegal)
}
