//! Maps: places as the states of a model, with the directed roads between them.

mod adjacency;
mod builder;
#[cfg(feature = "csv")]
mod csv;
mod graph;
mod map;
mod report;
mod shortest;

pub use map::{Road, RoadMap};
pub use report::CleaningReport;
pub use shortest::RoadPath;
