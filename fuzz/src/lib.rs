//! Fuzz targets of wayfix: functions of arbitrary bytes, which panic if the library breaks a
//! promise.
//!
//! `cargo fuzz` calls them with bytes that it evolves, the binary `seeded` with
//! pseudo-random ones; CONTRIBUTING.md says how to run both. The bytes are not in
//! a format: they are the choices by which a model or a document is made, and any
//! bytes make one.
#![forbid(unsafe_code)]

mod counts;
mod differential;
mod draw;
mod matrices;
mod model;
mod operators;
mod readers;

mod reference;

pub use counts::Counts;
pub use differential::differential;
pub use readers::{csv, json_models, json_snapshots, roads};

/// Target: makes an input of bytes, checks what the library does with it, and counts the checks.
pub type Target = fn(&[u8], &mut Counts);

/// All targets with their names, and the largest number of bytes that each uses.
pub const TARGETS: [(&str, Target, usize); 5] = [
    ("differential", differential, 6000),
    ("csv", csv, 800),
    ("json_models", json_models, 1500),
    ("json_snapshots", json_snapshots, 4000),
    ("roads", roads, 1500),
];
