//! Code shared by both examples on road networks: a made-up city, simulated drives, measures and
//! pictures.

pub(crate) mod certainty;
pub(crate) mod measures;
pub(crate) mod off_road;
pub(crate) mod picture;
pub(crate) mod simulate;
pub(crate) mod town;

use std::error::Error;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressStyle};
use wayfix::map::Position;
use wayfix_roads::RoadNetwork;

/// Creates a progress bar with a label.
pub(crate) fn bar(what: &'static str, count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:20} {bar:40} {pos}/{len}, {eta} left");
    let bar = ProgressBar::new(count as u64).with_message(what);
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}

/// Reports an error, if any, and returns the exit code.
pub(crate) fn exit_code(result: Result<(), Box<dyn Error>>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    // Standard error may be closed, and there is nowhere else to report to.
    let _ = writeln!(io::stderr(), "error: {error}");
    ExitCode::FAILURE
}

/// Prints to standard output; a closed pipe is not an error.
pub(crate) fn print(text: &str) -> Result<(), String> {
    let mut out = io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        printed => printed.map_err(|error| format!("cannot print: {error}")),
    }
}

/// Creates the output folder.
pub(crate) fn create_folder(out: &Path) -> Result<(), String> {
    std::fs::create_dir_all(out).map_err(|e| format!("cannot create {}: {e}", out.display()))
}

/// Error message for output that could not be written.
pub(crate) fn cannot_write(out: &Path, error: impl std::fmt::Display) -> String {
    format!("cannot write into {}: {error}", out.display())
}

/// Parses a finite number above 0.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| *x > 0.0 && x.is_finite());
    number.ok_or_else(|| String::from("expected a finite number above 0"))
}

/// Parses a whole number above 0.
pub(crate) fn whole(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|n| *n > 0);
    number.ok_or_else(|| String::from("expected a whole number above 0"))
}

/// Part of the line of an edge between two distances from its start.
pub(crate) fn line_between(
    network: &RoadNetwork,
    edge: usize,
    enter: f64,
    exit: f64,
) -> Vec<Position> {
    let shape = network.shape(edge);
    let total: f64 = shape.windows(2).map(|pair| pair[0].metres_to(pair[1])).sum();
    let scale = if total > 0.0 { network.edges()[edge].metres / total } else { 0.0 };
    let mut line = vec![network.position_along(edge, enter)];
    let mut along = 0.0;
    for pair in shape.windows(2) {
        along += scale * pair[0].metres_to(pair[1]);
        if along > enter && along < exit {
            line.push(pair[1]);
        }
    }
    line.push(network.position_along(edge, exit));
    line
}
