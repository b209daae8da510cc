//! Code that both examples on visual place recognition share, from a recording to the answers of
//! several methods, with tables and pictures.

pub(crate) mod arguments;
mod belief;
pub(crate) mod drive;
pub(crate) mod estimate;
pub(crate) mod figures;
mod fit;
pub(crate) mod measures;
pub(crate) mod patches;
pub(crate) mod recording;
mod saved;
mod seqslam;
pub(crate) mod settings;
mod shades;
pub(crate) mod style;
pub(crate) mod synthetic;
pub(crate) mod tables;

use std::error::Error;
use std::fs;
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use arguments::Common;
use drive::Drive;
use estimate::Estimates;
use measures::Measured;
use patches::{Descriptors, Frames};
use recording::Recording;
use seqslam::SeqSlam;
use settings::Settings;

/// Creates a progress bar with a label.
pub(crate) fn bar(what: &'static str, count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:20} {bar:40} {pos}/{len} steps, {eta} left");
    let bar = ProgressBar::new(count as u64).with_message(what);
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}

/// Shows a spinner with a label while something runs.
pub(crate) fn spinner(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(what);
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}

/// Formats an error with its causes.
pub(crate) fn chain(error: &(dyn Error + 'static)) -> String {
    let causes = std::iter::successors(error.source(), |error| (*error).source());
    causes.fold(error.to_string(), |text, cause| {
        let cause = cause.to_string();
        // Some errors include their cause in the message.
        if text.contains(&cause) { text } else { format!("{text}: {cause}") }
    })
}

/// Reports an error, if any, and returns the exit code.
pub(crate) fn exit_code(result: Result<(), Box<dyn Error>>) -> ExitCode {
    let Err(error) = result else { return ExitCode::SUCCESS };
    // Standard error may be closed.
    let _ = writeln!(io::stderr(), "error: {}", chain(&*error));
    ExitCode::FAILURE
}

/// Formats a count, as "1 step" or "2 steps".
pub(crate) fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Formats with the given number of decimals, without a minus before zero.
pub(crate) fn decimals(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|byte| b"0.".contains(&byte)) => zero.to_owned(),
        _ => text,
    }
}

/// Name of a recording: the last part of a path.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Descriptors of the places of a map.
pub(crate) fn places(
    references: &Frames,
    map: &Range<usize>,
    patch: usize,
) -> Result<Descriptors, String> {
    let frames = references.count();
    if map.end > frames {
        return Err(format!(
            "--reference-range {}..{}: frame {} is not in the recording, expected frames 0 to {}",
            map.start,
            map.end,
            map.end - 1,
            frames - 1
        ));
    }
    references.descriptors(map.clone(), patch)
}

/// Compares the frame shown at each step of a drive with the places of a map. Frame i of the map
/// shows the place of frame i of the query.
pub(crate) fn compare(
    name: String,
    places: &Descriptors,
    map: &Range<usize>,
    sightings: &Descriptors,
    drive: &Drive,
) -> Result<Recording, String> {
    let bar = bar("comparing frames", drive.frames.len());
    let distances = patches::differences(sightings, places, &bar)?;
    bar.finish_and_clear();
    let place = |frame: &usize| map.contains(frame).then(|| frame - map.start..=frame - map.start);
    let truth = drive.frames.iter().map(place).collect();
    Ok(Recording { name, references: map.len(), distances, truth, ..Recording::default() })
}

/// Estimates of all methods, and their measures.
pub(crate) struct Outcome {
    pub(crate) estimates: Estimates,
    pub(crate) measured: Vec<Measured>,
}

/// Estimates and measures.
pub(crate) fn outcome(
    recording: &Recording,
    settings: &Settings,
    seqslam: &SeqSlam,
) -> Result<Outcome, Box<dyn Error>> {
    let Settings { report_on, tolerances, .. } = settings;
    if report_on.iter().all(|step| recording.truth[*step].is_none()) {
        let count = report_on.len();
        return Err(format!(
            "none of the {count} steps to report on is on the map, expected --report-on to have \
             one that is, by the truth"
        )
        .into());
    }
    let nowhere = |step: &usize| recording.row(*step).iter().all(|d| *d == f32::INFINITY);
    if let Some(step) = (0..recording.steps()).find(nowhere).filter(|_| !settings.off_map) {
        return Err(format!(
            "all distances of query {step} are infinite, expected a finite one or --off-map"
        )
        .into());
    }
    let mut estimates = estimate::estimate(recording, settings)?;
    let recall = |answers: &recording::Answers| {
        measures::recall(recording, &answers.places, tolerances[0], report_on)
    };
    for (sequence, answers) in seqslam.run(recording, recall) {
        let best = match &seqslam.sequences[..] {
            [_] => String::new(),
            tried => format!(
                "; of {tried:?} the best by recall {} on the steps reported on, which favours SeqSLAM",
                figures::within(tolerances[0])
            ),
        };
        let lines = counted(sequence, "step");
        estimates.notes.push(format!("{}: windows of {lines}{best}", answers.method));
        estimates.answers.push(answers);
    }
    estimates.answers.sort_by_key(|answers| style::order(&answers.method));

    let measure = |answers| measures::measure(recording, answers, tolerances, report_on);
    let mut measured = estimates.answers.iter().map(measure).collect::<Result<Vec<_>, _>>()?;
    if !settings.off_map {
        // Being on the map was not estimated.
        measured.iter_mut().for_each(|method| method.roc = None);
        let mut used = settings.fit_on.iter().cloned().flatten().chain(report_on.iter().copied());
        if used.any(|step| recording.truth[step].is_none()) {
            let note = "places off the map were ruled out: add --off-map";
            estimates.notes.push(note.to_owned());
        }
    }
    Ok(Outcome { estimates, measured })
}

