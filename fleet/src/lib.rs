//! One wayfix model over any number of drives: Arrow and Parquet in, Parquet out.
//!
//! [`run`] reads a file batch by batch, works on the batches with all cores, and writes results in
//! the order of the input, so memory does not grow with the file. Its parts can be used on their
//! own: [`input`] turns record batches into drives, and [`output`] turns drives into record batches
//! of results under a [`model`] read from a file.
//!
//! The README lists the columns and models a file may have; the [`guide`] compares the ways to run
//! and shows how other engines call these functions.

mod checksum;
#[cfg(feature = "ballista")]
pub mod cluster;
pub mod error;
mod expected;
mod finished;
mod folder;
pub mod input;
#[doc = include_str!("guide.md")]
pub mod guide {}
pub mod inspect;
mod job;
mod journal;
mod learn;
mod left_out;
pub mod model;
mod names;
pub mod output;
mod overwrite;
mod partial;
mod pipeline;
pub mod places;
pub mod pool;
mod properties;
mod row_groups;
mod run;
pub mod sensor;
mod simulate;
mod spool;
#[cfg(feature = "sql")]
pub mod sql;
mod storage;

pub use error::{FleetError, Outcome};
pub use job::{Job, Progress, Summary};
pub use learn::{Course, LearnJob, learn};
pub use partial::Start;
pub use properties::Pack;
pub use run::run;
pub use simulate::{SimulateCommand, SimulatedForm};
#[cfg(feature = "object-store")]
pub use storage::register_store;
