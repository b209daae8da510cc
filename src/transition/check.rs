//! Checks of operators and of their parameters.

use std::any::Any;

use super::Transition;
use crate::belief::{Belief, SUM_TOLERANCE};
use crate::error::TransitionError;
use crate::kernels;

/// Checks an operator without a control: its columns sum to one, A' 1 = 1 (but for
/// evidence on moves), and its two products are transposes, v' (A u) = u' (A' v). An
/// operator with a control can't be checked without one.
pub(crate) fn validate<A: Transition>(transition: &A) -> Result<(), TransitionError> {
    let n = transition.states();
    if n == 0 {
        return Err(TransitionError::Empty);
    }
    let Some(control) = (&() as &dyn Any).downcast_ref::<A::Control>() else {
        return Ok(());
    };
    transition.check_control(control)?;
    let (mut ones, mut product) = (vec![1.0; n], vec![0.0; n]);
    transition.apply_transpose(control, &ones, &mut product);
    match transition.evidence(control) {
        None => check_columns(&product)?,
        Some(_) if transition.needs_logs(control) => return Ok(()),
        Some(_) => {}
    }
    // Two vectors without a pattern that an operator could have in common: multiples of the
    // golden ratio and of the square root of two, modulo one.
    let (golden, root) = (0.618_033_988_749_894_9, std::f64::consts::SQRT_2);
    let v: Vec<f64> = (1..=n).map(|i| 0.5 + (i as f64 * golden).fract()).collect();
    ones.iter_mut().zip(1..).for_each(|(u, i)| *u = 0.5 + (f64::from(i) * root).fract());
    transition.apply(control, &ones, &mut product);
    let forward = kernels::dot(&product, &v);
    transition.apply_transpose(control, &v, &mut product);
    let backward = kernels::dot(&product, &ones);
    let close = (forward - backward).abs() <= 1e-9 * forward.abs();
    if close { Ok(()) } else { Err(TransitionError::Transpose { forward, backward }) }
}

/// Checks that all column sums are one.
pub(super) fn check_columns(sums: &[f64]) -> Result<(), TransitionError> {
    let one = 1.0 - SUM_TOLERANCE..=1.0 + SUM_TOLERANCE;
    match sums.iter().position(|sum| !one.contains(sum)) {
        Some(column) => Err(TransitionError::ColumnSum { column, sum: sums[column] }),
        None => Ok(()),
    }
}

/// [`check_columns`] of a stored matrix: if its rows sum to one instead, it was given as
/// its transpose, and the error says so.
pub(super) fn check_columns_of(
    sums: &[f64],
    row: impl Fn(usize) -> f64,
) -> Result<(), TransitionError> {
    check_columns(sums).map_err(|error| match error {
        TransitionError::ColumnSum { column, sum }
            if (0..sums.len()).all(|i| (row(i) - 1.0).abs() <= SUM_TOLERANCE) =>
        {
            TransitionError::RowsSumToOne { column, sum }
        }
        error => error,
    })
}

/// Checks that a count fits 32-bit indices.
pub(crate) fn check_count(what: &'static str, count: usize) -> Result<(), TransitionError> {
    if u32::try_from(count).is_err() {
        return Err(TransitionError::TooMany { what, count });
    }
    Ok(())
}

/// Checks that values are probabilities that sum to one; `whole` names the sum in errors.
pub(crate) fn check_sum(
    values: &[f64],
    whole: String,
    name: impl Fn(usize) -> String,
) -> Result<(), TransitionError> {
    if let Some(at) = values.iter().position(|&value| !(value >= 0.0 && value.is_finite())) {
        let expected = "a finite value of at least 0";
        return Err(TransitionError::Parameter { what: name(at), value: values[at], expected });
    }
    let sum = kernels::sum(values);
    if (sum - 1.0).abs() > SUM_TOLERANCE {
        return Err(TransitionError::Parameter { what: whole, value: sum, expected: "1" });
    }
    Ok(())
}

/// Multiplies a belief by a rate; an error if a product underflows.
pub(crate) fn scaled(belief: Belief, rate: f64, what: &str) -> Result<Vec<f64>, TransitionError> {
    let mut values = belief.into_vec();
    for (state, r) in values.iter_mut().enumerate() {
        let value = *r * rate;
        if *r > 0.0 && rate > 0.0 && value < f64::MIN_POSITIVE {
            let what = format!("the probability of {what} state {state}");
            let expected = "0 or at least 2.2e-308, the smallest normal double";
            return Err(TransitionError::Parameter { what, value, expected });
        }
        *r = value;
    }
    Ok(values)
}

pub(crate) fn check_probability(
    value: f64,
    what: impl FnOnce() -> String,
) -> Result<(), TransitionError> {
    if !(0.0..=1.0).contains(&value) {
        let expected = "a value from 0 to 1";
        return Err(TransitionError::Parameter { what: what(), value, expected });
    }
    Ok(())
}

/// Asserts the lengths of a product's slices. Inference ensures them; direct callers have to.
pub(crate) fn check_slices(states: usize, x: &[f64], out: &[f64]) {
    assert_eq!(x.len(), states, "x must have one value per state");
    assert_eq!(out.len(), states, "out must have one value per state");
}

/// Refuses inner operators with evidence, for operators that add moves without a likelihood of
/// the measurements.
pub(super) fn refuse_evidence<A: Transition>(
    inner: &A,
    control: &A::Control,
    operator: &str,
) -> Result<(), TransitionError> {
    inner.check_control(control)?;
    if inner.evidence(control).is_some() {
        let text = format!("evidence on moves within a {operator}, which does not take it");
        return Err(TransitionError::Control(text));
    }
    Ok(())
}
