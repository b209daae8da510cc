//! Posteriors of whole sequences, one or many; paths drawn from them; simulation.
//!
//! All use the steps of [`step`](super::step), or an engine that gives the same results.

pub(crate) mod forward_backward;
pub(crate) mod left_out;
pub(crate) mod many;
pub(crate) mod paths;
pub(crate) mod simulation;
pub(crate) mod smooth_each;
