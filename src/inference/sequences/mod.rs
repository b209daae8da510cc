//! Posteriors of whole sequences, one or many; paths drawn from them; simulation.
//!
//! All use the steps of [`step`](super::step), or an engine that gives the same results.

pub(crate) mod forward;
pub(crate) mod left_out;
pub(crate) mod many_sequences;
pub(crate) mod pairwise;
pub(crate) mod path_entropy;
pub(crate) mod path_sampler;
pub(crate) mod posteriors;
pub(crate) mod simulation;
pub(crate) mod smooth_each;
pub(crate) mod smoother;
