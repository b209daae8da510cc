//! Checks of parameters and observations, with the errors for invalid ones.

use super::EmissionError;

/// Floor for the log density of a possible observation, to tell it from −∞, an impossible one. It
/// is below what a diagonal may hold: an error, not a density of 0.
pub(super) const LOWEST: f64 = -1e301;

/// Variance relative to the mean square below which it is only rounding.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Returns a parameter if it is valid.
pub(super) fn check(
    what: &'static str,
    value: f64,
    valid: bool,
    expected: &'static str,
) -> Result<f64, EmissionError> {
    let (state, component) = (None, None);
    if valid {
        Ok(value)
    } else {
        Err(EmissionError::Parameter { what, state, component, value, expected })
    }
}

/// Checks the length of a list of parameters, for one state or common to all.
pub(super) fn check_length(
    what: &'static str,
    state: Option<usize>,
    found: usize,
    expected: usize,
) -> Result<(), EmissionError> {
    if found == expected {
        return Ok(());
    }
    Err(EmissionError::Length { what, state, found, expected })
}

/// Checks the number of components of an observation.
#[inline]
pub(super) fn check_components(row: &[f64], expected: usize) -> Result<(), EmissionError> {
    let found = row.len();
    if found == expected { Ok(()) } else { Err(EmissionError::Components { found, expected }) }
}

/// Checks the components of an observation.
pub(super) fn check_values(
    row: &[f64],
    is_valid: impl Fn(f64) -> bool,
    expected: &'static str,
) -> Result<(), EmissionError> {
    match row.iter().copied().enumerate().find(|(_, value)| !is_valid(*value)) {
        None => Ok(()),
        Some((component, value)) => Err(EmissionError::Observation { component, value, expected }),
    }
}

/// Returns the numbers of states and components of parameters with one row for each state.
pub(super) fn shape<R: AsRef<[T]>, T>(
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
pub(super) fn check_shape<R: AsRef<[T]>, T>(
    what: &'static str,
    rows: &[R],
    (states, components): (usize, usize),
) -> Result<(), EmissionError> {
    check_length(what, None, rows.len(), states)?;
    let mut rows = rows.iter().enumerate();
    rows.try_for_each(|(state, row)| {
        check_length(what, Some(state), row.as_ref().len(), components)
    })
}

/// Checks that parameters are finite, and returns those of all states, one row after the other.
pub(super) fn flatten<R: AsRef<[f64]>>(
    what: &'static str,
    rows: &[R],
    components: usize,
) -> Result<Vec<f64>, EmissionError> {
    let mut all = Vec::with_capacity(rows.len() * components);
    for (state, row) in rows.iter().enumerate() {
        check_length(what, Some(state), row.as_ref().len(), components)?;
        for (component, &value) in row.as_ref().iter().enumerate() {
            let finite = check(what, value, value.is_finite(), "a finite value");
            all.push(finite.map_err(|error| at(error, state, Some(component)))?);
        }
    }
    Ok(all)
}

/// Adds the state and the component to the error of a distribution.
pub(super) fn at(mut error: EmissionError, at: usize, of: Option<usize>) -> EmissionError {
    if let EmissionError::Parameter { state, component, .. }
    | EmissionError::TooFew { state, component, .. } = &mut error
    {
        (*state, *component) = (Some(at), of);
    }
    error
}

/// Returns a variance, or another measure of spread, unless it is only rounding.
pub(super) fn spread(
    what: &'static str,
    weight: f64,
    variance: f64,
    square: f64,
) -> Result<f64, EmissionError> {
    // The variance is a difference of terms of the size of the mean square, each rounded: below
    // some units in the last place of that, nothing of it is known. NaN and infinity fail as well.
    if variance > ROUNDING * square && square.is_finite() {
        return Ok(variance);
    }
    let reason = "they are all alike, which leaves the spread undetermined; give a prior";
    Err(EmissionError::TooFew { state: None, component: None, what, weight, reason })
}
