//! Covariances: nested lists of numbers in Python, flattened by rows in the library's stored form.
//!
//! The stored form has a list for each state, and in it, for a mixture, one for each part:
//! `[v]` if spherical, d variances if diagonal, d² numbers if full. Tied covariances are one list
//! for all states (or parts), so they lack that axis in Python.

use serde_json::Value;

use crate::error::invalid;
use pyo3::prelude::*;

/// Place and form of the covariances among the parameters of a family.
pub(super) struct Form<'a> {
    /// Name of their field.
    field: &'static str,
    kind: &'a str,
    /// Number of axes before those of one covariance: states, and in a mixture parts.
    axes: usize,
}

/// Finds the covariances among the parameters of a family, and replaces hmmlearn's "diag" by
/// "diagonal".
fn form<'a>(family: &str, parameters: &'a mut Value) -> Option<Form<'a>> {
    let (named, field, axes) = match family {
        "gaussian" => ("covariance_type", "covariances", 1),
        "gaussian_mixture" => ("covariance_type", "covariances", 2),
        "student_t" => ("scale_type", "scales", 1),
        "linear_regression" => {
            let is_full = parameters.get("full").and_then(Value::as_bool).unwrap_or(false);
            return Some(Form {
                field: "covariances",
                kind: if is_full { "full" } else { "diagonal" },
                axes: 1,
            });
        }
        _ => return None,
    };
    // A missing type is left to the family's own error.
    let kind = parameters.get_mut(named)?;
    if kind == "diag" {
        *kind = Value::from("diagonal");
    }
    Some(Form { field, kind: kind.as_str()?, axes })
}

/// Replaces matrices by their stored form.
pub(super) fn pack(family: &str, parameters: &mut Value) -> PyResult<()> {
    changed(family, parameters, &|one, kind| match (kind, &*one) {
        ("spherical", Value::Number(_)) => {
            *one = Value::Array(vec![one.take()]);
            Ok(())
        }
        ("spherical", _) => Err("a number"),
        ("diagonal", _) => Ok(()),
        (_, Value::Array(rows)) => {
            // Square, and of numbers alone: flattened, a ragged matrix might pass for another.
            let values = |row: &Value| {
                let row = row.as_array()?;
                (row.len() == rows.len() && row.iter().all(Value::is_number)).then(|| row.clone())
            };
            let all: Option<Vec<Vec<Value>>> = rows.iter().map(values).collect();
            let packed = Value::Array(all.ok_or("a square matrix")?.concat());
            *one = if kind == "tied" { Value::Array(vec![packed]) } else { packed };
            Ok(())
        }
        _ => Err("a square matrix"),
    })
}

/// Replaces the stored form by matrices: the inverse of [`pack`].
pub(super) fn unpack(family: &str, parameters: &mut Value) -> PyResult<()> {
    changed(family, parameters, &|one, kind| {
        let Value::Array(values) = one else { return Ok(()) };
        // Both types have the number or the matrix in a list of one.
        if matches!(kind, "spherical" | "tied") {
            *one = values.first_mut().map_or(Value::Null, Value::take);
        }
        if matches!(kind, "full" | "tied") {
            let Value::Array(values) = one else { return Ok(()) };
            // d² numbers in d rows.
            let rows = values.chunks(values.len().isqrt().max(1));
            *one = Value::Array(rows.map(|row| Value::Array(row.to_vec())).collect());
        }
        Ok(())
    })
}

type Change<'a> = &'a dyn Fn(&mut Value, &str) -> Result<(), &'static str>;

/// Changes each covariance of a family.
fn changed(family: &str, parameters: &mut Value, change: Change<'_>) -> PyResult<()> {
    let Some(Form { field, kind, axes }) = form(family, parameters) else { return Ok(()) };
    let kind = kind.to_owned();
    let Some(all) = parameters.get_mut(field) else { return Ok(()) };
    // A tied matrix serves all states, or all parts of a state.
    let axes = if kind == "tied" { axes - 1 } else { axes };
    each(all, axes, &|one| change(one, &kind)).map_err(|expected| {
        let count = ["", " for each state", " for each part of each state"][axes];
        invalid(format!("{field} of type {kind:?} are not valid, expected {expected}{count}"))
    })
}

fn each(
    value: &mut Value,
    axes: usize,
    change: &dyn Fn(&mut Value) -> Result<(), &'static str>,
) -> Result<(), &'static str> {
    match value {
        _ if axes == 0 => change(value),
        Value::Array(values) => values.iter_mut().try_for_each(|v| each(v, axes - 1, change)),
        _ => Err("a list"),
    }
}
