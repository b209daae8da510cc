//! Map matching: positions of a vehicle on a road network, live and afterwards, with
//! probabilities.

mod answer;
mod candidates;
mod drive;
mod error;
#[cfg(feature = "csv")]
mod files;
mod learn;
mod matcher;
mod model;
mod moves;
mod point;
mod routes;
mod snapshot;
mod vehicle;

pub use answer::RoadAnswer;
pub use drive::{MatchedDrive, Stretch};
pub use error::MatchError;
#[cfg(feature = "csv")]
pub use files::{PointWriter, RouteWriter, SkippedPoints, Trace, read_traces, read_traces_from};
pub use learn::FittedModel;
pub use matcher::{MatchMemory, Matcher};
pub use model::MatchModel;
pub use point::TracePoint;
pub use routes::RankedRoute;
pub use vehicle::Vehicle;
