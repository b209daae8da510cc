//! Guides: which routine to take, the formulas of each routine and the limits of its speed, a lost
//! robot on a grid, labels, silent states, storing models, and the names of dynamax.
//!
//! Other chapters are in the crates that they need: from hmmlearn and from R in wayfix-learn, from
//! GPS points to a route in wayfix-roads, from descriptors of images to a position in
//! wayfix-recognition.

#[doc = include_str!("routines.md")]
pub mod routines {}

#[doc = include_str!("formulas.md")]
pub mod formulas {}

#[doc = include_str!("from_dynamax.md")]
pub mod from_dynamax {}

#[doc = include_str!("labels.md")]
pub mod labels {}

#[doc = include_str!("silent_states.md")]
pub mod silent_states {}

#[doc = include_str!("performance.md")]
pub mod performance {}

#[doc = include_str!("lost_robot.md")]
pub mod lost_robot {}

#[doc = include_str!("storing.md")]
pub mod storing {}
