//! Vehicles of a pool: ids, updates and answers.

use std::fmt;

use serde::de::{self, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use wayfix::HmmError;

use crate::error::FleetError;
use crate::output::error_kind;

/// Id of a vehicle: an integer or text. The integer 7 and the text "7" are different vehicles.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum VehicleId {
    /// An integer.
    Number(i64),
    /// A text.
    Text(Box<str>),
}

impl From<i64> for VehicleId {
    fn from(number: i64) -> Self {
        Self::Number(number)
    }
}

impl From<&str> for VehicleId {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for VehicleId {
    fn from(text: String) -> Self {
        Self::Text(text.into())
    }
}

impl fmt::Display for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Text(text) => write!(f, "{text:?}"),
        }
    }
}

impl Serialize for VehicleId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Number(number) => serializer.serialize_i64(*number),
            Self::Text(text) => serializer.serialize_str(text),
        }
    }
}

impl<'de> Deserialize<'de> for VehicleId {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Id;
        impl Visitor<'_> for Id {
            type Value = VehicleId;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a text, or an integer from -2^63 to 2^63 - 1, as an id")
            }

            fn visit_i64<E: de::Error>(self, number: i64) -> Result<VehicleId, E> {
                Ok(VehicleId::Number(number))
            }

            fn visit_u64<E: de::Error>(self, number: u64) -> Result<VehicleId, E> {
                let wrong = |_| E::invalid_value(Unexpected::Unsigned(number), &self);
                i64::try_from(number).map(VehicleId::Number).map_err(wrong)
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<VehicleId, E> {
                Ok(text.into())
            }
        }
        deserializer.deserialize_any(Id)
    }
}

/// An observation of a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct Update<Y> {
    /// The vehicle. An unknown one starts from the prior.
    pub vehicle: VehicleId,
    /// Time or step in any unit; it must be later than that of the last update of the vehicle. It
    /// only serves to refuse late and repeated updates: every update is one step of the model.
    pub time: i64,
    /// The observation.
    pub observation: Y,
    /// True if the vehicle starts from the prior again, for example after it was towed. Its time
    /// must still be later than that of the last update; a vehicle whose clock was set back has to
    /// be removed first.
    pub restart: bool,
}

impl<Y> Update<Y> {
    /// Creates the next update of a vehicle.
    pub fn new(vehicle: impl Into<VehicleId>, time: i64, observation: Y) -> Self {
        Self { vehicle: vehicle.into(), time, observation, restart: false }
    }
}

/// Position of a vehicle after an update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Most probable state; ties go to the lowest state.
    pub state: usize,
    /// Its probability.
    pub probability: f64,
    /// Log-likelihood of the observation given the earlier ones, ln p(y_k | y_1 … y_{k-1}).
    pub log_likelihood: f64,
}

/// Reason why an update was refused. The vehicle, including its time, is unchanged, and no other
/// vehicle is affected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// The time is not later than that of the last update.
    #[error("time {time} is not after {last}, the time of the last update of the vehicle")]
    Time {
        /// Time of the update.
        time: i64,
        /// Time of the update before.
        last: i64,
    },
    /// The model rules the observation out, or the observation is invalid. Steps count from the
    /// vehicle's first.
    #[error(transparent)]
    Inference(Box<HmmError>),
    /// The state cannot be read back from disk.
    #[error("the state of the vehicle cannot be read back: {0}")]
    Disk(Box<FleetError>),
}

impl UpdateError {
    /// Kind of the error in one word: `time`, `disk`, or as in the tables of results: `impossible`,
    /// `impossible_move`, `likelihood` (an invalid observation), `transition`, `other`.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Time { .. } => "time",
            Self::Inference(error) => error_kind(error).0,
            Self::Disk(_) => "disk",
        }
    }
}

impl From<HmmError> for UpdateError {
    fn from(error: HmmError) -> Self {
        Self::Inference(Box::new(error))
    }
}
