//! Engines: routines that process many steps or many sequences at a time, and the choice among
//! them.
//!
//! An engine gives the result that single steps would give, or `None`; then the caller falls back
//! to single steps, which handle every range of numbers and report every error.

pub(crate) mod choice;
pub(crate) mod few_states;
pub(crate) mod lanes;
pub mod parallel;
