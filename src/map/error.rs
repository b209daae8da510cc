//! Errors of maps and turning probabilities. Places are named by their ids; lines of files are
//! counted from 1.

use std::error::Error;
use std::fmt;

use super::FlowError;
use crate::error::TransitionError;

/// Places and roads that do not form a map, or a file that cannot be read.
#[derive(Debug)]
#[non_exhaustive]
pub enum MapError {
    /// There are no places.
    Empty,
    /// Two places have the same id.
    DuplicatePlace {
        /// The id.
        id: u64,
    },
    /// A coordinate is outside the Earth's range, or the plane's.
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
    UnknownPlace {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where the road ends.
        to: u64,
        /// Id of the missing place.
        missing: u64,
    },
    /// A road is given twice.
    DuplicateRoad {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where the road ends.
        to: u64,
    },
    /// A road leads from a place to itself.
    Loop {
        /// Id of the place.
        id: u64,
    },
    /// A road's length is NaN, infinite, zero or negative, or that of an edge of a network is above
    /// 1e12.
    Length {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where the road ends.
        to: u64,
        /// Value found, in metres.
        length: f64,
    },
    /// The posted speed of an edge is not above 0, or is above 1e9.
    Speed {
        /// Id of the place where the road starts.
        from: u64,
        /// Id of the place where the road ends.
        to: u64,
        /// Value found, in metres per second.
        speed: f64,
    },
    /// There are no roads to cut into cells.
    NoRoads,
    /// The spacing of cells is NaN, infinite, zero or negative.
    Spacing {
        /// Value found, in metres.
        spacing: f64,
    },
    /// The roads have more cells than 32-bit indices can address.
    Cells {
        /// Number of cells.
        cells: f64,
        /// The spacing, in metres.
        spacing: f64,
    },
    /// A file could not be opened or read.
    Read {
        /// Path of the file.
        file: String,
        /// Error message of the operating system.
        reason: String,
    },
    /// A line of a file is invalid.
    Line {
        /// Path of the file, or "places" or "roads" for a reader.
        file: String,
        /// The line, from 1.
        line: u64,
        /// Description of the problem, with the valid values.
        problem: String,
    },
    /// A block of an OpenStreetMap extract is invalid.
    Block {
        /// Path of the file, or "extract" for a reader.
        file: String,
        /// The block, from 1; the first one is the header.
        block: u64,
        /// Where the block starts, in bytes from the start of the file.
        byte: u64,
        /// Description of the problem.
        problem: String,
    },
    /// A feature of a GeoJSON file is invalid.
    Feature {
        /// Path of the file, or "features" for a reader.
        file: String,
        /// The feature, from 1.
        feature: usize,
        /// Description of the problem, with the valid values.
        problem: String,
    },
    /// No node of a network lies in a box.
    EmptyBox {
        /// The box.
        asked: String,
        /// Smallest box around all nodes.
        extent: String,
    },
    /// The radius of merging is negative, infinite or NaN.
    Radius {
        /// Value found, in metres.
        metres: f64,
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
                write!(
                    f,
                    "the road from place {from} to place {to} is given twice (`RoadMap::cleaned` keeps the shorter one)"
                )
            }
            Self::Loop { id } => write!(
                f,
                "the road from place {id} leads to itself; staying is the turning rule's matter"
            ),
            Self::Length { from, to, length } => {
                let most = if *length > 1e12 { " and at most 1e12" } else { "" };
                write!(
                    f,
                    "the road from place {from} to place {to} has length {length}, expected metres above 0{most}"
                )
            }
            Self::Speed { from, to, speed } => write!(
                f,
                "the road from place {from} to place {to} has speed {speed}, expected metres per second above 0 and at most 1e9"
            ),
            Self::NoRoads => write!(f, "cells need at least one road, found none"),
            Self::Spacing { spacing } => {
                write!(f, "the spacing of cells is {spacing}, expected metres above 0")
            }
            Self::Cells { cells, spacing } => write!(
                f,
                "roads have {cells} cells of {spacing} m, expected at most 4294967295 (32-bit indices)"
            ),
            Self::Read { file, reason } => write!(f, "cannot read {file}: {reason}"),
            Self::Line { file, line, problem } => write!(f, "{file}, line {line}: {problem}"),
            Self::Block { file, block, byte, problem } => {
                write!(f, "{file}, block {block} (from byte {byte}): {problem}")
            }
            Self::Feature { file, feature, problem } => {
                write!(f, "{file}, feature {feature}: {problem}")
            }
            Self::EmptyBox { asked, extent } => {
                write!(f, "no node lies in the box of {asked}; all lie in {extent}")
            }
            Self::Radius { metres } => {
                write!(f, "the radius of merging is {metres}, expected metres from 0")
            }
        }
    }
}

impl Error for MapError {}

/// An invalid turning rule, or invalid turning probabilities.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TurningError {
    /// A number of the rule is out of range.
    Rule {
        /// Name of the number.
        what: String,
        /// Value found.
        value: f64,
        /// Valid values, in words.
        expected: &'static str,
    },
    /// A turn has a probability above 0 but there is no road.
    NoRoad {
        /// Id of the place where the turn starts.
        from: u64,
        /// Id of the place where the turn ends.
        to: u64,
        /// Probability of the turn.
        value: f64,
    },
    /// The probabilities of the turns out of a place do not sum to one (paper eq. 1).
    Sum {
        /// Id of the place.
        id: u64,
        /// Sum found.
        sum: f64,
    },
    /// Moves were counted where there is no road.
    Moved {
        /// Id of the place that is left.
        from: u64,
        /// Id of the place that is reached.
        to: u64,
        /// Number of moves.
        count: f64,
    },
    /// Counts of traffic are not those of a flow.
    Flow(FlowError),
    /// The probabilities do not form a transition operator.
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
            Self::Moved { from, to, count } => write!(
                f,
                "no road leads from place {from} to place {to}, but the number of moves is {count}"
            ),
            Self::Flow(error) => fmt::Display::fmt(error, f),
            Self::Transition(error) => fmt::Display::fmt(error, f),
        }
    }
}

impl Error for TurningError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Flow(error) => error.source(),
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
