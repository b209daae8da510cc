//! Roads cut into cells of a few metres: where along a road a vehicle is, how it moves there, and
//! the sensors of such places.
//!
//! | for | take |
//! |---|---|
//! | a road network as states | [`RoadCells`] |
//! | the metres driven, for steps of any length | [`CellTransition`], with a [`Travel`] from an [`Odometer`] |
//! | the same by an odometer whose [`Wheels`] are of another size than it takes them for, or slip | [`WheelTransition`], with a [`WheelTravel`] from a [`WheelOdometer`] |
//! | measured positions | [`PositionLikelihood`] |
//! | tags that are read at nodes, or names of roads | [`TagLikelihood`] |

mod motion;
mod position;
mod road_cells;
mod tags;

pub use motion::{
    CellTransition, EdgeTurns, Odometer, Travel, TurnWeights, WheelOdometer, WheelTransition,
    WheelTravel, Wheels,
};
pub use position::{PositionFix, PositionLikelihood};
pub use road_cells::RoadCells;
pub use tags::{ReadRates, TagLikelihood};
