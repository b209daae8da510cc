//! Tests of the functions in SQL against the library.

mod bad_input;
mod equality;
mod folder;
#[path = "../it/kit/mod.rs"]
#[allow(dead_code, reason = "shared with the tests of files")]
mod kit;
mod learn;
mod long;
mod memory;
mod observations;
mod overwrite;
mod parts;
mod tables;
mod unordered;
