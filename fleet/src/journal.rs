//! The journal beside an unfinished output: the list of its complete parts.
//!
//! A text file. The first line holds the settings of the run as JSON, every other line one complete
//! part; each line begins with its [checksum]. A last line that is cut off or damaged counts as not
//! written, and its part is made again. A damaged line before it is an error, since nothing
//! tells how many parts it stood for.
//!
//! Lines are only appended, and a line is written after the bytes it describes, so after a crash
//! the journal may lag behind the output but never runs ahead of what was written to the file;
//! hashes tell if the disk lost bytes that the journal has.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::hash::Hasher;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use twox_hash::XxHash3_64;

use crate::checksum;
use crate::error::{FleetError, Outcome};
use crate::input::pieces::Piece;
use crate::overwrite::beside;

/// A complete part: one row group of the output, or any number for a query.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Part {
    /// Input file that the last row of the part comes from.
    pub(crate) file: usize,
    /// Row of that file after the last one in the part.
    pub(crate) end_row: u64,
    /// Hash of the names of all files up to that one.
    pub(crate) names: u64,
    /// Pieces of the input that the part was made from and earlier parts were not.
    pub(crate) pieces: Vec<Piece>,
    /// End of the lines on left-out drives, and the hash of those since the previous part.
    pub(crate) lines: (u64, u64),
    /// Byte of the output after the end of the part.
    pub(crate) end: u64,
    /// Hash (XXH3) of the bytes since the previous part.
    pub(crate) hash: u64,
    /// Drives, steps, failed drives and left-out drives, in this part and all before.
    pub(crate) counts: [u64; 4],
    /// Metadata of the row groups as a Parquet footer, in hexadecimal.
    pub(crate) metadata: String,
}

/// An open journal, locked as long as it is open.
#[derive(Debug)]
pub(crate) struct Journal {
    file: File,
    path: PathBuf,
    /// Complete parts.
    pub(crate) parts: Vec<Part>,
    /// True if the settings have been written.
    pub(crate) begun: bool,
}

impl Journal {
    /// Opens the journal of an output, or creates an empty one. Settings that differ from those in
    /// the journal are an error, unless `restart` discards its contents.
    pub(crate) fn open(path: &Path, settings: &Value, restart: bool) -> Outcome<Self> {
        let wrong = FleetError::file(path);
        let mut file = open_locked(path)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(&wrong)?;
        let path = path.to_owned();
        let mut journal = Self { file, path, parts: Vec::new(), begun: false };
        // Length of the prefix of whole, intact lines.
        let mut valid = 0;
        if !restart {
            for (number, line) in (1..).zip(bytes.split_inclusive(|&byte| byte == b'\n')) {
                let end = valid + line.len();
                let Some(text) = checksum::text(line) else {
                    // If this is the last line, the run was killed while writing it.
                    if end == bytes.len() {
                        break;
                    }
                    return Err(journal.damaged(number));
                };
                if journal.begun {
                    let part = serde_json::from_slice(text);
                    journal.parts.push(part.map_err(|_| journal.damaged(number))?);
                } else {
                    let written: Value =
                        serde_json::from_slice(text).map_err(|_| journal.damaged(number))?;
                    compare(&journal.path, settings, &written)?;
                    journal.begun = true;
                }
                valid = end;
            }
        }
        // Later lines are appended right after the last intact one.
        journal.cut(valid as u64)?;
        Ok(journal)
    }

    fn damaged(&self, line: usize) -> FleetError {
        let message = format!(
            "line {line} is damaged, or from another version of this program; start over with --restart"
        );
        FleetError::format(&self.path, message)
    }

    /// Drops all but the first `parts` parts, and rewrites their lines.
    pub(crate) fn keep(&mut self, parts: usize, settings: &Value) -> Outcome<()> {
        if parts < self.parts.len() {
            let kept = self.parts.drain(..parts).collect::<Vec<_>>();
            self.parts.clear();
            self.cut(0)?;
            self.begin(settings)?;
            kept.into_iter().try_for_each(|part| self.add(part))?;
        }
        Ok(())
    }

    /// Writes the settings, as the first line.
    pub(crate) fn begin(&mut self, settings: &Value) -> Outcome<()> {
        self.begun = true;
        self.line(&settings.to_string())
    }

