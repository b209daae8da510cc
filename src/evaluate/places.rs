//! Places: their recall within a tolerance, and the number of steps until a belief is in one of
//! them.

use std::fmt::Display;
use std::ops::RangeInclusive;

use super::{check_lengths, check_probabilities};
use crate::error::OutOfRange;

/// True if an estimated place lies in the range of true places, or at most
/// `tolerance` places from one of its ends.
///
/// ```
/// use wayfix::evaluate;
///
/// assert!(evaluate::is_within(&(7..=9), 5, 2)?);
/// assert!(!evaluate::is_within(&(7..=9), 4, 2)?);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] for a range such as 3..=2.
pub fn is_within(
    truth: &RangeInclusive<usize>,
    estimate: usize,
    tolerance: usize,
) -> Result<bool, OutOfRange> {
    check_range(truth, "")?;
    // Saturating: any tolerance is valid, up to one that accepts every place.
    let first = truth.start().saturating_sub(tolerance);
    let last = truth.end().saturating_add(tolerance);
    Ok((first..=last).contains(&estimate))
}

/// Checks that a range of true places is not empty; a query off the map has none.
fn check_range(truth: &RangeInclusive<usize>, of: impl Display) -> Result<(), OutOfRange> {
    if truth.is_empty() {
        return Err(OutOfRange::none(format!("the number of places in {truth:?}{of}")));
    }
    Ok(())
}

/// Recall at rank 1: the fraction of the queries taken on the map whose estimate is
/// [within](is_within) `tolerance` places of the truth. O(N).
///
/// `truth[i]` is the range of places that query i shows, or `None` if it shows no place of the map.
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
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if the slices differ in length, if a range is empty, or
/// if no query is on the map.
pub fn recall_within(
    truth: &[Option<RangeInclusive<usize>>],
    estimates: &[Option<usize>],
    tolerance: usize,
) -> Result<f64, OutOfRange> {
    check_lengths(truth, estimates)?;
    let (mut found, mut on_map) = (0_usize, 0_usize);
    for (index, (places, estimate)) in truth.iter().zip(estimates).enumerate() {
        let Some(places) = places else { continue };
        check_range(places, format_args!(" of query {index}"))?;
        on_map += 1;
        if let Some(estimate) = *estimate {
            found += usize::from(is_within(places, estimate, tolerance)?);
        }
    }
    if on_map == 0 {
        return Err(OutOfRange::none("the number of queries on the map"));
    }
    Ok(found as f64 / on_map as f64)
}

/// Number of steps until the belief is in one place: the first step at which its mass there is at
/// least `level`, or `None` if it never is. O(T).
///
/// `masses[k - 1]` is the mass of the belief around its mode after step k, since steps are numbered
/// from 1. It may exceed 1 by 1e-9, as the sum of a belief may. A belief in one place may be in the
/// wrong one: [`steps_to_localize_correctly`] also checks that.
///
/// ```
/// use wayfix::evaluate;
///
/// let masses = [0.1, 0.3, 0.9, 0.7, 0.95];
/// assert_eq!(evaluate::steps_to_localize(&masses, 0.9)?, Some(3));
/// assert_eq!(evaluate::steps_to_localize(&masses, 0.99)?, None);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`] if a mass is NaN or not from 0 to 1, or if `level` is
/// not from 0 to 1.
pub fn steps_to_localize(masses: &[f64], level: f64) -> Result<Option<usize>, OutOfRange> {
    OutOfRange::check("the level", level, 0.0..=1.0, "a value from 0 to 1")?;
    check_probabilities("mass", masses.iter().copied())?;
    Ok(masses.iter().position(|&mass| mass >= level).map(|index| index + 1))
}

/// Number of steps until the belief is in the right place and stays there: the first step at which
/// its mass is at least `level` and, counting this step, it is right for `hold` steps in a row.
/// O(T).
///
/// `steps[k - 1]` is, after step k, the mass of the belief around its mode and whether the mode is
/// right. The mass need not stay at `level`. A sequence that ends before `hold` steps are over is
/// not localised. With a `hold` of 0 nothing need be right, as in [`steps_to_localize`].
///
/// ```
/// use wayfix::evaluate;
///
/// // Sure of a wrong place first, then right but unsure, then right for good.
/// let steps = [(0.9, false), (0.5, true), (0.9, true), (0.8, true), (0.9, true)];
/// assert_eq!(evaluate::steps_to_localize_correctly(&steps, 0.9, 3)?, Some(3));
/// assert_eq!(evaluate::steps_to_localize_correctly(&steps, 0.9, 4)?, None);
/// # Ok::<(), wayfix::error::OutOfRange>(())
/// ```
///
/// # Errors
///
/// As [`steps_to_localize`].
pub fn steps_to_localize_correctly(
    steps: &[(f64, bool)],
    level: f64,
    hold: usize,
) -> Result<Option<usize>, OutOfRange> {
    OutOfRange::check("the level", level, 0.0..=1.0, "a value from 0 to 1")?;
    check_probabilities("mass", steps.iter().map(|step| step.0))?;
    // Backwards, to count how long the estimate stays right; the last assignment is the first such
    // step.
    let (mut right_for, mut first) = (0, None);
    for (index, &(mass, right)) in steps.iter().enumerate().rev() {
        // Number of steps in a row from this one onwards that are right.
        right_for = if right { right_for + 1 } else { 0 };
        if mass >= level && right_for >= hold {
            first = Some(index + 1);
        }
    }
    Ok(first)
}
