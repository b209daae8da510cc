//! Options of a recogniser, and how descriptors are compared.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use wayfix_recognition::motion::Speeds;
use wayfix_recognition::observation::Distance;
use wayfix_recognition::Options;

use crate::error::{invalid, reserve};
use crate::options::replaced;

/// Returns options with those of a dictionary replaced.
pub(super) fn options(before: &Options, given: Option<&Bound<'_, PyDict>>) -> PyResult<Options> {
    let mut before = before.clone();
    let off_map = before.off_map.unwrap_or_default();
    // Rates may be given in part, over those of before.
    if given.is_some_and(|given| given.contains("off_map").unwrap_or(false)) {
        before.off_map = Some(off_map);
    }
    replaced(&before, given, |given| {
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
            // Shares of another grid are none of this one.
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

/// Raises MemoryError for more references than there is memory, which would end the process.
pub(super) fn check_memory(references: usize, options: &Options) -> PyResult<()> {
    let speeds = options.speeds.values().len();
    // What is beyond the library's indices it refuses by itself.
    if references.saturating_mul(speeds + 1) > u32::MAX as usize {
        return Ok(());
    }
    // Three numbers for each speed at each reference, and some more.
    reserve(references * 24 * (speeds + 2), || format!("{references} references"))
}

/// Returns the comparison of a name.
pub(super) fn distance(name: &str) -> PyResult<Distance> {
    match name {
        "cosine" => Ok(Distance::Cosine),
        "euclidean" => Ok(Distance::Euclidean),
        _ => Err(invalid(format!("the distance is {name:?}, expected 'cosine' or 'euclidean'"))),
    }
}

/// Returns the name of a comparison.
pub(super) fn name(distance: Distance) -> &'static str {
    match distance {
        Distance::Cosine => "cosine",
        Distance::Euclidean => "euclidean",
    }
}
