//! The recogniser of a recording: the defaults, a fit to its labelled part, or a saved fit.

use std::{ops::Range, path::Path};

use wayfix_recognition::motion::{OffMap, Speeds};
use wayfix_recognition::{LabelledPart, Options, Parameters, Recognizer};

use super::{Fallible, Task, waiting};

pub(crate) fn recognizer(Task { recording, split, common }: Task<'_>) -> Fallible<Recognizer> {
    let off_map = common.off_map.then(OffMap::default);
    let mut options = Options::default().with_closed(recording.closed).with_off_map(off_map);
    if !common.speeds.is_empty() {
        let mut speeds = common.speeds.clone();
        speeds.sort_by(f64::total_cmp);
        speeds.dedup();
        let speeds = Speeds::new(&speeds).map_err(|error| format!("--speeds: {error}"))?;
        options = options.with_speeds(speeds);
    }
    let mut recognizer = Recognizer::from_distances(recording.references, options)?;
    if let Some(file) = &common.fit {
        let fit = saved(file)?;
        // Whether the route is closed, and whether it may be left, depends on this recording, not
        // on the saved fit.
        let off_map = common.off_map.then(|| fit.options().off_map().unwrap_or_default());
        let options = fit.options().clone().with_closed(recording.closed).with_off_map(off_map);
        recognizer = recognizer.with_parameters(fit.with_options(options))?;
    } else if let Some(truth) = recording.truth.as_ref().filter(|_| !split.fit_on.is_empty()) {
        let rows = recording.rows();
        let part = |range: &Range<usize>| LabelledPart {
            queries: &rows[range.clone()],
            places: &truth[range.clone()],
            odometry: recording.odometry.get(range.clone()).unwrap_or(&[]),
        };
        let parts: Vec<_> = split.fit_on.iter().map(part).collect();
        let fitted = waiting("fitting", || recognizer.fit(&parts));
        recognizer = fitted.map_err(|error| format!("--fit-on: {error}"))?;
    }
    Ok(recognizer)
}

/// Summary of a fit: speeds in use, and warnings.
pub(crate) fn notes(fit: &Parameters) -> Vec<String> {
    let speeds = fit.options().speeds();
    let used = speeds.values().iter().zip(speeds.shares()).filter(|(_, share)| **share >= 0.01);
    let used: Vec<String> = used.map(|(speed, share)| format!("{speed}: {share:.2}")).collect();
    let mut notes = vec![format!("shares of speeds: {}", used.join(", "))];
    notes.extend(fit.warnings().iter().map(|warning| format!("WARNING: {warning}")));
    notes
}

#[cfg(feature = "serde")]
fn saved(file: &Path) -> Result<Parameters, String> {
    let name = file.display();
    let text = std::fs::read(file).map_err(|error| format!("cannot read {name}: {error}"))?;
    serde_json::from_slice(&text).map_err(|error| format!("{name} is not a fit: {error}"))
}

#[cfg(feature = "serde")]
pub(crate) fn save(file: &Path, fit: &Parameters) -> Result<(), String> {
    let written = serde_json::to_vec(fit).map_err(std::io::Error::from);
    let written = written.and_then(|text| std::fs::write(file, text));
    written.map_err(|error| format!("cannot write {}: {error}", file.display()))
}

#[cfg(not(feature = "serde"))]
fn saved(_: &Path) -> Result<Parameters, String> {
    Err(String::from("--fit: expected `cargo run --features serde`"))
}

#[cfg(not(feature = "serde"))]
pub(crate) fn save(_: &Path, _: &Parameters) -> Result<(), String> {
    Err(String::from("--save: expected `cargo run --features serde`"))
}
