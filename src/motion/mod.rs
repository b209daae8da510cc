//! Motion of a vehicle: speeds along a route, odometry, places off the map.

mod learn;
mod odometry;
mod route;
mod speeds;
mod window;

pub use odometry::OdometryModel;
pub use route::{
    Driven, OffMap, RouteControl, RouteState, RouteTransition, View, ViewEvidence, ViewRates,
};
pub use speeds::Speeds;
