//! Tests of files against the library.

mod bad_input;
mod compression;
mod equality;
mod exchanged;
mod files;
mod identity;
mod ids;
mod journal;
mod kills;
mod kit;
mod learn;
mod memory;
mod model_file;
mod observations;
mod overwrite;
mod resume;
mod schemas;
mod skip;
mod ten_commands;
mod ties;
