//! Recall of places within a tolerance.

use std::ops::RangeInclusive;

use super::EvaluationError;
use super::check::check_lengths;

/// True if an estimated place lies in the range of true places, or at most
/// `tolerance` places from one of its ends.
///
/// ```
/// use wayfix::evaluate;
///
/// assert!(evaluate::is_within(&(7..=9), 5, 2)?);
/// assert!(!evaluate::is_within(&(7..=9), 4, 2)?);
/// # Ok::<(), evaluate::EvaluationError>(())
/// ```
///
/// # Errors
///
/// [`EvaluationError::EmptyRange`] for a range such as 3..=2.
pub fn is_within(
    truth: &RangeInclusive<usize>,
    estimate: usize,
    tolerance: usize,
) -> Result<bool, EvaluationError> {
    if truth.is_empty() {
        return Err(EvaluationError::EmptyRange { index: None, range: truth.clone() });
    }
    let first = truth.start().saturating_sub(tolerance);
    let last = truth.end().saturating_add(tolerance);
    Ok((first..=last).contains(&estimate))
}

/// Recall at rank 1: the fraction of the queries taken on the map whose estimate is
/// [within](is_within) `tolerance` places of the truth. O(N).
///
/// `truth[i]` is the range of places that query i shows, or `None` if it shows none of the map.
/// `estimates[i]` is the estimated place, or `None` for "not on the map", which is a miss for a
/// query on the map. Queries off the map do not count, whatever the answer.
///
/// ```
/// use wayfix::evaluate;
///
/// let truth = [Some(0..=2), Some(5..=5), Some(8..=9), None];
/// let estimates = [Some(1), Some(7), None, Some(3)];
/// assert_eq!(evaluate::recall_within(&truth, &estimates, 0)?, 1.0 / 3.0);
/// assert_eq!(evaluate::recall_within(&truth, &estimates, 2)?, 2.0 / 3.0);
/// # Ok::<(), evaluate::EvaluationError>(())
/// ```
///
/// # Errors
///
/// [`EvaluationError`] if the slices differ in length, if a range is empty, or
/// if no query is on the map.
pub fn recall_within(
    truth: &[Option<RangeInclusive<usize>>],
    estimates: &[Option<usize>],
    tolerance: usize,
) -> Result<f64, EvaluationError> {
    check_lengths(truth, estimates)?;
    let (mut found, mut on_map) = (0_usize, 0_usize);
    for (index, (places, estimate)) in truth.iter().zip(estimates).enumerate() {
        let Some(places) = places else { continue };
        if places.is_empty() {
            let range = places.clone();
            return Err(EvaluationError::EmptyRange { index: Some(index), range });
        }
        on_map += 1;
        if let Some(estimate) = *estimate {
            found += usize::from(is_within(places, estimate, tolerance)?);
        }
    }
    if on_map == 0 {
        return Err(EvaluationError::Missing { what: "queries on the map" });
    }
    Ok(found as f64 / on_map as f64)
}
