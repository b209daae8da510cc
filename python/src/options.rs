//! Options by name: a dictionary is merged into the library's options in their serialized form.
//!
//! So Python has the names and the checks of the stored form, and an option that is new in the
//! library needs no code here.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::invalid;

/// Returns options with those of a dictionary replaced, at any depth; an unknown one is an error.
/// `prepare` may change the dictionary's fields before they are merged.
pub(crate) fn replaced<T: Serialize + DeserializeOwned>(
    options: &T,
    given: Option<&Bound<'_, PyDict>>,
    prepare: impl FnOnce(&mut Value) -> PyResult<()>,
) -> PyResult<T> {
    let mut all = serde_json::to_value(options).map_err(invalid)?;
    if let Some(given) = given {
        let mut given = from_python(given)?;
        prepare(&mut given)?;
        merge(&mut all, given);
    }
    // Unknown names were merged like all others; the types refuse them (`deny_unknown_fields`).
    serde_json::from_value(all).map_err(|error| invalid(format!("options: {error}")))
}

/// Returns a value with its fields as Python's dictionaries, lists and numbers.
pub(crate) fn to_python<'py, T: Serialize>(
    py: Python<'py>,
    value: &T,
) -> PyResult<Bound<'py, PyAny>> {
    // Through text, which has the shortest digits of a double: both sides read back the same bits.
    let text = serde_json::to_string(value).map_err(invalid)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Returns the fields of a dictionary, with arrays as lists.
pub(crate) fn from_python(given: &Bound<'_, PyDict>) -> PyResult<Value> {
    let py = given.py();
    // `json` calls this for objects that it does not know: numpy's scalars and arrays have
    // `tolist`, and anything else raises.
    let plain = py.eval(c"lambda value: value.tolist()", None, None)?;
    let named = PyDict::new(py);
    named.set_item("default", plain)?;
    // JSON has no NaN: without this, Python would write a word that no parser here accepts.
    named.set_item("allow_nan", false)?;
    let text = py.import("json")?.call_method("dumps", (given,), Some(&named));
    let text: String = text.map_err(|error| invalid(format!("options: {error}")))?.extract()?;
    serde_json::from_str(&text).map_err(|error| invalid(format!("options: {error}")))
}

/// Replaces fields, and within fields that are objects on both sides, theirs.
pub(crate) fn merge(all: &mut Value, given: Value) {
    match (all, given) {
        (Value::Object(all), Value::Object(given)) => {
            for (name, value) in given {
                merge(all.entry(name).or_insert(Value::Null), value);
            }
        }
        (all, given) => *all = given,
    }
}
