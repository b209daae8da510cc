//! Streaming routines, which take one observation at a time, and their states as plain data.
//!
//! The invariant of all of them: a call that fails leaves the state as it was.

#[allow(
    missing_docs,
    clippy::missing_errors_doc,
    reason = "hidden: what the sibling crates share has no promise"
)]
#[allow(missing_debug_implementations, reason = "hidden")]
pub mod bytes;
pub(crate) mod filter;
pub(crate) mod fixed_lag;
pub(crate) mod online_viterbi;
pub(crate) mod tree;
