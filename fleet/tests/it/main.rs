//! Tests of files against the library.

mod bad_input;
mod equality;
mod files;
mod identity;
mod kit;
mod learn;
mod memory;
mod model_file;
mod observations;
mod resume;
mod skip;
mod ten_commands;
