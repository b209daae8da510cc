//! Checks of the parameters of mixtures.

use crate::EmissionError;
use crate::check::{at, check, check_length};
use wayfix::internal::SUM_TOLERANCE;

/// Checks the weights of all states.
pub(super) fn check_weights(weights: &[f64], parts: usize) -> Result<(), EmissionError> {
    for (state, weights) in weights.chunks_exact(parts).enumerate() {
        for (part, &weight) in weights.iter().enumerate() {
            check("weight", weight, weight >= 0.0, "a value of at least 0")
                .map_err(|error| at(error, state, Some(part)))?;
        }
        let sum: f64 = weights.iter().sum();
        check("sum of the weights", sum, (sum - 1.0).abs() <= SUM_TOLERANCE, "1")
            .map_err(|error| at(error, state, None))?;
    }
    Ok(())
}

/// Checks the parameters of each state's parts, and returns them one after the other.
pub(super) fn of_parts<M: AsRef<[P]>, P>(
    what: &'static str,
    all: &[M],
    [states, parts]: [usize; 2],
    flatten: impl Fn(&[P]) -> Result<Vec<f64>, EmissionError>,
) -> Result<Vec<f64>, EmissionError> {
    check_length(what, None, all.len(), states)?;
    let mut flat = Vec::new();
    for (state, rows) in all.iter().enumerate() {
        check_length(what, Some(state), rows.as_ref().len(), parts)?;
        flat.extend(flatten(rows.as_ref()).map_err(|error| error.in_part(Some(state), parts))?);
    }
    Ok(flat)
}
