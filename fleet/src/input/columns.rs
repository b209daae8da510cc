//! Columns that a sensor needs, and their types.
//!
//! The types alone decide the form, before any row is read, so a table with an unusable column is
//! refused at once.

use std::sync::Arc;

use arrow_schema::{DataType, Field, Schema};

use crate::error::{FleetError, Outcome};
use crate::sensor::{Kind, Sensor};

/// Names of the columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnNames {
    /// Id of the drive.
    pub trace_id: String,
    /// Step, an integer that increases within a drive.
    pub step: String,
    /// Observation: a symbol, a list of numbers, or a list of structs of a state and its
    /// likelihood.
    pub observation: String,
    /// Likelihood of the states that a sparse list does not name; 0 without such a column.
    pub elsewhere: String,
    /// Latitude in degrees, for positions.
    pub latitude: String,
    /// Longitude in degrees, for positions.
    pub longitude: String,
    /// Standard deviation in metres, for positions.
    pub deviation: String,
}

impl Default for ColumnNames {
    fn default() -> Self {
        Self {
            trace_id: "trace_id".to_owned(),
            step: "step".to_owned(),
            observation: "observation".to_owned(),
            elsewhere: "elsewhere".to_owned(),
            latitude: "latitude".to_owned(),
            longitude: "longitude".to_owned(),
            deviation: "deviation".to_owned(),
        }
    }
}

impl ColumnNames {
    /// All names.
    pub(crate) fn all(&self) -> [&str; 7] {
        [
            &self.trace_id,
            &self.step,
            &self.observation,
            &self.elsewhere,
            &self.latitude,
            &self.longitude,
            &self.deviation,
        ]
    }
}

/// Form of a table of drives or results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// One row per step.
    Long,
    /// One row per drive, with lists.
    Nested,
}

/// The columns of a table of drives, found and checked.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Form of the table.
    pub form: Form,
    /// Type of trace ids, `Int64` or `Utf8`.
    pub id_type: DataType,
    /// Names of the columns; the name of an optional column that is absent is empty.
    pub names: ColumnNames,
    /// Sensor of the observations.
    pub sensor: Sensor,
}

impl Layout {
    /// Finds the columns. The type of the observation decides the form: a list where the sensor
    /// takes a symbol, or a list of lists where it takes a list, means nested.
    pub(crate) fn new(schema: &Schema, names: &ColumnNames, sensor: &Sensor) -> Outcome<Self> {
        let id_type = match find(schema, &names.trace_id)?.data_type() {
            DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View => DataType::Utf8,
            DataType::Dictionary(_, value) if value.is_string() => DataType::Utf8,
            integer if integer.is_integer() => DataType::Int64,
            other => {
                return Err(wrong_type(&names.trace_id, other, "an integer or text"));
            }
        };
        let mut names = names.clone();
        let observation = match sensor.kind() {
            Kind::Places(_) => &names.latitude,
            _ => &names.observation,
        };
        let found = find(schema, observation)?.data_type();
        // No type fits both forms: a list is never an observation of a table or a position, and the
        // lists of the other two sensors have elements that are not lists.
        let form = if is_of(sensor.kind(), found) {
            Form::Long
        } else if element(found).is_some_and(|inner| is_of(sensor.kind(), inner)) {
            Form::Nested
        } else {
            return Err(wrong_type(observation, found, expected(sensor.kind())));
        };
        let as_form = |name: &str, is: fn(&DataType) -> bool, what: &str| {
            let found = find(schema, name)?.data_type();
            let (inner, what) = match form {
                Form::Long => (Some(found), what.to_owned()),
                Form::Nested => (element(found), format!("a list whose elements are each {what}")),
            };
            if inner.is_some_and(is) { Ok(()) } else { Err(wrong_type(name, found, &what)) }
        };
        // A nested table without a column of steps has the steps 1, 2, …; in a long one only the
        // step tells the order.
        if form == Form::Long || schema.column_with_name(&names.step).is_some() {
            as_form(&names.step, DataType::is_integer, "an integer")?;
        } else {
            names.step.clear();
        }
        if matches!(sensor.kind(), Kind::Sparse(_))
            && schema.column_with_name(&names.elsewhere).is_some()
        {
            as_form(&names.elsewhere, is_number, "a number")?;
        } else {
            names.elsewhere.clear();
        }
        if matches!(sensor.kind(), Kind::Places(_)) {
            for name in [&names.longitude, &names.deviation] {
                as_form(name, is_number, "a number")?;
            }
        }
        Ok(Self { form, id_type, names, sensor: sensor.clone() })
    }