/// Estimates, measures, writes and prints.
pub(crate) fn run(
    recording: &Recording,
    common: &Common,
    out: &Path,
) -> Result<Outcome, Box<dyn Error>> {
    let settings = common.settings(recording.steps())?;
    fs::create_dir_all(out).map_err(|e| format!("cannot create {}: {e}", out.display()))?;
    let outcome = outcome(recording, &settings, &common.seqslam())?;
    let report = tables::report(recording, &settings, &outcome.estimates.notes, &outcome.measured);
    write(recording, &settings, &outcome, &report, out)
        .map_err(|error| cannot_write(out, &*error))?;
    print(&format!("{report}\nWrote report, tables and pictures into {}\n", out.display()))?;
    Ok(outcome)
}

/// Error message for output that could not be written.
pub(crate) fn cannot_write(out: &Path, error: &(dyn Error + 'static)) -> String {
    format!("cannot write into {}: {}", out.display(), chain(error))
}

/// Prints to standard output; a closed pipe is no error.
pub(crate) fn print(text: &str) -> Result<(), String> {
    let mut out = io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        printed => printed.map_err(|error| format!("cannot print: {error}")),
    }
}

fn write(
    recording: &Recording,
    settings: &Settings,
    outcome: &Outcome,
    report: &str,
    out: &Path,
) -> Result<(), Box<dyn Error>> {
    let (name, tolerances) = (&recording.name, &settings.tolerances);
    let Outcome { estimates, measured } = outcome;
    let recalls = |places: &[Option<usize>]| {
        let recall =
            |&tolerance| measures::recall(recording, places, tolerance, &settings.report_on);
        tolerances.iter().map(recall).collect()
    };
    let lags: Vec<(usize, Vec<f64>)> =
        estimates.lags.iter().map(|(lag, places)| (*lag, recalls(places))).collect();
    fs::write(out.join("report.txt"), report)?;
    tables::write_table(&out.join("table.csv"), measured)?;
    tables::write_answers(&out.join("answers.csv"), recording, tolerances, &estimates.answers)?;
    tables::write_precision_recall(&out.join("precision_recall.csv"), measured)?;
    tables::write_reliability(&out.join("reliability.csv"), measured)?;
    tables::write_lags(&out.join("lag.csv"), tolerances, &lags)?;
    figures::precision_recall(&out.join("precision_recall.svg"), name, measured)?;
    figures::reliability(&out.join("reliability.svg"), name, measured)?;
    figures::lags(&out.join("lag.svg"), name, tolerances, &lags)?;
    let file = out.join("belief.svg");
    belief::draw(&file, recording, &estimates.belief, &estimates.answers, &settings.fit_on)?;
    let [table, picture] = ["roc.csv", "roc.svg"].map(|file| out.join(file));
    if measured.iter().any(|method| method.roc.is_some()) {
        tables::write_roc(&table, measured)?;
        figures::roc(&picture, name, measured)?;
    } else {
        // Files of an earlier run would not match the others.
        for file in [table, picture] {
            fs::remove_file(file).or_else(|error| match error.kind() {
                io::ErrorKind::NotFound => Ok(()),
                _ => Err(error),
            })?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use thiserror::Error;

    use super::*;

    #[derive(Debug, Error)]
    #[error("outer")]
    struct Outer(#[source] Middle);

    #[derive(Debug, Error)]
    #[error("middle: {0}")]
    struct Middle(#[source] io::Error);

    #[test]
    fn zeros_have_no_minus() {
        let values = [-0.0, -0.00004, -0.00006, 0.5, f64::NEG_INFINITY];
        let texts = values.map(|value| decimals(value, 4));
        assert_eq!(texts, ["0.0000", "0.0000", "-0.0001", "0.5000", "-inf"]);
        assert_eq!(decimals(-0.4, 0), "0");
    }

    #[test]
    fn errors_say_each_cause_once() {
        assert_eq!(chain(&Outer(Middle(io::Error::other("inner")))), "outer: middle: inner");
        assert_eq!(chain(&io::Error::other("inner")), "inner");
    }
}
