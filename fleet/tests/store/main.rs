//! Tests of inputs in object stores against the same files on a disk.

#[path = "../it/kit/mod.rs"]
#[allow(dead_code, reason = "shared with the tests of files")]
mod kit;
mod listing;
mod same;
mod shelf;
