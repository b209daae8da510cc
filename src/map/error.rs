//! Errors of maps, flows and turning probabilities. They name places by their ids, and count lines
//! of files from 1.

use crate::error::{Number, OutOfRange, TransitionError};
use crate::files::FileError;

/// Places and roads that do not form a map, turning probabilities or counts of traffic that do not
/// match them, or a file that cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// There are no places.
    #[error("a map needs at least one place, found none")]
    Empty,
    /// Two places have the same id.
    #[error("place {id} is given twice")]
    DuplicatePlace {
        /// The id.
        id: u64,
    },
    /// A coordinate is outside the Earth's range, or the plane's.
    #[error(
        "place {id} has {coordinate} {value}, expected {unit} from {} to {limit}",
        -.limit,
        value = Number(*.value)
    )]
    Coordinate {
        /// Id of the place.
        id: u64,
        /// "latitude" or "longitude", "x" or "y".
        coordinate: &'static str,
        /// Value found.
        value: f64,
        /// Largest valid magnitude.
        limit: f64,
        /// "degrees" or "metres".
        unit: &'static str,
    },
    /// A road starts or ends at a place that does not exist.
    #[error("the road from place {from} to place {to} needs place {missing}, which does not exist")]
    UnknownPlace {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where the road ends.
        to: u64,
        /// Id of the missing place.
        missing: u64,
    },
    /// A road is given twice.
    #[error(
        "the road from place {from} to place {to} is given twice (`RoadMap::cleaned` keeps the shorter one)"
    )]
    DuplicateRoad {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where the road ends.
        to: u64,
    },
    /// A road leads from a place to itself.
    #[error("the road from place {id} leads to itself; stays are up to the turning rule")]
    Loop {
        /// Id of the place.
        id: u64,
    },
    /// A road's length is NaN, infinite, zero or negative.
    #[error(
        "the road from place {from} to place {to} has length {length}, expected metres above 0",
        length = Number(*.length)
    )]
    Length {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where the road ends.
        to: u64,
        /// Value found, in metres.
        length: f64,
    },
    /// A file could not be opened or read.
    #[error("cannot read {file}: {reason}")]
    Read {
        /// Path of the file.
        file: String,
        /// Error message of the operating system.
        reason: String,
    },
    /// A line of a file is invalid.
    #[error("{file}, line {line}: {problem}")]
    Line {
        /// Path of the file, or "places" or "roads" for a reader.
        file: String,
        /// The line, from 1.
        line: u64,
        /// Description of the problem, with the valid values.
        problem: String,
    },
    /// A number of a rule or a prior is out of range.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
    /// A turn has a probability above 0 but there is no road.
    #[error(
        "no road leads from place {from} to place {to}, but its turning probability is {value}",
        value = Number(*.value)
    )]
    NoRoad {
        /// Id of the place where the turn starts.
        from: u64,
        /// Id of the place where the turn ends.
        to: u64,
        /// Probability of the turn.
        value: f64,
    },
    /// The probabilities of the turns out of a place do not sum to one (paper eq. 1).
    #[error(
        "the turning probabilities of place {id} sum to {sum}, expected 1",
        sum = Number(*.sum)
    )]
    TurningSum {
        /// Id of the place.
        id: u64,
        /// Sum found.
        sum: f64,
    },
    /// Moves were counted where there is no road.
    #[error(
        "no road leads from place {from} to place {to}, but the number of moves is {count}",
        count = Number(*.count)
    )]
    Moved {
        /// Id of the place that is left.
        from: u64,
        /// Id of the place that is reached.
        to: u64,
        /// Number of moves.
        count: f64,
    },
    /// The probabilities do not form a transition operator.
    #[error(transparent)]
    Transition(#[from] TransitionError),
    /// The number of counts differs from the number of roads.
    #[error("{found} counts for {expected} roads, expected one each")]
    RoadCounts {
        /// Number of counts.
        found: usize,
        /// Number of roads.
        expected: usize,
    },
    /// A count is NaN, negative or infinite, or beyond 1e150.
    #[error(
        "the count of the road from place {from} to place {to} is {value}, expected 0 to 1e150",
        value = Number(*.value)
    )]
    RoadCount {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where it ends.
        to: u64,
        /// Value found.
        value: f64,
    },
    /// Vehicles were counted on a road, but no roads with counts lead from its end back to its
    /// start.
    #[error(
        "{value} vehicles were counted on the road from place {from} to place {to}, but no roads with counts lead back",
        value = Number(*.value)
    )]
    NoWayBack {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where it ends.
        to: u64,
        /// The count.
        value: f64,
    },
    /// The allowed turns at a node cannot connect its inflows to its outflows, or balancing did not
    /// converge there.
    #[error(
        "no flow through the turns of place {id} was found: a relative error of {error} remains",
        error = Number(*.error)
    )]
    Unbalanced {
        /// Id of the node.
        id: u64,
        /// Largest relative error that is left.
        error: f64,
    },
}

impl From<FileError> for MapError {
    fn from(FileError { file, line, problem }: FileError) -> Self {
        match line {
            None => Self::Read { file, reason: problem },
            Some(line) => Self::Line { file, line, problem },
        }
    }
}
