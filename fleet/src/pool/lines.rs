//! Parses lines of JSON: updates of vehicles, and other requests.

use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};
use serde_json::Value;
use wayfix::likelihood::SparseObservation;

use super::{Update, VehicleId};
use crate::places::Fix;
use crate::sensor::{Kind, Observation, Sensor};

/// A bad line, with what could be read of it.
#[derive(Debug)]
pub(super) struct BadLine {
    pub(super) vehicle: Option<VehicleId>,
    pub(super) time: Option<i64>,
    pub(super) offset: Option<VehicleId>,
    pub(super) kind: &'static str,
    pub(super) message: String,
}

/// A parsed line.
#[derive(Debug)]
pub(super) enum Line {
    /// An update, with the offset of the line, if any.
    Update(Update<Observation>, Option<VehicleId>),
    /// Remove a vehicle.
    Remove(VehicleId, Option<VehicleId>),
    /// Continue with the model in a file of this name.
    Model(String, Option<VehicleId>),
    /// A client states its name.
    Client(String),
    Bad(Box<BadLine>),
}

impl Line {
    pub(super) fn offset(&self) -> Option<&VehicleId> {
        match self {
            Self::Update(_, offset) | Self::Remove(_, offset) | Self::Model(_, offset) => {
                offset.as_ref()
            }
            Self::Client(_) => None,
            Self::Bad(bad) => bad.offset.as_ref(),
        }
    }
}

impl BadLine {
    pub(super) fn new(message: impl Into<String>) -> Self {
        Self { vehicle: None, time: None, offset: None, kind: "line", message: message.into() }
    }
}

/// Fields of an update, with the observation of a given sensor.
#[derive(Deserialize)]
#[serde(bound(deserialize = "Y: Deserialize<'de>, E: Deserialize<'de> + Default"))]
struct Fields<Y, E> {
    vehicle: VehicleId,
    time: i64,
    // Distinguishes a null, an observation that is missing on purpose, from an absent field, which
    // is an error.
    #[serde(deserialize_with = "Option::deserialize")]
    observation: Option<Y>,
    #[serde(default)]
    elsewhere: E,
    #[serde(default)]
    restart: bool,
    offset: Option<VehicleId>,
    #[serde(default)]
    remove: bool,
}

/// A state and its likelihood.
#[derive(Deserialize)]
struct Listed {
    state: usize,
    likelihood: f64,
}

/// A position.
#[derive(Deserialize)]
struct At {
    latitude: f64,
    longitude: f64,
    deviation: f64,
}

/// A number, or null for −∞, which JSON lacks.
struct Logarithm(f64);

impl<'de> Deserialize<'de> for Logarithm {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = Option::deserialize(deserializer)?;
        Ok(Self(value.unwrap_or(f64::NEG_INFINITY)))
    }
}

/// Parses a line.
pub(super) fn parse(sensor: &Sensor, line: &[u8]) -> Line {
    // One type of fields per sensor: serde then parses in one pass and without an intermediate
    // value, and its errors name the field.
    let read = || match sensor.kind() {
        Kind::Table(_) | Kind::SparseTable(_) => {
            fields::<usize, IgnoredAny>(sensor, line, |symbol, _| Ok(Observation::Symbol(symbol)))
        }
        Kind::Vector { log: false, .. } => {
            fields::<Vec<f64>, IgnoredAny>(sensor, line, |values, _| {
                Ok(Observation::Vector(values.into()))
            })
        }
        Kind::Vector { log: true, .. } => {
            fields::<Vec<Logarithm>, IgnoredAny>(sensor, line, |values, _| {
                let values: Vec<f64> = values.into_iter().map(|value| value.0).collect();
                Ok(Observation::Vector(values.into()))
            })
        }
        Kind::Sparse(_) => fields::<Vec<Listed>, f64>(sensor, line, |listed, elsewhere| {
            let listed = listed.iter().map(|listed| (listed.state, listed.likelihood)).collect();
            let observation = SparseObservation::new(listed, elsewhere);
            observation.map(Observation::Sparse).map_err(|error| error.to_string())
        }),
        Kind::Places(_) => fields::<At, IgnoredAny>(sensor, line, |at, _| {
            let At { latitude, longitude, deviation } = at;
            Ok(Observation::Fix(Fix { latitude, longitude, deviation }))
        }),
    };
    match read() {
        Ok(Some((update, offset))) => Line::Update(update, offset),
        Ok(None) => other(line, String::new()),
        Err(message) => other(line, message),
    }
}

