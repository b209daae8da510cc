//! Checks of parameters with one row for each state.

use crate::emission::EmissionError;

/// Returns the numbers of states and components of parameters with one row for each state.
pub(in super::super) fn shape<T, R: AsRef<[T]>>(
    what: &'static str,
    rows: &[R],
) -> Result<(usize, usize), EmissionError> {
    let (states, components) = (rows.len(), rows.first().map_or(0, |row| row.as_ref().len()));
    if states == 0 || components == 0 {
        return Err(EmissionError::Empty { states, components });
    }
    check_shape(what, rows, (states, components)).map(|()| (states, components))
}

/// Checks the numbers of states and components of further parameters.
pub(in super::super) fn check_shape<T, R: AsRef<[T]>>(
    what: &'static str,
    rows: &[R],
    (states, components): (usize, usize),
) -> Result<(), EmissionError> {
    if rows.len() != states {
        let (found, expected) = (rows.len(), states);
        return Err(EmissionError::Length { what, state: None, found, expected });
    }
    for (state, row) in rows.iter().enumerate() {
        let (found, expected) = (row.as_ref().len(), components);
        if found != expected {
            return Err(EmissionError::Length { what, state: Some(state), found, expected });
        }
    }
    Ok(())
}

/// Adds state and component to the error of a distribution.
pub(in super::super) fn at(
    error: EmissionError,
    state: usize,
    component: Option<usize>,
) -> EmissionError {
    let state = Some(state);
    match error {
        EmissionError::Parameter { what, value, expected, .. } => {
            EmissionError::Parameter { what, state, component, value, expected }
        }
        EmissionError::TooFew { what, weight, reason, .. } => {
            EmissionError::TooFew { state, component, what, weight, reason }
        }
        other => other,
    }
}
