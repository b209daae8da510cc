//! Motion of a vehicle: speeds along a route, odometry, places off the map.

mod distance;
mod learn;
mod odometry;
mod off_map;
mod route;
mod speeds;
mod window;

pub use distance::{DistanceTransition, OdometryReading};
pub use odometry::OdometryModel;
pub use off_map::OffMapTransition;
pub use route::{
    Driven, OffMap, RouteControl, RouteState, RouteTransition, ViewChange, ViewChangeRates,
    ViewEvidence,
};
pub use speeds::Speeds;
