//! Streaming routines, which take one observation at a time, and their states as plain data.
//!
//! The invariant of all of them: a call that fails leaves the state as it was.

pub(crate) mod distractor;
pub(crate) mod filter;
pub(crate) mod fixed_lag;
pub(crate) mod online_viterbi;
mod snapshot;
pub(crate) mod tree;
