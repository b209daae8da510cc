//! Checks of operators and of their parameters, each with an error of its own that names the index
//! and the value. Comparisons are written so that a NaN fails them.

use crate::belief::SUM_TOLERANCE;
use crate::error::{OutOfRange, TransitionError};
use wayfix_kernels as kernels;

/// Checks that all column sums are one.
pub(crate) fn check_columns(sums: &[f64]) -> Result<(), TransitionError> {
    let one = 1.0 - SUM_TOLERANCE..=1.0 + SUM_TOLERANCE;
    match sums.iter().position(|sum| !one.contains(sum)) {
        Some(column) => Err(TransitionError::ColumnSum { column, sum: sums[column] }),
        None => Ok(()),
    }
}

/// Checks the columns of a stored matrix as [`check_columns`]; if its rows sum to one instead, it
/// was given as its transpose, and the error says so.
pub(crate) fn check_columns_of(
    sums: &[f64],
    row: impl Fn(usize) -> f64,
) -> Result<(), TransitionError> {
    // Rows are summed only after a failure: a valid matrix costs nothing more.
    check_columns(sums).map_err(|error| match error {
        TransitionError::ColumnSum { column, sum }
            if (0..sums.len()).all(|i| (row(i) - 1.0).abs() <= SUM_TOLERANCE) =>
        {
            TransitionError::RowsSumToOne { column, sum }
        }
        error => error,
    })
}

/// Checks that a count fits 32-bit indices; `what` names the counted things in errors.
///
/// # Errors
///
/// [`TransitionError::TooMany`] for 2^32 or more.
pub fn check_count(what: &'static str, count: usize) -> Result<(), TransitionError> {
    if u32::try_from(count).is_err() {
        return Err(TransitionError::TooMany { what, count });
    }
    Ok(())
}

/// Checks that values are probabilities that sum to one; `whole` names the sum in errors, and
/// `name` each value.
///
/// # Errors
///
/// [`TransitionError::Parameter`] for a value that is NaN, negative or infinite, or for a sum that is not one
/// within 1e-9.
pub fn check_sum(
    values: &[f64],
    whole: String,
    name: impl Fn(usize) -> String,
) -> Result<(), TransitionError> {
    if let Some(at) = values.iter().position(|&value| !(value >= 0.0 && value.is_finite())) {
        let expected = "a finite value of at least 0";
        return Err(OutOfRange::new(name(at), values[at], expected).into());
    }
    let sum = kernels::sum(values);
    if (sum - 1.0).abs() > SUM_TOLERANCE {
        return Err(OutOfRange::new(whole, sum, "1").into());
    }
    Ok(())
}

/// Checks that a value is from 0 to 1; `what` names it in errors.
///
/// # Errors
///
/// [`TransitionError::Parameter`] for any other value, and for NaN.
pub fn check_probability(value: f64, what: impl FnOnce() -> String) -> Result<(), TransitionError> {
    if !(0.0..=1.0).contains(&value) {
        let expected = "a value from 0 to 1";
        return Err(OutOfRange::new(what(), value, expected).into());
    }
    Ok(())
}

/// Checks that the slices of a product have one value per state. Inference guarantees it; direct
/// callers must.
///
/// # Panics
///
/// Otherwise.
pub fn check_slices(states: usize, x: &[f64], out: &[f64]) {
    assert_eq!(x.len(), states, "x must have one value per state");
    assert_eq!(out.len(), states, "out must have one value per state");
}

/// Checks that there is at least one row, and that each has as many values as there are rows.
pub(crate) fn check_rows<R: AsRef<[f64]>>(rows: &[R]) -> Result<(), TransitionError> {
    let expected = rows.len();
    if expected == 0 {
        return Err(TransitionError::Empty);
    }
    let lengths = rows.iter().map(|row| row.as_ref().len()).enumerate();
    match lengths.into_iter().find(|(_, found)| *found != expected) {
        Some((row, found)) => Err(TransitionError::RowLength { row, found, expected }),
        None => Ok(()),
    }
}

/// Checks that a slice has n × n values, with n above 0.
pub(crate) fn check_square(states: usize, found: usize) -> Result<(), TransitionError> {
    if states == 0 {
        return Err(TransitionError::Empty);
    }
    // n × n may overflow, and then no slice is that long.
    if states.checked_mul(states) != Some(found) {
        return Err(TransitionError::WrongLength { states, found });
    }
    Ok(())
}

/// Checks a sum of probabilities that was read.
#[cfg(feature = "serde")]
pub(crate) fn check_one(value: f64, what: impl FnOnce() -> String) -> Result<(), TransitionError> {
    if (value - 1.0).abs() > SUM_TOLERANCE {
        return Err(OutOfRange::new(what(), value, "1").into());
    }
    Ok(())
}
