//! Recogniser of a recording: learned from its labelled part, or from a saved fit.

use std::error::Error;
use std::ops::Range;
use std::path::Path;

use wayfix::motion::{OffMap, Speeds};
use wayfix::recognition::{Calibrated, Fit, LabelledPart, Options, Recognizer, Warning};

use super::recording::Recording;
use super::settings::{Offsets, Settings};
use super::{chain, decimals, saved, spinner};

/// Creates the recogniser, and saves the fit if asked to.
pub(super) fn recognizer(
    recording: &Recording,
    settings: &Settings,
) -> Result<Recognizer, Box<dyn Error>> {
    let mut options = Options::default();
    options.closed = recording.closed;
    options.off_map = settings.off_map.then(OffMap::default);
    options.standardize = settings.offsets != Some(Offsets::None);
    if !settings.speeds.is_empty() {
        options.speeds = Speeds::new(&settings.speeds)
            .map_err(|error| format!("--speeds: {}", chain(&error)))?;
    }
    let recognizer = Recognizer::from_distances(recording.references, options)?;
    let fit = match &settings.fit {
        Some(file) => read(file, recording, settings)?,
        None => learned(&recognizer, recording, settings)?,
    };
    let mut options = fit.options().clone();
    if let Some(temperature) = settings.temperature {
        options.odds = options.odds.with_temperature(temperature)?;
    }
    let recognizer = recognizer.with_fit(fit.with_options(options))?;
    if let Some(file) = &settings.save {
        saved::write(file, recognizer.fit())?;
    }
    Ok(recognizer)
}

/// Learns from the labelled part.
fn learned(
    recognizer: &Recognizer,
    recording: &Recording,
    settings: &Settings,
) -> Result<Fit, String> {
    let (rows, odometry) = (recording.rows(), recording.readings());
    let part = |range: &Range<usize>| LabelledPart {
        queries: &rows[range.clone()],
        places: &recording.truth[range.clone()],
        odometry: odometry.get(range.clone()).unwrap_or(&[]),
    };
    let parts: Vec<_> = settings.fit_on.iter().map(part).collect();
    let spinner = spinner("fitting");
    let fitted = recognizer.fitted(&parts);
    spinner.finish_and_clear();
    let fitted = fitted.map_err(|error| format!("--fit-on: {}", chain(&error)))?;
    Ok(fitted.fit().clone())
}

/// Reads a saved fit, which must be for the same kind of route and of places off the map.
fn read(file: &Path, recording: &Recording, settings: &Settings) -> Result<Fit, String> {
    let fit = saved::read(file)?;
    let mut options = fit.options().clone();
    if options.closed != recording.closed {
        let with = if options.closed { "with" } else { "without" };
        return Err(format!(
            "{} was learned {with} --loop, expected the same here",
            file.display()
        ));
    }
    options.off_map = settings.off_map.then(|| options.off_map.unwrap_or_default());
    Ok(fit.with_options(options))
}

/// Summarises the fit, with reasons to doubt it.
pub(super) fn notes(fit: &Fit, recording: &Recording, settings: &Settings) -> Vec<String> {
    let options = fit.options();
    let speeds = options.speeds.values().iter().zip(options.speeds.shares());
    let speeds: Vec<String> =
        speeds.map(|(speed, share)| format!("{speed}: {}", decimals(*share, 3))).collect();
    let (near, any) = options.speeds.changes();
    let mut notes = vec![format!(
        "speeds in references a step, with shares: {}; a change to the next one {near:.4} of \
         steps, to any {any:.4}",
        speeds.join(", "),
    )];
    if recording.odometry.is_some() {
        let odometry = &options.odometry;
        notes.push(format!(
            "odometry: {:.4} for each reference driven, {} standing, with a deviation of {:.3}",
            odometry.scale,
            decimals(odometry.bias, 4),
            odometry.deviation,
        ));
    }
    if let Some(off_map) = &options.off_map {
        notes.push(format!(
            "off the map: leaves it at {:.4} of steps, comes back at {:.4}",
            off_map.leave, off_map.back
        ));
    }
    notes.push(format!("views change by {:.4} or more", options.view_threshold));
    if settings.fit.is_some() && fit.stretches().is_none() {
        notes.push(String::from("what the fit knew of single references was of another number"));
    }
    let from = match (settings.temperature, &settings.fit, fit.calibrated()) {
        (Some(_), ..) => "as given",
        (_, Some(_), _) => "as saved",
        (_, _, Some(_)) => "chosen on the labelled part",
        _ => "the default, as the labelled part is too short to choose one",
    };
    notes.push(format!("temperature {}, {from}", options.odds.temperature()));
    if let Some(Calibrated { temperatures, scores, .. }) = fit.calibrated() {
        notes.push(String::from("temperature: log scores of the filter in blocks of it"));
        notes.extend(temperatures.iter().zip(scores).map(|(temperature, scores)| {
            let scores: Vec<String> = scores.iter().map(|score| decimals(*score, 3)).collect();
            format!("{temperature:>11}: {}", scores.join(", "))
        }));
    }
    let given = settings.temperature.is_some();
    let warnings = fit.warnings().iter();
    let warnings = warnings.filter(|warning| !(given && matches!(warning, Warning::Edge { .. })));
    notes.extend(warnings.map(warned));
    notes
}

