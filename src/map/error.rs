//! What can be wrong with maps and turning probabilities. Places are named by
//! their ids, lines of files counted from 1.

use thiserror::Error;

use crate::error::TransitionError;

/// Why places and roads do not make a map.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MapError {
    /// There are no places at all.
    #[error("a map needs at least one place, found none")]
    Empty,
    /// Two places share an id.
    #[error("place {id} is given twice")]
    DuplicatePlace {
        /// The id.
        id: u64,
    },
    /// A coordinate is not on Earth.
    #[error("place {id} has {coordinate} {value}, expected degrees from {} to {limit}", -limit)]
    Coordinate {
        /// The place's id.
        id: u64,
        /// "latitude" or "longitude".
        coordinate: &'static str,
        /// What was found.
        value: f64,
        /// The largest magnitude that is valid.
        limit: f64,
    },
    /// A road starts or ends at a place that does not exist.
    #[error("the road from place {from} to place {to} needs place {missing}, which does not exist")]
    UnknownPlace {
        /// Where the road starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
        /// Which of the two is missing.
        missing: u64,
    },
    /// A road was given twice.
    #[error("the road from place {from} to place {to} is given twice")]
    DuplicateRoad {
        /// Where it starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
    },
    /// A road leads from a place to itself.
    #[error("the road from place {id} leads to itself; staying is the turning rule's matter")]
    Loop {
        /// The place's id.
        id: u64,
    },
    /// A road's length is NaN, infinite, zero or negative.
    #[error(
        "the road from place {from} to place {to} has length {length}, expected metres above 0"
    )]
    Length {
        /// Where it starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
        /// What was found.
        length: f64,
    },
    /// A file could not be opened or read.
    #[error("cannot read {file}: {reason}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// A line of a file is not as expected.
    #[error("{file}, line {line}: {problem}")]
    Line {
        /// The file.
        file: String,
        /// The line, from 1.
        line: u64,
        /// What is wrong and what was expected.
        problem: String,
    },
}

/// Why a turning rule or table gives no turning probabilities.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TurningError {
    /// A number of the rule is out of its range.
    #[error("{what} is {value}, expected {expected}")]
    Rule {
        /// Which number.
        what: String,
        /// What was found.
        value: f64,
        /// Its range.
        expected: &'static str,
    },
    /// A turn with no road for it.
    #[error(
        "no road leads from place {from} to place {to}, but its turning probability is {value}"
    )]
    NoRoad {
        /// Where the turn starts, by id.
        from: u64,
        /// Where it ends, by id.
        to: u64,
        /// Its probability.
        value: f64,
    },
    /// The probabilities of a place do not sum to one (paper eq. 1).
    #[error("the turning probabilities of place {id} sum to {sum}, expected 1")]
    Sum {
        /// The place's id.
        id: u64,
        /// What they sum to.
        sum: f64,
    },
    /// The probabilities are no transition operator.
    #[error(transparent)]
    Transition(#[from] TransitionError),
}
