//! Directed road networks with geometry: nodes, edges, and the turns between them.

mod builder;
mod cleaning;
mod cleaning_step;
mod component;
mod contract;
mod crop;
mod dead_ends;
mod index;
mod length_bound;
mod merge;
mod near_edge;
mod neighbourhood;
mod rebuild;
mod road_network;
mod route;
mod shape;
mod to_map;

#[cfg(any(feature = "csv", feature = "geojson", feature = "osm"))]
pub(super) use builder::FASTEST_ROAD;
#[cfg(feature = "geojson")]
pub(super) use builder::LONGEST_ROAD;
pub use builder::{EdgeOptions, NetworkBuilder};
pub use cleaning_step::{Cleaning, CleaningStep};
pub use index::EdgeIndex;
pub use near_edge::NearEdge;
pub use road_network::{Edge, RoadNetwork};
pub use route::{Reached, RouteCosts, RouteMeasures, RouteSearch};