    /// Finds the columns of a table with one row per drive.
    ///
    /// # Errors
    ///
    /// [`FleetError::Column`] if a column is missing, or is not a list of what the sensor takes.
    pub fn nested(schema: &Schema, names: &ColumnNames, sensor: &Sensor) -> Outcome<Self> {
        let observation = match sensor.kind() {
            Kind::Places(_) => &names.latitude,
            _ => &names.observation,
        };
        let found = find(schema, observation)?.data_type();
        // `new` would take such a table for a long one and ask for steps; in SQL the mistake is
        // rather a missing `array_agg`.
        if is_of(sensor.kind(), found) {
            let message = format!(
                "has the type {found}, that of one observation; expected a list of them for each \
                 drive"
            );
            return Err(FleetError::column(observation, message));
        }
        Self::new(schema, names, sensor)
    }

    /// Names of the columns that are read: the trace id, the step if there is one, then those of
    /// the observation.
    pub(super) fn needed(&self) -> Vec<&str> {
        let names = &self.names;
        let mut needed = vec![names.trace_id.as_str(), names.step.as_str()];
        match self.sensor.kind() {
            Kind::Places(_) => {
                needed.extend([names.latitude.as_str(), &names.longitude, &names.deviation]);
            }
            Kind::Sparse(_) => needed.extend([names.observation.as_str(), &names.elsewhere]),
            _ => needed.push(&names.observation),
        }
        needed.retain(|name| !name.is_empty());
        needed
    }
}

fn find<'a>(schema: &'a Schema, name: &str) -> Outcome<&'a Field> {
    if let Some((at, field)) = schema.column_with_name(name) {
        // A reader would silently take one of the two.
        let is_it = |(other, field): (usize, &Arc<Field>)| other > at && field.name() == name;
        if schema.fields().iter().enumerate().any(is_it) {
            let message = "occurs twice; give the columns different names";
            return Err(FleetError::column(name, message));
        }
        return Ok(field);
    }
    let names: Vec<&str> = schema.fields().iter().map(|field| field.name().as_str()).collect();
    let message = format!("is missing; there are `{}`", names.join("`, `"));
    Err(FleetError::column(name, message))
}

fn wrong_type(name: &str, found: &DataType, expected: &str) -> FleetError {
    FleetError::column(name, format!("has the type {found}, expected {expected}"))
}

/// Element type of a list.
fn element(list: &DataType) -> Option<&DataType> {
    match list {
        DataType::List(field) | DataType::LargeList(field) | DataType::FixedSizeList(field, _) => {
            Some(field.data_type())
        }
        _ => None,
    }
}

fn is_number(found: &DataType) -> bool {
    found.is_integer() || found.is_floating()
}

/// True for the type of a single observation.
fn is_of(kind: &Kind, found: &DataType) -> bool {
    match kind {
        Kind::Table(_) | Kind::SparseTable(_) => found.is_integer(),
        Kind::Vector { .. } => element(found).is_some_and(DataType::is_floating),
        Kind::Sparse(_) => match element(found) {
            Some(DataType::Struct(fields)) => {
                let has = |name: &str, is: fn(&DataType) -> bool| {
                    fields.find(name).is_some_and(|(_, field)| is(field.data_type()))
                };
                has("state", DataType::is_integer) && has("likelihood", is_number)
            }
            _ => false,
        },
        Kind::Places(_) => is_number(found),
    }
}

fn expected(kind: &Kind) -> &'static str {
    match kind {
        Kind::Table(_) | Kind::SparseTable(_) => {
            "an integer (a symbol), or a list of these for each drive"
        }
        Kind::Vector { .. } => {
            "a list of floating-point numbers (one for each state), or a list of such lists for \
             each drive"
        }
        Kind::Sparse(_) => {
            "a list of structs of `state` (an integer) and `likelihood` (a number), or a list of \
             such lists for each drive"
        }
        Kind::Places(_) => "a number, or a list of these for each drive",
    }
}
