//! Maps of places and directed roads, and their transition operators.
//!
//! A [`RoadMap`] holds [`Place`]s and [`Road`]s, built in code or read from two CSV files, and
//! answers the usual queries: neighbours, hops, metres, the nearest place, the shortest path.
//! Places are on Earth (a [`Position`] in degrees) or in a plane (a [`PlanePosition`] in metres, as
//! in a warehouse). Raw data with duplicate roads or loops can be [cleaned](RoadMap::cleaned), with
//! a report. A [`TurningRule`] (or your own frequencies) gives the [`TurningProbabilities`] Φ, and
//! these give the transition operator A = Φ'. They can also be learned: from moves of drives, or
//! from counts of traffic ([`TurningProbabilities::fit`] and
//! [`fit_traffic`](TurningProbabilities::fit_traffic)).
//!
//! Where the position along a road matters, a `RoadNetwork` of directed edges with their lines is
//! cut into `RoadCells`, on which vehicles move: both are in wayfix-roads.
//!
//! ```
//! use wayfix::map::{Place, Position, Road, RoadClass, RoadMap, TurningProbabilities, TurningRule};
//!
//! let place = |id, latitude| Place {
//!     id,
//!     position: Position { latitude, longitude: 149.13 },
//!     name: String::new(),
//! };
//! let road = |from, to| Road { from, to, class: RoadClass::Street, metres: 112.0 };
//! let map = RoadMap::new(
//!     [place(1, -35.280), place(2, -35.281), place(3, -35.282)],
//!     [road(1, 2), road(2, 1), road(2, 3), road(3, 2)],
//! )?;
//! assert!(map.is_strongly_connected());
//! assert_eq!(map.hops_from(0), [Some(0), Some(1), Some(2)]);
//!
//! let turning = TurningProbabilities::by_rule(&map, &TurningRule::default())?;
//! assert!((turning.get(1, 0) - 0.4).abs() < 1e-15); // two equal streets, and stops
//! let a = turning.into_transition();
//! # let _: wayfix::SparseTransition = a;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod class;
mod components;
mod error;
#[allow(clippy::missing_errors_doc, reason = "hidden: for road networks")]
mod flow;
#[allow(
    missing_docs,
    clippy::missing_errors_doc,
    reason = "hidden: what the sibling crates share has no promise"
)]
mod places;
mod position;
mod road_map;
#[allow(missing_docs, reason = "hidden: for road networks")]
mod search;
mod turning;

pub use class::RoadClass;
pub use error::MapError;
pub use places::Place;
pub use position::{Coordinates, PlanePosition, Position};
pub use road_map::{CleaningReport, Road, RoadMap, RoadPath};
pub use turning::{ByClass, FittedTurn, TurningProbabilities, TurningRule};

// For networks of roads, in a crate of their own.
#[doc(hidden)]
pub use {
    components::components,
    flow::balance,
    places::{Places, check_position},
    position::wrapped,
    search::{Label, Search},
};
