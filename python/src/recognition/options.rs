//! Options of a recogniser, with short forms for `off_map` and `speeds`; distances of descriptors
//! by name.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use wayfix_recognition::Options;
use wayfix_recognition::motion::Speeds;
use wayfix_recognition::observation::Distance;

use crate::error::{invalid, reserve};
use crate::options::replaced;

/// Returns options with those of a dictionary replaced.
pub(super) fn options(before: &Options, given: Option<&Bound<'_, PyDict>>) -> PyResult<Options> {
    let mut before = before.clone();
    let off_map = before.off_map().unwrap_or_default();
    // Rates may be given in part. If none are set yet, the defaults are set first: merged into
    // null, the given part alone would remain.
    if given.is_some_and(|given| given.contains("off_map").unwrap_or(false)) {
        before = before.with_off_map(Some(off_map));
    }
    replaced(&before, given, |given| {
        // True stands for the previous rates, and False for none.
        match given.get_mut("off_map") {
            Some(value @ Value::Bool(true)) => *value = stored(&off_map)?,
            Some(value @ Value::Bool(false)) => *value = Value::Null,
            _ => {}
        }
        let usual = |values: Value| {
            let values: Vec<f64> = serde_json::from_value(values)
                .map_err(|error| invalid(format!("speeds: {error}")))?;
            stored(&Speeds::new(&values).map_err(invalid)?)
        };
        match given.get_mut("speeds") {
            Some(value @ Value::Array(_)) => *value = usual(value.take())?,
            // A grid without shares gets the usual ones: the previous shares belong to another
            // grid, and may be of another length.
            Some(Value::Object(parts)) if !parts.contains_key("shares") => {
                if let Some(values) = parts.get("values") {
                    parts.insert("shares".into(), usual(values.clone())?["shares"].take());
                }
            }
            _ => {}
        }
        Ok(())
    })
}

fn stored<T: serde::Serialize>(value: &T) -> PyResult<Value> {
    serde_json::to_value(value).map_err(invalid)
}

/// Raises MemoryError if the tables for the references would not fit into memory, where the library
/// would abort.
pub(super) fn check_memory(references: usize, options: &Options) -> PyResult<()> {
    let speeds = options.speeds().values().len();
    // Beyond the range of indices of one mode, the library returns an error before it allocates.
    if references.saturating_mul(speeds + 1) > u32::MAX as usize {
        return Ok(());
    }
    // Nine numbers of 8 bytes for each speed at each reference, and thirteen more, as measured. Below
    // the limit above, the product does not overflow.
    reserve(references * 8 * (9 * speeds + 13), || format!("{references} references"))
}

/// Returns the distance with this name.
pub(super) fn distance(name: &str) -> PyResult<Distance> {
    match name {
        "cosine" => Ok(Distance::Cosine),
        "euclidean" => Ok(Distance::Euclidean),
        _ => Err(invalid(format!("the distance is {name:?}, expected 'cosine' or 'euclidean'"))),
    }
}

/// Returns the name of a distance.
pub(super) fn name(distance: Distance) -> &'static str {
    match distance {
        Distance::Cosine => "cosine",
        Distance::Euclidean => "euclidean",
    }
}
