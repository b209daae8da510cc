//! Comparisons of numbers and of results.

use std::fmt::Debug;

use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;
use wayfix::HmmError;
use wayfix::inference::SequenceError;

use super::NEVER;

/// Equal up to this share of the expected value, or of `floor` if that is larger.
#[track_caller]
pub fn close(found: f64, expected: f64, tolerance: f64, floor: f64) -> TestCaseResult {
    let within = (found - expected).abs() <= tolerance * expected.abs().max(floor);
    if found == expected || within {
        return Ok(());
    }
    let place = std::panic::Location::caller();
    Err(TestCaseError::fail(format!("found {found:e}, expected {expected:e}, at {place}")))
}

/// Equal logarithms, up to this share of them, or of 1 if that is larger.
#[track_caller]
pub fn close_logs(found: f64, expected: f64, tolerance: f64) -> TestCaseResult {
    close(found, expected, tolerance, 1.0)
}

/// [`close`], number by number.
#[track_caller]
pub fn all_close(found: &[f64], expected: &[f64], tolerance: f64, floor: f64) -> TestCaseResult {
    prop_assert_eq!(found.len(), expected.len());
    for (&found, &expected) in found.iter().zip(expected) {
        close(found, expected, tolerance, floor)?;
    }
    Ok(())
}

/// The bits of numbers, for comparisons that tell 0 from −0.
pub fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// ln Σ exp.
pub fn log_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = terms.clone().fold(NEVER, f64::max);
    if largest == NEVER {
        return NEVER;
    }
    largest + terms.map(|term| (term - largest).exp()).sum::<f64>().ln()
}

/// Replaces `sum` by ln(e^sum + e^log).
pub fn log_add(sum: &mut f64, log: f64) {
    let (high, low) = if *sum > log { (*sum, log) } else { (log, *sum) };
    *sum = if low == NEVER { high } else { high + (low - high).exp().ln_1p() };
}

/// Compares results of many sequences with those of each by itself: close values, or the same error
/// with the number of its sequence.
pub fn same_results<R: Debug>(
    many: &[Result<R, SequenceError>],
    count: usize,
    one: impl Fn(usize) -> Result<R, HmmError>,
    near: impl Fn(&R, &R) -> bool,
) -> TestCaseResult {
    prop_assert_eq!(many.len(), count);
    for (index, found) in many.iter().enumerate() {
        match (found, one(index)) {
            (Ok(found), Ok(expected)) => {
                prop_assert!(near(found, &expected), "{index}: {found:?}, expected {expected:?}");
            }
            (Err(found), Err(expected)) => {
                prop_assert_eq!(found.sequence, index);
                prop_assert_eq!(found.source.to_string(), expected.to_string());
            }
            (found, expected) => prop_assert!(false, "{found:?}, expected {expected:?}"),
        }
    }
    Ok(())
}
