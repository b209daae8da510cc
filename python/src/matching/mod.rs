//! Matching of GPS points to roads, for `wayfix.matching`.

mod answers;
mod drive;
mod learned;
mod matcher;
mod network;
mod points;
mod stored;
mod stretches;
mod trips;
mod vehicle;

pub(crate) use answers::{PyRoadAnswer, PyRoadAnswers};
pub(crate) use drive::PyMatchedDrive;
pub(crate) use learned::PyLearnedMatchModel;
pub(crate) use matcher::{PyMatcher, read_traces};
pub(crate) use network::PyRoadNetwork;
pub(crate) use stretches::{PyRankedRoutes, PyStretches};
pub(crate) use vehicle::PyVehicle;
