//! Guides: which routine to take, the formulas of each routine and the limits of its speed, from
//! image descriptors to a position, from GPS points to a route, a lost robot on a grid, labels,
//! silent states, and the names of other libraries.

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
