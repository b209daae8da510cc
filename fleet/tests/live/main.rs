//! Tests of live vehicles against filters of the library.

mod answers;
#[cfg(unix)]
mod clients;
mod filters;
mod guards;
mod kills;
#[path = "../it/kit/mod.rs"]
#[allow(dead_code, reason = "shared with the tests of files")]
mod kit;
mod limits;
mod lines;
#[cfg(unix)]
mod listen;
mod models;
mod service;
#[cfg(unix)]
mod signals;
mod snapshots;
mod time;
