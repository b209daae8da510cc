//! Notices: reports of a run besides its answers.

use std::fmt;
use std::net::SocketAddr;

use serde_json::{Value, json};

use super::metrics::now;
use crate::error::FleetError;
use crate::pool::VehicleId;

/// A report of a run besides its answers.
#[derive(Debug)]
#[non_exhaustive]
pub enum Notice {
    /// The run has begun.
    Begin {
        /// Number of lines in earlier runs.
        lines: u64,
        /// Number of vehicles.
        vehicles: usize,
        /// The last offset of these lines.
        offset: Option<VehicleId>,
    },
    /// Connections are accepted at this address.
    Listen(String),
    /// The input ended within a line, which is not taken: the writer may have been cut off.
    Unfinished {
        /// Bytes of the line.
        bytes: u64,
    },
    /// Metrics are served at this address.
    Metrics(SocketAddr),
    /// Vehicles cannot be moved to disk, and stay in memory.
    Spill(FleetError),
    /// Ids alone take more memory than the limit, so it is exceeded.
    Ids {
        /// Bytes of memory.
        bytes: usize,
        /// The limit.
        limit: usize,
    },
    /// A snapshot was written.
    Snapshot {
        /// Its length in bytes.
        bytes: u64,
        /// Time it took, in seconds.
        seconds: f64,
    },
    /// A snapshot could not be written; the previous one is still there.
    SnapshotFailed(FleetError),
    /// The run continues with another model.
    Model {
        /// Its hash.
        hash: String,
        /// Number of vehicles that keep their belief.
        kept: usize,
        /// Number of vehicles that start anew.
        anew: usize,
    },
    /// A model could not be read; the run continues with the previous one.
    ModelFailed(FleetError),
}

impl Notice {
    /// The notice as a line of JSON, with the time in seconds since 1970.
    #[must_use]
    pub fn to_json(&self) -> String {
        let (level, event, mut fields) = match self {
            Self::Begin { lines, vehicles, offset } => {
                let fields = json!({"lines": lines, "vehicles": vehicles, "offset": offset});
                ("info", "begin", fields)
            }
            Self::Listen(address) => ("info", "listen", json!({"address": address})),
            Self::Unfinished { bytes } => ("warn", "unfinished", json!({"bytes": bytes})),
            Self::Metrics(address) => ("info", "metrics", json!({"address": address.to_string()})),
            Self::Spill(error) => ("warn", "spill", json!({"error": error.to_string()})),
            Self::Ids { bytes, limit } => ("warn", "ids", json!({"bytes": bytes, "limit": limit})),
            Self::Snapshot { bytes, seconds } => {
                ("info", "snapshot", json!({"bytes": bytes, "seconds": seconds}))
            }
            Self::SnapshotFailed(error) => {
                ("error", "snapshot_failed", json!({"error": error.to_string()}))
            }
            Self::Model { hash, kept, anew } => {
                ("info", "model", json!({"hash": hash, "kept": kept, "anew": anew}))
            }
            Self::ModelFailed(error) => {
                ("error", "model_failed", json!({"error": error.to_string()}))
            }
        };
        fields["time"] = json!(now() as f64 / 1e3);
        fields["level"] = Value::from(level);
        fields["event"] = Value::from(event);
        fields.to_string()
    }

    /// True if something is wrong.
    #[must_use]
    pub fn is_warning(&self) -> bool {
        matches!(
            self,
            Self::Unfinished { .. }
                | Self::Spill(_)
                | Self::Ids { .. }
                | Self::SnapshotFailed(_)
                | Self::ModelFailed(_)
        )
    }
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Begin { lines, vehicles, .. } => {
                write!(f, "begins after {lines} lines with {vehicles} vehicles")
            }
            Self::Listen(address) => write!(f, "listening at {address}"),
            Self::Unfinished { bytes } => {
                write!(f, "the last line, of {bytes} bytes, is incomplete and was not taken")
            }
            Self::Metrics(address) => write!(f, "metrics at http://{address}/metrics"),
            Self::Spill(error) => write!(f, "vehicles stay in memory: {error}"),
            Self::Ids { bytes, limit } => {
                write!(f, "ids alone take {bytes} bytes of memory, but the limit is {limit}")
            }
            Self::Snapshot { bytes, seconds } => {
                write!(f, "snapshot of {bytes} bytes in {seconds:.2} s")
            }
            Self::SnapshotFailed(error) => write!(f, "no snapshot: {error}"),
            Self::Model { hash, kept, anew } => {
                write!(f, "model {hash}: {kept} vehicles kept, {anew} started anew")
            }
            Self::ModelFailed(error) => write!(f, "the previous model stays: {error}"),
        }
    }
}
