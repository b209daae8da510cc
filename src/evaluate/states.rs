//! Estimated states against true ones.

use super::EvaluationError;
use super::check::check_lengths;

/// The fraction of states that were estimated correctly (paper eq. 15). O(N).
///
/// ```
/// use wayfix::evaluate;
///
/// assert_eq!(evaluate::accuracy(&[0, 1, 2, 2], &[0, 1, 1, 2])?, 0.75);
/// # Ok::<(), evaluate::EvaluationError>(())
/// ```
///
/// # Errors
///
/// [`EvaluationError`] if the slices differ in length or are empty.
pub fn accuracy(truth: &[usize], estimate: &[usize]) -> Result<f64, EvaluationError> {
    check_lengths(truth, estimate)?;
    if truth.is_empty() {
        return Err(EvaluationError::Empty);
    }
    let right = truth.iter().zip(estimate).filter(|(i, j)| i == j).count();
    Ok(right as f64 / truth.len() as f64)
}

/// The mean distance from the true to the estimated state, by any measure:
/// hops or metres of a map, for instance, looked up in a table. O(N).
///
/// ```
/// use wayfix::evaluate;
///
/// let (truth, estimate) = ([0, 1, 2, 2], [0, 1, 1, 2]);
/// let hops = evaluate::mean_error(&truth, &estimate, |i, j| i.abs_diff(j) as f64)?;
/// assert_eq!(hops, 0.25);
/// # Ok::<(), evaluate::EvaluationError>(())
/// ```
///
/// # Errors
///
/// [`EvaluationError`] if the slices differ in length or are empty.
pub fn mean_error(
    truth: &[usize],
    estimate: &[usize],
    mut distance: impl FnMut(usize, usize) -> f64,
) -> Result<f64, EvaluationError> {
    check_lengths(truth, estimate)?;
    if truth.is_empty() {
        return Err(EvaluationError::Empty);
    }
    let sum: f64 = truth.iter().zip(estimate).map(|(&i, &j)| distance(i, j)).sum();
    Ok(sum / truth.len() as f64)
}
