//! Checks of whole operators by products: two that cost O(n) memory and need no entries.

use super::{Transition, check_columns, constant_control};
use crate::error::TransitionError;
use wayfix_kernels as kernels;

/// Checks an operator that is the same at every step, by [`validate_with`]. An operator with a
/// control can't be checked without one, except for its number of states.
pub(crate) fn validate<A: Transition>(transition: &A) -> Result<(), TransitionError> {
    match constant_control::<A>() {
        Some(control) => validate_with(transition, control),
        None if transition.states() == 0 => Err(TransitionError::Empty),
        None => Ok(()),
    }
}

/// Checks the operator of a control: its columns sum to one, A' 1 = 1 (unless it has evidence on
/// moves), and its two products are transposes, v' (A u) = u' (A' v).
///
/// # Errors
///
/// [`TransitionError`] with the column or the products that are wrong.
pub fn validate_with<A: Transition>(
    transition: &A,
    control: &A::Control,
) -> Result<(), TransitionError> {
    let n = transition.states();
    if n == 0 {
        return Err(TransitionError::Empty);
    }
    transition.check_control(control)?;
    let (mut ones, mut product) = (vec![1.0; n], vec![0.0; n]);
    transition.apply_transpose(control, &ones, &mut product);
    match transition.evidence(control) {
        None => check_columns(&product)?,
        // Entries beyond doubles would make the test below fail, or pass, by chance.
        Some(_) if transition.needs_logs(control) => return Ok(()),
        Some(_) => {}
    }
    // Two vectors with no pattern that an operator could share: multiples of the golden ratio and
    // of the square root of two, modulo one. A product with both is one number for all n² entries,
    // and differs for nearly all pairs of products that are not transposes.
    let (golden, root) = (0.618_033_988_749_894_9, std::f64::consts::SQRT_2);
    let v: Vec<f64> = (1..=n).map(|i| 0.5 + (i as f64 * golden).fract()).collect();
    ones.iter_mut().zip(1..).for_each(|(u, i)| *u = 0.5 + (f64::from(i) * root).fract());
    transition.apply(control, &ones, &mut product);
    let forward = kernels::dot(&product, &v);
    transition.apply_transpose(control, &v, &mut product);
    let backward = kernels::dot(&product, &ones);
    // With evidence both may overflow, and then say nothing.
    let close = forward == backward || (forward - backward).abs() <= 1e-9 * forward.abs();
    if close { Ok(()) } else { Err(TransitionError::Transpose { forward, backward }) }
}

/// Refuses inner operators with evidence, for wrappers whose own moves have no likelihood of the
/// measurement.
///
/// # Errors
///
/// [`TransitionError::Control`] with the name of the wrapper, `operator`.
pub fn refuse_evidence<A: Transition>(
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
