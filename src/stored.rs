//! The formats of stored types (feature `serde`): the table in the guide's chapter on
//! [storing](crate::guide::storing) lists their fields. A type's own format stands beside the type.

use std::error::Error;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Version of the format, the only one that is read.
const VERSION: u32 = 1;

/// Field `version` of a stored struct.
#[derive(Debug, Clone, Copy)]
pub struct Version;

impl Serialize for Version {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u32(VERSION)
    }
}

impl<'de> Deserialize<'de> for Version {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match u32::deserialize(deserializer)? {
            VERSION => Ok(Self),
            other => Err(D::Error::custom(format!("version {other}, expected {VERSION}"))),
        }
    }
}

/// Converts an error with all its sources to one of serde.
pub fn refused<E: serde::de::Error>(error: impl Into<Box<dyn Error>>) -> E {
    let error = error.into();
    let (mut text, mut source) = (error.to_string(), error.source());
    while let Some(cause) = source {
        text += &format!(": {cause}");
        source = cause.source();
    }
    E::custom(text)
}

/// Returns a finite number, or `None`: JSON has neither infinity nor NaN.
pub(crate) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Returns a number, or ∞ for `None`.
pub(crate) fn or_infinite(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::INFINITY)
}

/// Returns logarithms, with `None` for −∞.
pub(crate) fn finite_logs(logs: &[f64]) -> Vec<Option<f64>> {
    logs.iter().copied().map(finite).collect()
}

/// Returns logarithms, with −∞ for `None`.
pub(crate) fn logs(values: Vec<Option<f64>>) -> Vec<f64> {
    values.into_iter().map(|log| log.unwrap_or(f64::NEG_INFINITY)).collect()
}

/// Implements `Serialize` and `Deserialize` for structs of the module where it stands:
///
/// ```text
/// [generics of the impl] Name<…> for Type<…>: [generics that fields depend on], |value| {
///     field: its type = expression of the value,
/// } => result of building the value from the fields;
/// ```
///
/// Formats and messages show the name, which is that of the type unless a type is given.
#[doc(hidden)]
#[macro_export]
macro_rules! stored {
    ($(
        [$($generics:tt)*] $name:ident$(<$($argument:ident),*>)? $(for $target:ty)?: [$($part:ident),*], |$value:ident| {
            $($field:ident: $type:ty = $stored:expr,)*
        } => $built:expr;
    )*) => {$(
        const _: () = {
            // Inside this block `Name` is the struct of the fields, and `self::Name` the type.
            #[derive(serde::Deserialize)]
            #[serde(deny_unknown_fields)]
            struct $name<$($part),*> {
                version: $crate::internal::Version,
                $($field: $type,)*
            }

            impl<$($generics)*> serde::Serialize for $crate::stored_type!($name [$($($argument),*)?] $($target)?)
            where
                $($part: serde::Serialize,)*
            {
                fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                    use serde::ser::SerializeStruct;
                    let $value = self;
                    let fields = 1 + [$(stringify!($field)),*].len();
                    let mut out = serializer.serialize_struct(stringify!($name), fields)?;
                    out.serialize_field("version", &$crate::internal::Version)?;
                    $(out.serialize_field(stringify!($field), &$stored)?;)*
                    out.end()
                }
            }

            impl<'de, $($generics)*> serde::Deserialize<'de> for $crate::stored_type!($name [$($($argument),*)?] $($target)?)
            where
                $($part: serde::Deserialize<'de>,)*
            {
                fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                    let $name { version: $crate::internal::Version, $($field),* } =
                        serde::Deserialize::deserialize(from)?;
                    $built.map_err($crate::internal::refused)
                }
            }
        };
    )*};
}

/// The type that a format is for.
#[doc(hidden)]
#[macro_export]
macro_rules! stored_type {
    ($name:ident []) => { self::$name };
    ($name:ident [$($argument:ident),+]) => { self::$name<$($argument),+> };
    ($name:ident [$($argument:ident),*] $target:ty) => { $target };
}
