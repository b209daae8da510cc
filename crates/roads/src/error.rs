//! Errors of networks, imports, cells and their sensors. They name nodes by their ids, and count
//! lines, blocks and features of files from 1.

use wayfix::error::{OutOfRange, TransitionError};
use wayfix::internal::{FileError, Number};
use wayfix::map::MapError;

/// Roads that do not form a network, a file that cannot be read, or an invalid number of cells,
/// turns or sensors.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// A node or a position is invalid, a network has no nodes, or counts of traffic do not form a
    /// flow.
    #[error(transparent)]
    Map(#[from] MapError),
    /// The length of an edge is NaN, 0 or negative, or above 1e12.
    #[error(
        "the road from place {from} to place {to} has length {length}, expected metres above 0{}",
        if *.length > 1e12 { " and at most 1e12" } else { "" },
        length = Number(*.length)
    )]
    Length {
        /// Id of the node where the edge starts.
        from: u64,
        /// Id of the node where the edge ends.
        to: u64,
        /// Value found, in metres.
        length: f64,
    },
    /// The posted speed of an edge is not above 0, or is above 1e9.
    #[error(
        "the road from place {from} to place {to} has speed {speed}, expected metres per second above 0 and at most 1e9",
        speed = Number(*.speed)
    )]
    Speed {
        /// Id of the node where the edge starts.
        from: u64,
        /// Id of the node where the edge ends.
        to: u64,
        /// Value found, in metres per second.
        speed: f64,
    },
    /// No node of a network lies in a box.
    #[error("no node lies in the box of {asked}; all lie in {extent}")]
    EmptyBox {
        /// The box.
        asked: String,
        /// Smallest box around all nodes.
        extent: String,
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
        /// Path of the file, or "nodes" or "edges" for a reader.
        file: String,
        /// The line, from 1.
        line: u64,
        /// Description of the problem, with the valid values.
        problem: String,
    },
    /// A block of an OpenStreetMap extract is invalid.
    #[error("{file}, block {block} (from byte {byte}): {problem}")]
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
    #[error("{file}, feature {feature}: {problem}")]
    Feature {
        /// Path of the file, or "features" for a reader.
        file: String,
        /// The feature, from 1.
        feature: usize,
        /// Description of the problem, with the valid values.
        problem: String,
    },
    /// A network without roads to cut into cells.
    #[error("cells need at least one road, found none")]
    NoRoads,
    /// The roads have more cells than 32-bit indices can address.
    #[error(
        "roads have {cells} cells of {spacing} m, expected at most 4294967295 (32-bit indices)",
        cells = Number(*.cells),
        spacing = Number(*.spacing)
    )]
    Cells {
        /// Number of cells.
        cells: f64,
        /// The spacing, in metres.
        spacing: f64,
    },
    /// A radius, the spacing of cells, a weight of turns, or a number of a sensor is out of range.
    #[error(transparent)]
    Parameter(#[from] OutOfRange),
    /// The turns do not form a transition operator.
    #[error(transparent)]
    Transition(#[from] TransitionError),
}

impl From<FileError> for NetworkError {
    fn from(FileError { file, line, problem }: FileError) -> Self {
        match line {
            None => Self::Read { file, reason: problem },
            Some(line) => Self::Line { file, line, problem },
        }
    }
}
