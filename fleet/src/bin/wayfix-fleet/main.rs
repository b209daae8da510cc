//! The command line: runs a model over files of drives.
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

/// Runs one wayfix model over any number of drives, from Parquet or CSV to Parquet. An interrupted
/// run continues where it was when the same command is given again.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    routine: Routine,
}

#[derive(Debug, Subcommand)]
enum Routine {
    /// Computes the distribution of each step given the whole drive.
    Smooth(Batch),
    /// Computes the distribution of each step given the observations up to it.
    Filter(Batch),
    /// Computes the most probable paths.
    Decode(Batch),
    /// Computes the log-likelihood of each drive.
    Score(Batch),
    /// Learns a model that fits the drives better, by expectation-maximisation.
    Learn(Learn),
    /// Writes the rows of a query, with functions for the routines above.
    #[cfg(feature = "sql")]
    Sql(sql::Sql),
    /// Follows many vehicles live: one line of JSON on standard output for each line on standard
    /// input.
    Live(Live),
    /// Prints the position in the input of `live` after which a snapshot continues, as a line of
    /// JSON.
    Position {
        /// Snapshot from a run of `live`.
        snapshot: PathBuf,
    },
    /// Describes or validates a model file.
    #[command(subcommand)]
    Model(ModelCommand),
    /// Draws drives from a model, with their true states, to try things out.
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
            // `live` has written its summary to standard error, since its standard output is for
            // answers.
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