/// Parses a line that is not a valid update. There are few, so this may be slow.
fn other(line: &[u8], message: String) -> Line {
    // Null if it is not JSON at all: then no field is found below.
    let value: Value = serde_json::from_slice(line).unwrap_or_default();
    let id = |field: &str| VehicleId::deserialize(&value[field]).ok();
    let offset = first_offset(line).or_else(|| id("offset")).filter(is_short);
    let vehicle = id("vehicle");
    let name = |field: &str| value[field].as_str().map(str::to_owned);
    let message = match (value["remove"].as_bool(), vehicle, name("model"), name("client")) {
        (Some(true), Some(vehicle), None, None) => return Line::Remove(vehicle, offset),
        (Some(true), ..) => "`remove` needs a `vehicle`".to_owned(),
        (_, None, Some(name), None) => return Line::Model(name, offset),
        (_, None, None, Some(name)) => return Line::Client(name),
        _ => message,
    };
    let (vehicle, time) = (id("vehicle"), value["time"].as_i64());
    Line::Bad(Box::new(BadLine { vehicle, time, offset, kind: "line", message }))
}

/// Offset of a line that begins with it, even if the rest is not JSON: whoever assigns offsets need
/// not know what is in the lines.
pub(super) fn first_offset(line: &[u8]) -> Option<VehicleId> {
    let value = line.strip_prefix(br#"{"offset":"#)?;
    let mut values = serde_json::Deserializer::from_slice(value).into_iter();
    values.next()?.ok().filter(is_short)
}

/// Maximum length of an offset: the last one of each client is kept, and stored in snapshots.
const LONGEST_OFFSET: usize = 256;

fn is_short(offset: &VehicleId) -> bool {
    match offset {
        VehicleId::Number(_) => true,
        VehicleId::Text(text) => text.len() <= LONGEST_OFFSET,
    }
}

/// An update and its offset.
type Seen = (Update<Observation>, Option<VehicleId>);

/// Parses an update; `None` if the line asks for something else.
fn fields<'de, Y, E>(
    sensor: &Sensor,
    line: &'de [u8],
    observation: impl FnOnce(Y, E) -> Result<Observation, String>,
) -> Result<Option<Seen>, String>
where
    Y: Deserialize<'de>,
    E: Deserialize<'de> + Default,
{
    let fields: Fields<Y, E> = serde_json::from_slice(line).map_err(|error| describe(&error))?;
    if fields.remove {
        return Ok(None);
    }
    let seen = match fields.observation {
        Some(seen) => observation(seen, fields.elsewhere)
            .map_err(|message| format!("field `observation`: {message}"))?,
        None if sensor.is_optional() => Observation::Missing,
        None => return Err("field `observation`: is null, expected a value".to_owned()),
    };
    let Fields { vehicle, time, restart, offset, .. } = fields;
    if offset.as_ref().is_some_and(|offset| !is_short(offset)) {
        return Err(format!("field `offset`: is longer than {LONGEST_OFFSET} bytes"));
    }
    Ok(Some((Update { vehicle, time, observation: seen, restart }, offset)))
}

/// Describes an error without its line number, which is always 1.
fn describe(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    match text.strip_suffix(&place) {
        Some(message) => format!("{message} at column {}", error.column()),
        None => text,
    }
}
