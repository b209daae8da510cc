//! Motion of a vehicle: odometry as evidence on moves, and a state off the map.
//!
//! | for | take |
//! |---|---|
//! | a road map, with the metres driven from place to place | [`DistanceTransition`], with an [`OdometryReading`] as its control; **not** for steps shorter than a road |
//! | a vehicle that may leave the map, on any operator | [`OffMapTransition`] |
//! | a floor of cells, with (dx, dy) from wheels, and a robot that may be carried elsewhere | [`EvidenceTransition`](crate::transition::EvidenceTransition) in a [`RestartTransition`](crate::transition::RestartTransition): the chapter on [a lost robot](crate::guide::lost_robot) |
//!
//! Operators of single moves, without a vehicle in mind, are in
//! [`transition`](crate::transition). Metres driven along road networks are in wayfix-roads, hidden
//! speeds along a route of images in wayfix-recognition.

mod distance;
mod off_map;

pub use distance::{DistanceTransition, OdometryReading};
pub use off_map::OffMapTransition;