    /// Adds a part.
    pub(crate) fn add(&mut self, part: Part) -> Outcome<()> {
        let text =
            serde_json::to_string(&part).map_err(|error| FleetError::format(&self.path, error))?;
        // The caller has flushed the bytes of the part to the file.
        self.parts.push(part);
        self.line(&text)
    }

    /// Removes the file.
    pub(crate) fn remove(self) -> Outcome<()> {
        fs::remove_file(&self.path).map_err(FleetError::file(&self.path))
    }

    fn line(&mut self, text: &str) -> Outcome<()> {
        let line = checksum::line(text);
        self.file.write_all(line.as_bytes()).map_err(FleetError::file(&self.path))
    }

    fn cut(&mut self, length: u64) -> Outcome<()> {
        let wrong = FleetError::file(&self.path);
        self.file.set_len(length).map_err(&wrong)?;
        self.file.seek(SeekFrom::Start(length)).map_err(&wrong)?;
        Ok(())
    }
}

/// Number of leading parts whose bytes are as they were written; `parts` gives their ends and
/// hashes.
pub(crate) fn intact(
    file: &mut File,
    parts: impl Iterator<Item = (u64, u64)>,
) -> io::Result<usize> {
    file.seek(SeekFrom::Start(0))?;
    let (mut start, mut number, mut buffer) = (0, 0, vec![0; 1 << 20]);
    for (end, written) in parts {
        let mut hash = XxHash3_64::default();
        // A damaged end below `start` makes an empty part, whose hash will not match.
        let mut left: u64 = end.saturating_sub(start);
        while left > 0 {
            let most = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
            let read = file.read(&mut buffer[..most])?;
            // The file ends within this part, so none after it can be intact.
            if read == 0 {
                return Ok(number);
            }
            hash.write(&buffer[..read]);
            left -= read as u64;
        }
        if hash.finish() != written {
            return Ok(number);
        }
        (start, number) = (end, number + 1);
    }
    Ok(number)
}

/// Opens or creates a file that only one run at a time may write to. The lock is held as long as
/// the file stays open.
pub(crate) fn open_locked(path: &Path) -> Outcome<File> {
    let wrong = FleetError::file(path);
    loop {
        // Not truncated: until the lock is held, the file may belong to another run.
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let file = options.open(path).map_err(&wrong)?;
        file.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => {
                let path = path.display();
                FleetError::Settings(format!("another run holds the lock on {path}"))
            }
            TryLockError::Error(error) => wrong(error),
        })?;
        // Between opening and locking, the previous owner may have removed or renamed the file; the
        // lock would then be on a file that nobody else can find. Try again until it has the name.
        if is_at(&file, path).map_err(&wrong)? {
            return Ok(file);
        }
    }
}

/// A lock file beside an output or snapshot, held by one run at a time.
#[derive(Debug)]
pub(crate) struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    pub(crate) fn new(output: &Path) -> Outcome<Self> {
        let path = beside(output, ".lock");
        Ok(Self { _file: open_locked(&path)?, path })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // A leftover file does no harm: the lock is what counts, not the file.
        _ = fs::remove_file(&self.path);
    }
}

/// Returns true if the path still leads to the file.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let place = |found: fs::Metadata| (found.dev(), found.ino());
    match fs::metadata(path) {
        Ok(found) => Ok(place(found) == place(file.metadata()?)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Elsewhere a rename between opening and locking goes unnoticed.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> io::Result<bool> {
    Ok(true)
}

/// Returns an error that names the settings that differ.
fn compare(path: &Path, settings: &Value, written: &Value) -> Outcome<()> {
    if settings == written {
        return Ok(());
    }
    let empty = serde_json::Map::new();
    let (now, before) = (settings.as_object().unwrap_or(&empty), written.as_object());
    let before = before.unwrap_or(&empty);
    // Only keys of this version are compared. The version itself is one of them, and differs if the
    // keys do.
    let other = now.iter().filter(|(name, value)| before.get(*name) != Some(*value));
    let other: Vec<String> = other
        .map(|(name, value)| {
            let before = before.get(name).unwrap_or(&Value::Null);
            format!("{name} is {value}, was {before}")
        })
        .collect();
    Err(FleetError::Settings(format!(
        "{} is from an unfinished run with different settings ({}); repeat that run, or start \
         over with --restart",
        path.display(),
        other.join("; ")
    )))
}
