//! Formats of stored states.
//!
//! A state lists its fields once, in a macro that passes the list on: to [`in_bytes`] for its
//! [bytes](super::bytes) and, with the feature `serde`, to [`with_names`] for
//! self-describing formats. A field of the list is `name: self-describing type = codec(path in the
//! state)`, in the order of the self-describing formats; the order in bytes follows the list.

use super::bytes::{Reader, Writer, contents};
use crate::belief::Belief;
use crate::error::SnapshotError;
use crate::inference::step::state::LogSum;
use wayfix_kernels::Aligned;

/// Conversions of a field of type `T`: to and from bytes, and to and from `D` for self-describing
/// formats. These may lack infinity (as JSON does), so that null stands for it.
#[cfg_attr(not(feature = "serde"), allow(dead_code, reason = "names need serde"))]
pub(crate) struct Codec<T, D> {
    pub(crate) write: fn(&T, &mut Writer),
    pub(crate) read: fn(&mut Reader<'_>) -> Result<T, SnapshotError>,
    pub(crate) data: fn(&T) -> D,
    pub(crate) value: fn(D) -> T,
}

/// Returns a finite value, or `None`.
pub(crate) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

pub(crate) fn or_infinite(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::INFINITY)
}

/// Logarithm of 0.
const NOTHING: f64 = f64::NEG_INFINITY;

pub(crate) const COUNT: Codec<usize, usize> = Codec {
    write: |v, out| out.integer(*v),
    read: |from| from.integer(),
    data: |v| *v,
    value: |data| data,
};
pub(crate) const DOUBLE: Codec<f64, f64> = Codec {
    write: |v, out| out.double(*v),
    read: |from| from.double(),
    data: |v| *v,
    value: |data| data,
};
pub(crate) const SUM: Codec<LogSum, [f64; 2]> = Codec {
    write: |v, out| out.log_sum(*v),
    read: |from| from.log_sum(),
    data: |v| [v.sum, v.compensation],
    value: |[sum, compensation]| LogSum { sum, compensation },
};
pub(crate) const DOUBLES: Codec<Vec<f64>, Vec<f64>> = Codec {
    write: |v, out| out.doubles(v, 0.0),
    read: |from| from.doubles(0.0),
    data: Vec::clone,
    value: |data| data,
};
/// Logarithms, with null for −∞.
pub(crate) const LOGS: Codec<Vec<f64>, Vec<Option<f64>>> = Codec {
    write: |v, out| out.doubles(v, NOTHING),
    read: |from| from.doubles(NOTHING),
    data: |v| v.iter().copied().map(finite).collect(),
    value: |data| data.into_iter().map(|log| log.unwrap_or(NOTHING)).collect(),
};
/// Logarithms as [`LOGS`], with null for an empty vector.
pub(crate) const MAYBE_LOGS: Codec<Vec<f64>, Option<Vec<Option<f64>>>> = Codec {
    data: |v| (!v.is_empty()).then(|| (LOGS.data)(v)),
    value: |data| data.map_or_else(Vec::new, LOGS.value),
    write: LOGS.write,
    read: LOGS.read,
};
pub(crate) const BELIEF: Codec<Aligned, Belief> = Codec {
    write: |v, out| out.doubles(v, 0.0),
    read: |from| {
        let belief = Belief::new(from.doubles(0.0)?);
        Ok(belief.map_err(|error| contents(error.to_string()))?.into_vec().into())
    },
    data: |v| Belief::view(v).to_owned(),
    value: |data| data.into_vec().into(),
};

