//! Code shared by the two examples on visual place recognition: from a recording to the answers of
//! several methods, with tables and pictures.

pub(crate) mod arguments;
mod belief;
pub(crate) mod drive;
mod fit;
mod frames;
mod measures;
mod methods;
mod npy;
mod pictures;
mod plain;
pub(crate) mod recording;
pub(crate) mod report;
mod seqslam;
mod sixty;
pub(crate) mod synthetic;

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::{error::Error, fs, process::ExitCode, time::Duration};

use indicatif::{ProgressBar, ProgressStyle};

pub(crate) use arguments::{Common, Split};
pub(crate) use drive::Drive;
pub(crate) use frames::{Frames, Pass, generator};
pub(crate) use measures::{Measured, recall};
pub(crate) use methods::{Estimates, Method};
pub(crate) use npy::Array;
pub(crate) use recording::Recording;

pub(crate) type Fallible<T = ()> = Result<T, Box<dyn Error>>;

/// A recording with the steps to learn from and to report on, and options.
#[derive(Clone, Copy)]
pub(crate) struct Task<'a> {
    pub(crate) recording: &'a Recording,
    pub(crate) split: &'a Split,
    pub(crate) common: &'a Common,
}

pub(crate) fn bar(what: &'static str, count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:20} {bar:40} {pos}/{len} steps, {eta} left");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(count as u64).with_message(what).with_style(style)
}

/// Runs a function behind a spinner.
fn waiting<T>(what: &'static str, run: impl FnOnce() -> T) -> T {
    let spinner = ProgressBar::new_spinner().with_message(what);
    spinner.enable_steady_tick(Duration::from_millis(100));
    let result = run();
    spinner.finish_and_clear();
    result
}

pub(crate) fn exit_code(result: Fallible) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    // Standard error may be closed.
    let _ = writeln!(io::stderr(), "error: {error}");
    ExitCode::FAILURE
}

/// Prints to standard output, which may be closed.
pub(crate) fn print(text: &str) {
    let _ = writeln!(io::stdout(), "{text}");
}

/// Formats a number with four decimals, without a minus before zero.
pub(crate) fn number(value: f64) -> String {
    format!("{value:.4}").replace("-0.0000", "0.0000")
}

/// Name of a recording: the last parts of its paths.
pub(crate) fn name(paths: &[&Path]) -> String {
    let last = paths.iter().map(|path| path.file_name().unwrap_or(path.as_os_str()).display());
    last.map(|name| name.to_string()).collect::<Vec<_>>().join(" on ")
}

pub(crate) fn estimate(task: Task<'_>) -> Fallible<(Estimates, Vec<Measured>)> {
    let (estimates, mut measured) = (methods::estimate(task)?, Vec::new());
    for method in &estimates.methods {
        measured.extend(measures::measure(task, method)?);
    }
    Ok((estimates, measured))
}

/// Estimates, measures, writes and prints. Returns the folder of the outputs.
pub(crate) fn run(recording: &Recording, common: &Common, example: &str) -> Fallible<PathBuf> {
    let split = &common.split(recording)?;
    let out = common.out.clone().unwrap_or_else(|| Path::new("target").join(example));
    let task = Task { recording, split, common };
    let (estimates, measured) = estimate(task)?;
    if let Some(file) = &common.save {
        fit::save(file, &estimates.fit)?;
    }
    let written = write(task, &estimates, &measured, &out);
    written.map_err(|error| format!("cannot write into {}: {error}", out.display()))?;
    print(&format!("Wrote answers, tables and pictures into {}", out.display()));
    Ok(out)
}

fn write(task: Task<'_>, estimates: &Estimates, measured: &[Measured], out: &Path) -> Fallible {
    fs::create_dir_all(out)?;
    let report = report::report(task, &estimates.notes, measured);
    fs::write(out.join("report.txt"), &report)?;
    print(&report);
    for (name, answers) in &estimates.answers {
        report::write_answers(&out.join(format!("{name}.csv")), answers)?;
    }
    belief::draw(&out.join("belief.svg"), task, estimates)?;
    let scored = ["table.csv", "precision_recall.svg", "reliability.svg"].map(|of| out.join(of));
    let [Measured { tolerance, .. }, ..] = measured else {
        // Files of an earlier run would not match the others, so they are removed.
        return Ok(scored.iter().filter(|file| file.exists()).try_for_each(fs::remove_file)?);
    };
    let first: Vec<_> = measured.iter().filter(|score| score.tolerance == *tolerance).collect();
    let rows: Vec<_> = measured.iter().map(report::cells).collect();
    report::write(&scored[0], report::TABLE, &rows)?;
    pictures::precision_recall(&scored[1], &task.recording.name, &first)?;
    pictures::reliability(&scored[2], &task.recording.name, &first)
}
