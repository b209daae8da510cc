//! Number of steps until a belief is localised.

use super::EvaluationError;
use super::check::{check_level, check_probabilities};

/// Number of steps until the belief is in one place: the first step at
/// which its mass there is at least `level`, or `None` if there is none. O(T).
///
/// `masses[k - 1]` is the mass of the belief around its mode after step k, as
/// steps are numbered from 1. It may lie above 1 by 1e-9, as the sum of a
/// belief may. A belief in one place may be in the wrong one:
/// [`steps_to_localize_correctly`] checks that, too.
///
/// ```
/// use wayfix::evaluate;
///
/// let masses = [0.1, 0.3, 0.9, 0.7, 0.95];
/// assert_eq!(evaluate::steps_to_localize(&masses, 0.9)?, Some(3));
/// assert_eq!(evaluate::steps_to_localize(&masses, 0.99)?, None);
/// # Ok::<(), evaluate::EvaluationError>(())
/// ```
///
/// # Errors
///
/// [`EvaluationError`] if a mass is NaN or not from 0 to 1, or if `level` is
/// not from 0 to 1.
pub fn steps_to_localize(masses: &[f64], level: f64) -> Result<Option<usize>, EvaluationError> {
    check_level(level)?;
    check_probabilities("mass", masses.iter().copied())?;
    Ok(masses.iter().position(|&mass| mass >= level).map(|index| index + 1))
}

/// Number of steps until the belief is in the right place and stays
/// there: the first step at which its mass is at least `level` and from which
/// on it is right for `hold` steps, including this one. O(T).
///
/// `steps[k - 1]` is, after step k, the mass of the belief around its mode and
/// whether the mode is right. The mass need not stay at `level`. A sequence that
/// ends before `hold` steps are over is not localised. With a `hold` of 0
/// nothing need be right, as for [`steps_to_localize`].
///
/// ```
/// use wayfix::evaluate;
///
/// // Sure of a wrong place first, then right but unsure, then right for good.
/// let steps = [(0.9, false), (0.5, true), (0.9, true), (0.8, true), (0.9, true)];
/// assert_eq!(evaluate::steps_to_localize_correctly(&steps, 0.9, 3)?, Some(3));
/// assert_eq!(evaluate::steps_to_localize_correctly(&steps, 0.9, 4)?, None);
/// # Ok::<(), evaluate::EvaluationError>(())
/// ```
///
/// # Errors
///
/// As [`steps_to_localize`].
pub fn steps_to_localize_correctly(
    steps: &[(f64, bool)],
    level: f64,
    hold: usize,
) -> Result<Option<usize>, EvaluationError> {
    check_level(level)?;
    check_probabilities("mass", steps.iter().map(|step| step.0))?;
    // Backwards, to count for how long it stays right.
    let (mut right_for, mut first) = (0, None);
    for (index, &(mass, right)) in steps.iter().enumerate().rev() {
        right_for = if right { right_for + 1 } else { 0 };
        if mass >= level && right_for >= hold {
            first = Some(index + 1);
        }
    }
    Ok(first)
}
