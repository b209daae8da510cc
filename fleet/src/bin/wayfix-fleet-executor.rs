//! Executor of a cluster that runs queries with the functions of wayfix.

use std::process::ExitCode;

use clap::Parser;
use wayfix_fleet::cluster::ExecutorCommand;

fn main() -> ExitCode {
    match ExecutorCommand::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