/// A count, with null for the largest `usize`, which means no limit.
pub(crate) const COUNT_OR_ANY: Codec<usize, Option<usize>> = Codec {
    write: |v, out| out.integer(*v),
    // The bytes may come from a machine with a larger `usize`.
    read: |from| Ok(usize::try_from(from.word()?).unwrap_or(usize::MAX)),
    data: |v| Some(*v).filter(|most| *most < usize::MAX),
    value: |data| data.unwrap_or(usize::MAX),
};
/// Tolerance of a bound, with null for ∞.
pub(crate) const TOLERANCE: Codec<f64, Option<f64>> = Codec {
    // JSON has neither NaN nor infinity: a finite number that means the same stands for them.
    data: |v| match *v {
        // NaN and −∞ mean the same as any value below 0.
        tolerance if tolerance < f64::INFINITY => Some(tolerance.max(f64::MIN)),
        tolerance => Some(-1.0).filter(|_| tolerance.is_nan()),
    },
    value: or_infinite,
    write: DOUBLE.write,
    read: DOUBLE.read,
};
pub(crate) const FLAG: Codec<bool, bool> = Codec {
    write: |v, out| out.integer(usize::from(*v)),
    read: |from| match from.word()? {
        0 => Ok(false),
        1 => Ok(true),
        other => Err(contents(format!("a flag is {other}, expected 0 or 1"))),
    },
    data: |v| *v,
    value: |data| data,
};
pub(crate) const STATES: Codec<Vec<usize>, Vec<usize>> = Codec {
    write: |v, out| {
        out.integer(v.len());
        v.iter().for_each(|state| out.integer(*state));
    },
    read: |from| {
        let count = from.integer()?;
        let state = |word| usize::try_from(word).unwrap_or(usize::MAX);
        Ok(from.words(count)?.map(state).collect())
    },
    data: Vec::clone,
    value: |data| data,
};
/// Doubles that may be ∞, with null for ∞.
pub(crate) const OPEN_DOUBLES: Codec<Vec<f64>, Vec<Option<f64>>> = Codec {
    data: |v| v.iter().copied().map(finite).collect(),
    value: |data| data.into_iter().map(or_infinite).collect(),
    write: DOUBLES.write,
    read: DOUBLES.read,
};
/// A sum that may be ∞, with null for ∞.
pub(crate) const OPEN_SUM: Codec<LogSum, [Option<f64>; 2]> = Codec {
    data: |v| (SUM.data)(v).map(finite),
    value: |data| (SUM.value)(data.map(or_infinite)),
    write: SUM.write,
    read: SUM.read,
};

/// Implements writing and reading of bytes for a state with a list of fields. Reading checks no
/// values.
macro_rules! in_bytes {
    (
        $state:ident, {$($name:ident: $data:ty = $codec:ident($($path:ident).+),)*}
        bytes: $($next:ident),*
    ) => {
        impl $state {
            pub(crate) fn write(&self, out: &mut $crate::inference::streams::bytes::Writer) {
                // Bytes are in the order of the list after `bytes:`, not of the fields. A macro
                // cannot reorder, so each field is looked up by its name.
                for name in [$(stringify!($next)),*] {
                    match name {
                        $(stringify!($name) => ($codec.write)(&self.$($path).+, out),)*
                        _ => {}
                    }
                }
            }

            pub(crate) fn read(
                from: &mut $crate::inference::streams::bytes::Reader<'_>,
            ) -> Result<Self, $crate::error::SnapshotError> {
                let mut state = Self::blank();
                for name in [$(stringify!($next)),*] {
                    match name {
                        $(stringify!($name) => state.$($path).+ = ($codec.read)(from)?,)*
                        _ => {}
                    }
                }
                Ok(state)
            }
        }
    };
}
pub(crate) use in_bytes;

/// Stores a state with a list of fields, by their names.
#[cfg(feature = "serde")]
macro_rules! with_names {
    (
        $state:ident, {$($name:ident: $data:ty = $codec:ident($($path:ident).+),)*}
        bytes: $($next:ident),*
    ) => {
        crate::stored! {
            [] $state: [], |state| {
                $($name: $data = ($codec.data)(&state.$($path).+),)*
            } => {
                let mut state = self::$state::blank();
                $(state.$($path).+ = ($codec.value)($name);)*
                state.checked()
            };
        }
    };
}
#[cfg(feature = "serde")]
pub(crate) use with_names;
