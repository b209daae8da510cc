//! Runs a model over a file of drives.
//!
//! ```text
//! wayfix-fleet smooth --model model.json --input drives.parquet --output smoothed.parquet
//! ```

mod bar;
mod batch;
mod files;
mod learn;
mod live;
#[cfg(feature = "sql")]
mod sql;

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use wayfix_fleet::SimulateCommand;
use wayfix_fleet::inspect::ModelCommand;
use wayfix_fleet::output::Verb;

use batch::Batch;
use learn::Learn;
use live::Live;

/// One wayfix model over any number of drives, from Parquet or CSV to Parquet. A run that was
/// interrupted goes on where it was when the same command is given again.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    routine: Routine,
}

#[derive(Debug, Subcommand)]
enum Routine {
    /// The distribution of every step given the whole drive.
    Smooth(Batch),
    /// The distribution of every step given those up to it.
    Filter(Batch),
    /// The most probable paths.
    Decode(Batch),
    /// The log-likelihood of every drive.
    Score(Batch),
    /// A model that fits the drives better, by expectation and maximisation.
    Learn(Learn),
    /// The rows of a query, with functions for the routines above.
    #[cfg(feature = "sql")]
    Sql(sql::Sql),
    /// The position of each of many vehicles, as they are seen: lines of JSON to standard output
    /// for those on standard input.
    Live(Live),
    /// Where the input of `live` goes on after a snapshot: a line of JSON.
    Position {
        /// Snapshot of a run of `live`.
        snapshot: PathBuf,
    },
    /// What the file of a model says, and whether it is valid.
    #[command(subcommand)]
    Model(ModelCommand),
    /// Drives that are drawn from a model, with their true states, for trying things.
    Simulate(SimulateCommand),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().routine {
        Routine::Smooth(options) => options.run(Verb::Smooth),
        Routine::Filter(options) => options.run(Verb::Filter),
        Routine::Decode(options) => options.run(Verb::Decode),
        Routine::Score(options) => options.run(Verb::Score),
        Routine::Learn(options) => options.run(),
        #[cfg(feature = "sql")]
        Routine::Sql(options) => options.run(),
        Routine::Live(options) => options.run(),
        Routine::Position { snapshot } => live::show_position(&snapshot),
        Routine::Model(command) => command.run(),
        Routine::Simulate(command) => command.run(),
    };
    match done {
        Ok(text) => {
            if !text.is_empty() {
                // Standard output may be closed.
                let _ = writeln!(io::stdout(), "{text}");
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            let _ = writeln!(io::stderr(), "error: {error}");
            ExitCode::FAILURE
        }
    }
}
