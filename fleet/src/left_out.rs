//! The file of left-out drives: one line of JSON for each.
//!
//! Like the output it ends in `.partial` until it is complete, and the journal records how many of
//! its bytes belong to complete parts.

use std::fs::{self, File};
use std::hash::Hasher;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use twox_hash::XxHash3_64;

use crate::error::{FleetError, Outcome};
use crate::input::Invalid;
use crate::journal::{Part, intact, open_locked};
use crate::overwrite::beside;

/// A file of left-out drives under construction.
pub(crate) struct LeftOut {
    path: PathBuf,
    file: BufWriter<File>,
    end: u64,
    hash: XxHash3_64,
}

/// A line of the file.
#[derive(Serialize)]
struct Line<'a> {
    file: &'a str,
    #[serde(flatten)]
    invalid: &'a Invalid,
}

impl LeftOut {
    /// Opens the file, and returns the number of leading parts whose lines it has in full.
    ///
    /// # Errors
    ///
    /// [`FleetError::Settings`] if parts have lines that are not in this file.
    pub(crate) fn open(path: Option<&Path>, parts: &[Part]) -> Outcome<Option<(Self, usize)>> {
        let lines = parts.last().is_some_and(|part| part.lines.0 > 0);
        let Some(path) = path else {
            if lines {
                let message = "the unfinished run left drives out; give its --skip-invalid again, or \
                               start over with --restart";
                return Err(FleetError::Settings(message.to_owned()));
            }
            return Ok(None);
        };
        let partial = beside(path, ".partial");
        if lines && !partial.exists() {
            let message = format!(
                "the unfinished run left drives out, but {} is missing; give the file of that run, or \
                 start over with --restart",
                partial.display()
            );
            return Err(FleetError::Settings(message));
        }
        let mut file = open_locked(&partial)?;
        // `intact` reads to the end of the last matching part; `cut` then truncates the file, so
        // the position it leaves does not matter.
        let ends = parts.iter().map(|part| part.lines);
        let valid = intact(&mut file, ends).map_err(FleetError::file(&partial))?;
        let (path, file, hash) = (path.to_owned(), BufWriter::new(file), XxHash3_64::default());
        Ok(Some((Self { path, file, end: 0, hash }, valid)))
    }

    /// Cuts off what lies beyond the given parts.
    pub(crate) fn cut(mut self, parts: &[Part]) -> Outcome<Self> {
        self.end = parts.last().map_or(0, |part| part.lines.0);
        let file = self.file.get_mut();
        file.set_len(self.end)
            .and_then(|()| file.seek(SeekFrom::Start(self.end)).map(|_| ()))
            .map_err(FleetError::file(&self.path))?;
        Ok(self)
    }

    /// Writes lines.
    pub(crate) fn write(&mut self, file: &str, invalid: &[Invalid]) -> Outcome<()> {
        for invalid in invalid {
            let mut line = serde_json::to_vec(&Line { file, invalid })
                .map_err(|error| FleetError::format(&self.path, error))?;
            line.push(b'\n');
            self.file.write_all(&line).map_err(FleetError::file(&self.path))?;
            self.hash.write(&line);
            self.end += line.len() as u64;
        }
        Ok(())
    }

    /// Ends a part, and returns the end of its lines and their hash.
    pub(crate) fn end_part(&mut self) -> Outcome<(u64, u64)> {
        // Flushed before the journal line that counts these bytes.
        self.file.flush().map_err(FleetError::file(&self.path))?;
        Ok((self.end, std::mem::take(&mut self.hash).finish()))
    }

    /// Syncs the lines to disk.
    pub(crate) fn sync(&mut self) -> Outcome<()> {
        let done = self.file.flush().and_then(|()| self.file.get_ref().sync_all());
        done.map_err(FleetError::file(&self.path))
    }

    /// Renames the finished file.
    pub(crate) fn finish(self) -> Outcome<()> {
        Self::rename(&self.path)
    }

    /// Renames the finished file, unless that is done already.
    pub(crate) fn rename(path: &Path) -> Outcome<()> {
        let partial = beside(path, ".partial");
        if partial.exists() {
            fs::rename(&partial, path).map_err(FleetError::file(path))?;
        }
        Ok(())
    }

    /// Removes what has been written.
    pub(crate) fn discard(self) -> Outcome<()> {
        let partial = beside(&self.path, ".partial");
        fs::remove_file(&partial).map_err(FleetError::file(&partial))
    }
}
