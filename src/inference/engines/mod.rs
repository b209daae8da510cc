//! Routines that take many steps or many sequences at a time, and the choice among them.

pub(crate) mod choice;
pub(crate) mod few_states;
pub(crate) mod lanes;
pub mod parallel;
