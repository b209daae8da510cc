//! Directed road networks with geometry: nodes, edges, and the turns between them.

mod builder;
mod cleaning;
mod contract;
mod index;
mod merge;
mod road_network;
mod route;
mod shape;

#[cfg(any(feature = "csv", feature = "geojson", feature = "osm"))]
pub(crate) use builder::FASTEST_ROAD;
#[cfg(feature = "geojson")]
pub(crate) use builder::LONGEST_ROAD;
pub use builder::{EdgeOptions, NetworkBuilder};
pub use cleaning::{Cleaning, CleaningStep};
pub use index::{EdgeIndex, NearEdge};
pub use road_network::{Edge, RoadNetwork};
pub use route::{Reached, RouteCosts, RouteMeasures, RouteSearch};
