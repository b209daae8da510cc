//! GPS positions and a map to roads with probabilities: which roads a vehicle drove, and which road
//! it is on now.
//!
//! ```
//! use wayfix_roads::NetworkBuilder;
//! use wayfix_roads::matching::{Matcher, TracePoint};
//! use wayfix::map::{Position, RoadClass};
//!
//! // Two streets, 55 m apart, joined at both ends; from a file: `RoadNetwork::from_path`.
//! let at = |latitude, longitude| Position { latitude, longitude };
//! let mut builder = NetworkBuilder::new();
//! for (id, latitude, longitude) in
//!     [(1, -35.2800, 149.13), (2, -35.2800, 149.14), (3, -35.2805, 149.13), (4, -35.2805, 149.14)]
//! {
//!     builder.node(id, at(latitude, longitude))?;
//! }
//! for (from, to) in [(1, 2), (3, 4), (1, 3), (2, 4)] {
//!     builder.both_ways(from, to, RoadClass::Street)?;
//! }
//! let matcher = Matcher::new(builder.build()?);
//!
//! // Every ten seconds a position some 5 m off the southern street.
//! let drive: Vec<_> = (0..4)
//!     .map(|k| f64::from(k))
//!     .map(|k| TracePoint::new(10.0 * k, at(-35.28045, 149.131 + 0.001 * k)))
//!     .collect();
//! let mut vehicle = matcher.start(&drive[0], 3)?;
//! for point in &drive[1..] {
//!     vehicle.step(&matcher, point)?; // live
//! }
//! let now = vehicle.live();
//! let edge = matcher.network().edges()[now.edge.expect("on a road")];
//! assert_eq!([edge.from, edge.to], [2, 3]); // from node 3 to node 4
//! assert!(now.probability > 0.9);
//!
//! let matched = matcher.match_drive(&drive)?; // afterwards, with all points
//! assert_eq!(matched.route().len(), 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Overview
//!
//! | for | take |
//! |---|---|
//! | a road network from OpenStreetMap, GeoJSON or CSV | [`RoadNetwork`]`::from_path`, with `ImportOptions` |
//! | one built in code, cleaned or searched | [`NetworkBuilder`], [`Cleaning`], [`EdgeIndex`], [`RouteSearch`] |
//! | GPS positions, for the road now, the route, and alternative routes | [`matching`]: [`Matcher`](matching::Matcher), [`Vehicle`](matching::Vehicle), [`MatchedDrive`](matching::MatchedDrive) |
//! | an odometer, a camera, tags at the roadside, or long stretches without positions | [`cells`]: places along roads as the states of any [`Hmm`](wayfix::Hmm) |
//!
//! The [guide] leads from files to routes, says which model fits, and how far its probabilities can
//! be trusted.
//! Inference itself is that of the crate [`wayfix`]. All errors are [`NetworkError`], for networks,
//! files, cells and their sensors, or [`MatchError`](matching::MatchError), for drives.
//!
//! # What it does not do
//!
//! - **Navigation.** No routing to a destination, no lanes, no traffic.
//! - **Maps beyond memory.** A network is in memory as a whole, without tiles.
//! - **Dead reckoning in the plane.** States are on roads, or off the road without a place; an
//!   inertial sensor moves nothing.
//! - **Learning a map.** Roads that the map does not have are stretches off the road.
//!
//! # Crate features
//!
//! | feature | |
//! |---|---|
//! | `csv` (default) | networks and drives from CSV files, answers to them |
//! | `geojson` | networks and drives from GeoJSON, networks and routes to it |
//! | `gpx` | drives from GPX files |
//! | `osm` | networks from OpenStreetMap extracts (`.osm.pbf`) |
//! | `rayon` | many drives in parallel, with the same results |
//! | `serde` | vehicles, models of drives and wheels can be stored |

// On docs.rs, labels items with the features that they need.
#![cfg_attr(docsrs, feature(doc_cfg))]

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

/// Compiles the example of the README.
#[cfg(all(doctest, feature = "csv"))]
#[doc = include_str!("../README.md")]
struct Readme;
