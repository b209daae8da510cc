//! Motion of a vehicle: speeds along a route, odometry, places off the map.
//!
//! | for | take |
//! |---|---|
//! | places in a row (reference images), with steps of any length | [`RouteTransition`], with hidden [`Speeds`] and a [`RouteControl`] |
//! | a road map, with the metres driven from place to place | [`DistanceTransition`], with an [`OdometryReading`] as its control; **not** for steps shorter than a road |
//! | a road network, with the metres driven in steps of any length | [`CellTransition`] on [`RoadCells`](crate::map::RoadCells), with a [`Travel`] from an [`Odometer`] |
//! | the same, where [`Wheels`] slip or differ in size from what the odometer assumes | [`WheelTransition`], with a [`WheelTravel`] from a [`WheelOdometer`] |
//! | a vehicle that may leave the map, on any operator | [`OffMapTransition`] |
//! | errors of odometry along a route | [`OdometryModel`] |
//! | a floor of cells, with (dx, dy) from wheels, and a robot that may be carried elsewhere | [`EvidenceTransition`](crate::transition::EvidenceTransition) in a [`RestartTransition`](crate::transition::RestartTransition): the chapter on [a lost robot](crate::guide::lost_robot) |
//!
//! Operators of single moves, without a vehicle in mind, are in
//! [`transition`](crate::transition).

mod distance;
mod off_map;

pub use distance::{DistanceTransition, OdometryReading};
pub use off_map::OffMapTransition;
