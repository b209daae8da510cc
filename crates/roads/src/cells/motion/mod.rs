//! Motion on the cells of roads by metres driven, with independent errors of the readings or with
//! wheels whose errors last.

mod cell_transition;
mod odometer;
mod travel;
mod turns;
mod wheel_transition;
mod wheels;

pub use cell_transition::CellTransition;
pub use odometer::Odometer;
pub use travel::Travel;
pub use turns::{EdgeTurns, TurnWeights};
pub use wheel_transition::WheelTransition;
pub use wheels::{WheelOdometer, WheelTravel, Wheels};
