//! Road networks, and vehicles on them: GPS positions to routes with probabilities, live and
//! afterwards.

// On docs.rs, labels items with the features that they need.
#![cfg_attr(docsrs, feature(doc_cfg))]
#![allow(missing_docs)] // TEMP

pub mod cells;
mod error;
pub mod guide;
#[cfg(any(feature = "csv", feature = "geojson", feature = "osm"))]
mod import;
pub mod matching;
mod network;

pub use error::NetworkError;
#[cfg(any(feature = "csv", feature = "geojson", feature = "osm"))]
pub use import::{ImportNote, ImportOptions, ImportReport};
#[cfg(feature = "geojson")]
pub(crate) use import::{line_string, parse_geojson};
pub use network::{
    Cleaning, CleaningStep, Edge, EdgeIndex, EdgeOptions, NearEdge, NetworkBuilder, Reached,
    RoadNetwork, RouteCosts, RouteMeasures, RouteSearch,
};
