//! What a run reports beside its answers.

use std::fmt;
use std::net::SocketAddr;

use serde_json::{Value, json};

use super::metrics::now;
use crate::error::FleetError;
use crate::pool::VehicleId;

/// What a run reports beside its answers.
#[derive(Debug)]
#[non_exhaustive]
pub enum Notice {
    /// The run has begun, after so many lines of runs before, with so many vehicles.
    Begin {
        /// Number of lines of runs before.
        lines: u64,
        /// Number of vehicles.
        vehicles: usize,
        /// The last offset of the lines.
        offset: Option<VehicleId>,
    },
    /// Connections are taken at this address.
    Listen(String),
    /// The input has ended within a line, which is not taken: the writer may have been cut off.
    Unfinished {
        /// Bytes of the line.
        bytes: u64,
    },
    /// Figures are to be had at this address.
    Metrics(SocketAddr),
    /// Vehicles cannot be moved to the disk, and stay in memory.
    Spill(FleetError),
    /// Ids alone take more memory than the limit, so that it does not hold.
    Ids {
        /// Bytes of memory.
        bytes: usize,
        /// The limit.
        limit: usize,
    },
    /// A snapshot is there.
    Snapshot {
        /// Its length.
        bytes: u64,
        /// Seconds that it took.
        seconds: f64,
    },
    /// A snapshot cannot be written; the one before is still there.
    SnapshotFailed(FleetError),
    /// Another model is gone on with.
    Model {
        /// Its hash.
        hash: String,
        /// Number of vehicles that keep their belief.
        kept: usize,
        /// Number of those that begin anew.
        anew: usize,
    },
    /// A model cannot be read; the one before is gone on with.
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
            Self::Listen(address) => write!(f, "listens at {address}"),
            Self::Unfinished { bytes } => {
                write!(f, "the last line, of {bytes} bytes, has no end and is not taken")
            }
            Self::Metrics(address) => write!(f, "metrics at http://{address}/metrics"),
            Self::Spill(error) => write!(f, "vehicles stay in memory: {error}"),
            Self::Ids { bytes, limit } => {
                write!(f, "ids alone take {bytes} bytes of memory, the limit is {limit}")
            }
            Self::Snapshot { bytes, seconds } => {
                write!(f, "snapshot of {bytes} bytes in {seconds:.2} s")
            }
            Self::SnapshotFailed(error) => write!(f, "no snapshot: {error}"),
            Self::Model { hash, kept, anew } => {
                write!(f, "model {hash}: {kept} vehicles kept, {anew} begun anew")
            }
            Self::ModelFailed(error) => write!(f, "the model stays: {error}"),
        }
    }
}
