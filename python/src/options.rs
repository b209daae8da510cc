//! Options by their names: a dictionary over the library's own, in the form in which it stores
//! them.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::invalid;

/// Returns options with those of a dictionary replaced, and fields of fields too; one that does
/// not exist is an error. `prepare` may change what was given first.
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
    serde_json::from_value(all).map_err(|error| invalid(format!("options: {error}")))
}

/// Returns a value with its fields as Python's dictionaries, lists and numbers.
pub(crate) fn to_python<'py, T: Serialize>(
    py: Python<'py>,
    value: &T,
) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(invalid)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Returns the fields of a dictionary, in which arrays are lists.
pub(crate) fn from_python(given: &Bound<'_, PyDict>) -> PyResult<Value> {
    let py = given.py();
    // Numpy's scalars and arrays have this method.
    let plain = py.eval(c"lambda value: value.tolist()", None, None)?;
    let named = PyDict::new(py);
    named.set_item("default", plain)?;
    named.set_item("allow_nan", false)?;
    let text = py.import("json")?.call_method("dumps", (given,), Some(&named));
    let text: String = text.map_err(|error| invalid(format!("options: {error}")))?.extract()?;
    serde_json::from_str(&text).map_err(|error| invalid(format!("options: {error}")))
}

/// Replaces fields, and fields of fields.
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
