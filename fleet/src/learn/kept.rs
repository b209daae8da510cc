//! Files of learning: the output, and beside it a lock, the state of an unfinished run
//! (`.partial`), and the record of a finished one (`.run`).
//!
//! Each is written under a temporary name, synced and renamed, so it is either the old file or the
//! new one at any moment.

use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use twox_hash::XxHash3_64;

use super::Course;
use crate::checksum;
use crate::error::{FleetError, Outcome};
use crate::journal::Lock;
use crate::overwrite::beside;

/// State of an unfinished run after a re-estimation.
#[derive(Serialize, Deserialize)]
pub(super) struct State {
    pub(super) settings: Value,
    pub(super) course: Course,
    pub(super) model: Value,
}

/// Record of a finished run, which the JSON of a model has no place for.
#[derive(Serialize, Deserialize)]
struct Finished {
    settings: Value,
    course: Course,
    /// Hash of the output.
    output: String,
}

/// Files of a run, locked against other runs.
pub(super) struct Kept<'a> {
    output: &'a Path,
    partial: PathBuf,
    run: PathBuf,
    _lock: Lock,
}

impl<'a> Kept<'a> {
    pub(super) fn open(output: &'a Path) -> Outcome<Self> {
        let [partial, run] = [".partial", ".run"].map(|ending| beside(output, ending));
        Ok(Self { output, partial, run, _lock: Lock::new(output)? })
    }

    /// State of the unfinished run with these settings, if any.
    pub(super) fn state(&self, settings: &Value) -> Outcome<Option<State>> {
        if !self.partial.exists() {
            return Ok(None);
        }
        let Some(state) = load::<State>(&self.partial)? else {
            let message =
                "is damaged, or from another version of this program; start over with --restart";
            return Err(FleetError::format(&self.partial, message));
        };
        if state.settings != *settings {
            let message = "is from an unfinished run with another model, input, prior or other \
                           columns; repeat that run, or start over with --restart";
            return Err(FleetError::Settings(format!("{} {message}", self.partial.display())));
        }
        Ok(Some(state))
    }

    pub(super) fn write(&self, state: &State) -> Outcome<()> {
        put(&self.partial, &checksum::line(&json(&self.partial, state)?))
    }

    /// Record of the run that made the output, if it had these settings.
    pub(super) fn finished(&self, settings: &Value) -> Outcome<Option<Course>> {
        if !self.run.exists() {
            return Ok(None);
        }
        let text = fs::read(self.output).map_err(FleetError::file(self.output))?;
        let found = load::<Finished>(&self.run)?;
        // The hash ties the record to this very file: the output may have been replaced since.
        let found = found.filter(|run| run.settings == *settings && run.output == hash(&text));
        if found.is_some() {
            // The run may have been killed just before it did this.
            self.remove_partial()?;
        }
        Ok(found.map(|run| Course { finished: true, ..run.course }))
    }

    /// Writes the output. The record goes first: until the output is there, its hash matches no
    /// file, whereas an output without a record could not be recognised as finished.
    pub(super) fn finish(
        &self,
        model: &impl Serialize,
        course: &Course,
        settings: Value,
    ) -> Outcome<()> {
        let text = json(self.output, model)?;
        let (course, output) = (course.clone(), hash(text.as_bytes()));
        let run = json(&self.run, &Finished { settings, course, output })?;
        put(&self.run, &checksum::line(&run))?;
        put(self.output, &text)?;
        self.remove_partial()
    }

    fn remove_partial(&self) -> Outcome<()> {
        if self.partial.exists() {
            fs::remove_file(&self.partial).map_err(FleetError::file(&self.partial))?;
        }
        Ok(())
    }
}

fn hash(text: &[u8]) -> String {
    format!("{:016x}", XxHash3_64::oneshot(text))
}

fn json(path: &Path, value: &impl Serialize) -> Outcome<String> {
    serde_json::to_string(value).map_err(|error| FleetError::format(path, error))
}

/// Reads a line with a checksum; `None` if it is damaged.
fn load<T: DeserializeOwned>(path: &Path) -> Outcome<Option<T>> {
    let line = fs::read(path).map_err(FleetError::file(path))?;
    Ok(checksum::text(&line).and_then(|text| serde_json::from_slice(text).ok()))
}

/// Writes a value as JSON.
#[cfg(feature = "sql")]
pub(crate) fn save(path: &Path, value: &impl Serialize) -> Outcome<()> {
    put(path, &json(path, value)?)
}

/// Writes a file by way of a temporary name.
fn put(path: &Path, text: &str) -> Outcome<()> {
    let written = beside(path, ".new");
    let wrong = FleetError::file(&written);
    fs::write(&written, text).map_err(&wrong)?;
    // Synced before the rename, or a crash might leave the name with no contents.
    fs::File::open(&written).and_then(|file| file.sync_all()).map_err(&wrong)?;
    fs::rename(&written, path).map_err(FleetError::file(path))
}
