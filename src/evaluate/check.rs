//! Checks shared by several scores.

use super::EvaluationError;
use crate::belief::SUM_TOLERANCE;
use crate::error::Parameter;

pub(super) fn check_lengths<T, E>(truth: &[T], estimates: &[E]) -> Result<(), EvaluationError> {
    let (truth, estimated) = (truth.len(), estimates.len());
    if truth == estimated { Ok(()) } else { Err(EvaluationError::Length { truth, estimated }) }
}

pub(super) fn check_level(level: f64) -> Result<(), EvaluationError> {
    if (0.0..=1.0).contains(&level) {
        Ok(())
    } else {
        Err(Parameter::new("the level", level, "a value from 0 to 1").into())
    }
}

/// Checks probabilities. As in beliefs, a sum may lie above one by rounding.
pub(super) fn check_probabilities(
    what: &'static str,
    values: impl IntoIterator<Item = f64>,
) -> Result<(), EvaluationError> {
    let valid = 0.0..=1.0 + SUM_TOLERANCE;
    match values.into_iter().enumerate().find(|(_, p)| !valid.contains(p)) {
        Some((index, value)) => {
            let expected = "a value from 0 to 1";
            Err(EvaluationError::Value { what, index, value, expected })
        }
        None => Ok(()),
    }
}
