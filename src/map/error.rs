//! What can be wrong with maps and turning probabilities. Places are named by
//! their ids, lines of files counted from 1.

use std::error::Error;
use std::fmt;

use crate::error::TransitionError;

/// Why places and roads do not make a map.
#[derive(Debug)]
#[non_exhaustive]
pub enum MapError {
    /// There are no places at all.
    Empty,
    /// Two places share an id.
    DuplicatePlace {
        /// The id.
        id: u64,
    },
    /// A coordinate is not on Earth, or not in the plane.
    Coordinate {
        /// The place's id.
        id: u64,
        /// "latitude" or "longitude", "x" or "y".
        coordinate: &'static str,
        /// What was found.
        value: f64,
        /// The largest magnitude that is valid.
        limit: f64,
        /// "degrees" or "metres".
        unit: &'static str,
    },
    /// A road starts or ends at a place that does not exist.
    UnknownPlace {
        /// Where the road starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
        /// Which of the two is missing.
        missing: u64,
    },
    /// A road was given twice.
    DuplicateRoad {
        /// Where it starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
    },
    /// A road leads from a place to itself.
    Loop {
        /// The place's id.
        id: u64,
    },
    /// A road's length is NaN, infinite, zero or negative.
    Length {
        /// Where it starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
        /// What was found.
        length: f64,
    },
    /// A file could not be opened or read.
    Read {
        /// The file.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// A line of a file is not as expected.
    Line {
        /// The file.
        file: String,
        /// The line, from 1.
        line: u64,
        /// What is wrong and what was expected.
        problem: String,
    },
}

impl fmt::Display for MapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "a map needs at least one place, found none"),
            Self::DuplicatePlace { id } => write!(f, "place {id} is given twice"),
            Self::Coordinate { id, coordinate, value, limit, unit } => write!(
                f,
                "place {id} has {coordinate} {value}, expected {unit} from {} to {limit}",
                -limit
            ),
            Self::UnknownPlace { from, to, missing } => write!(
                f,
                "the road from place {from} to place {to} needs place {missing}, which does not exist"
            ),
            Self::DuplicateRoad { from, to } => {
                write!(f, "the road from place {from} to place {to} is given twice")
            }
            Self::Loop { id } => write!(
                f,
                "the road from place {id} leads to itself; staying is the turning rule's matter"
            ),
            Self::Length { from, to, length } => write!(
                f,
                "the road from place {from} to place {to} has length {length}, expected metres above 0"
            ),
            Self::Read { file, reason } => write!(f, "cannot read {file}: {reason}"),
            Self::Line { file, line, problem } => write!(f, "{file}, line {line}: {problem}"),
        }
    }
}

impl Error for MapError {}

/// Why a turning rule or table gives no turning probabilities.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TurningError {
    /// A number of the rule is out of its range.
    Rule {
        /// Which number.
        what: String,
        /// What was found.
        value: f64,
        /// Its range.
        expected: &'static str,
    },
    /// A turn with no road for it.
    NoRoad {
        /// Where the turn starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
        /// Its probability.
        value: f64,
    },
    /// The probabilities of a place do not sum to one (paper eq. 1).
    Sum {
        /// The place's id.
        id: u64,
        /// What they sum to.
        sum: f64,
    },
    /// The probabilities are no transition operator.
    Transition(TransitionError),
}

impl fmt::Display for TurningError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rule { what, value, expected } => {
                write!(f, "{what} is {value}, expected {expected}")
            }
            Self::NoRoad { from, to, value } => write!(
                f,
                "no road leads from place {from} to place {to}, but its turning probability is {value}"
            ),
            Self::Sum { id, sum } => {
                write!(f, "the turning probabilities of place {id} sum to {sum}, expected 1")
            }
            Self::Transition(error) => fmt::Display::fmt(error, f),
        }
    }
}

impl Error for TurningError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Transition(error) => error.source(),
            _ => None,
        }
    }
}

impl From<TransitionError> for TurningError {
    fn from(source: TransitionError) -> Self {
        Self::Transition(source)
    }
}