/// Formats a warning.
pub(super) fn warned(warning: &Warning) -> String {
    format!("WARNING: {warning}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A forward drive along 20 references, with one step off the map.
    fn recording() -> Recording {
        let cells = (0..20).flat_map(|step| (0..20).map(move |i| (step, i)));
        let seen = |(step, i)| if step == i { 0.0 } else { 1.0 + ((step * 3 + i) % 7) as f32 };
        let truth = (0..20).map(|step| Some(step..=step).filter(|_| step != 18)).collect();
        let distances = cells.map(seen).collect();
        Recording { references: 20, distances, truth, ..Recording::default() }
    }

    fn settings() -> Settings {
        Settings { fit_on: vec![0..12; 1], ..Settings::default() }
    }

    #[test]
    fn what_is_given_is_taken() {
        let recording = recording();
        let given = Settings {
            temperature: Some(4.0),
            offsets: Some(Offsets::None),
            speeds: vec![0.0, 1.0],
            ..settings()
        };
        let recognizer = recognizer(&recording, &given).unwrap();
        let options = recognizer.options();
        assert_eq!((options.odds.temperature(), options.standardize), (4.0, false));
        assert_eq!((options.speeds.values(), options.off_map), (&[0.0, 1.0][..], None));
        let notes = notes(recognizer.fit(), &recording, &given);
        assert!(notes.iter().any(|note| note == "temperature 4, as given"), "{notes:?}");
        assert!(notes.iter().any(|note| note.starts_with("WARNING: 12 steps")), "{notes:?}");
    }

    #[test]
    fn what_cannot_be_learned_says_which_option() {
        let error = |settings| recognizer(&recording(), &settings).unwrap_err().to_string();
        let off = Settings { fit_on: vec![18..20; 1], ..settings() };
        assert!(error(off).starts_with("--fit-on: 1 labelled steps are on the map"));
        let fast = Settings { speeds: vec![0.0, 65.0], ..settings() };
        assert!(error(fast).starts_with("--speeds: speed 1 is 65"));
    }

    #[cfg(feature = "serde")]
    #[test]
    fn a_fit_comes_back() {
        let file = std::env::temp_dir().join(format!("wayfix-fit-{}.json", std::process::id()));
        let mut recording = recording();
        let save = Settings { save: Some(file.clone()), off_map: true, ..settings() };
        let saved = recognizer(&recording, &save).unwrap();
        let again = Settings { fit: Some(file.clone()), off_map: true, ..Settings::default() };
        let read = recognizer(&recording, &again).unwrap();
        assert_eq!(read.options(), saved.options());
        let beliefs = [saved, read].map(|recognizer| {
            let recording = recognizer.recording(&recording.rows(), &[]).unwrap();
            recording.filtered().unwrap().answers()
        });
        assert_eq!(beliefs[0], beliefs[1]);
        let on = Settings { off_map: false, temperature: Some(2.0), ..again.clone() };
        let read = recognizer(&recording, &on).unwrap();
        assert_eq!((read.options().off_map, read.options().odds.temperature()), (None, 2.0));
        recording.closed = true;
        let error = recognizer(&recording, &again).unwrap_err().to_string();
        assert!(error.ends_with("was learned without --loop, expected the same here"), "{error}");
        std::fs::write(&file, "{}").unwrap();
        let error = recognizer(&recording, &again).unwrap_err().to_string();
        assert!(error.contains("is not a fit: "), "{error}");
        std::fs::remove_file(file).unwrap();
    }
}
