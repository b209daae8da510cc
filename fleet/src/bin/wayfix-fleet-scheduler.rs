//! Scheduler of a cluster that runs queries with the functions of wayfix.

use std::process::ExitCode;

use clap::Parser;
use wayfix_fleet::cluster::SchedulerCommand;

fn main() -> ExitCode {
    match SchedulerCommand::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
