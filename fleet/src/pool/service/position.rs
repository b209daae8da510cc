//! The place in the input up to which a snapshot includes the lines.
//!
//! It is stored in the note of the snapshot, so vehicles and position are always of the same
//! moment.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_64;

use crate::error::{FleetError, Outcome};
use crate::pool::VehicleId;
use crate::pool::block::Source;
use crate::pool::file::Header;
use crate::pool::latest::Latest;

/// Place in the input up to which a snapshot includes the lines, and place in the output up to
/// which these are answered.
///
/// Counts include all earlier runs that this one continues, as if they had been one.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Position {
    /// Number of lines.
    pub lines: u64,
    /// Number of bytes of these lines.
    pub bytes: u64,
    /// The last of these bytes, by which to recognise the input. Not used for connections.
    #[serde(default)]
    pub(super) tail: Tail,
    /// True if the last line was taken without its line end.
    #[serde(default)]
    pub(super) is_open: bool,
    /// The last `offset` of a line; those of connections are in `clients`.
    pub offset: Option<VehicleId>,
    /// The last offset of each named client.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub clients: BTreeMap<String, VehicleId>,
    /// Number of bytes of the answers.
    pub answers: u64,
    /// The latest time.
    pub latest: Option<i64>,
    /// Full state of the latest time: that of applied updates, and that of lines if these wait for
    /// others.
    #[serde(default)]
    pub(super) of_updates: Option<Latest>,
    #[serde(default)]
    pub(super) of_lines: Option<Latest>,
    /// Name of the model, if a line has replaced the original one.
    pub model: Option<String>,
    /// Lines waiting for late ones: number and text.
    pub waiting: Vec<(u64, String)>,
}

/// Reads the position from a snapshot. A snapshot that a program took of its own pool has none.
///
/// # Errors
///
/// [`FleetError`] if the file cannot be read, or is not a snapshot.
pub fn position(snapshot: &Path) -> Outcome<Option<Position>> {
    let header = Header::read(&mut Source::open(snapshot)?)?;
    if header.note.is_empty() {
        return Ok(None);
    }
    let position = serde_json::from_slice(&header.note);
    position.map(Some).map_err(|error| {
        FleetError::format(snapshot, format!("the position cannot be read: {error}"))
    })
}

impl Position {
    pub(super) fn note(&self) -> Vec<u8> {
        // Writing to memory does not fail, nor does serialising these fields.
        serde_json::to_vec(self).unwrap_or_default()
    }
}

/// Number of bytes at the end of the lines by which to recognise an input.
pub(super) const TAIL: usize = 1 << 12;

/// Length and hash (XXH3) of the last bytes of the lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(super) struct Tail {
    length: usize,
    hash: u64,
}

impl Tail {
    pub(super) fn of(bytes: &[u8]) -> Self {
        let last = &bytes[bytes.len().saturating_sub(TAIL)..];
        Self { length: last.len(), hash: XxHash3_64::oneshot(last) }
    }
}

impl Position {
    /// Opens an input at the position.
    pub(super) fn open_input(&self, path: &Path) -> Outcome<File> {
        let wrong = FleetError::file(path);
        let mut file = File::open(path).map_err(&wrong)?;
        let length = file.metadata().map_err(&wrong)?.len();
        // A pipe has no length; it can only be read by a first run, whose position is 0.
        if self.bytes > 0 && length >= self.bytes {
            let begin = self.bytes - self.tail.length as u64;
            file.seek(SeekFrom::Start(begin)).map_err(&wrong)?;
            self.check(&mut file, path)?;
        } else if self.bytes > 0 {
            return Err(self.other(path, length));
        }
        Ok(file)
    }

    /// Skips the bytes before the position, in an input that starts over.
    pub(super) fn skip(&self, input: &mut impl Read, path: &Path) -> Outcome<()> {
        let before = self.bytes - self.tail.length as u64;
        let skipped = io::copy(&mut input.take(before), &mut io::sink());
        let skipped = skipped.map_err(FleetError::file(path))?;
        if skipped < before {
            return Err(self.other(path, skipped));
        }
        self.check(input, path)
    }

    /// Reads the last bytes before the position, and compares them.
    fn check(&self, input: &mut impl Read, path: &Path) -> Outcome<()> {
        let mut bytes = Vec::new();
        let length = self.tail.length as u64;
        input.take(length).read_to_end(&mut bytes).map_err(FleetError::file(path))?;
        if (bytes.len() as u64) < length {
            return Err(self.other(path, self.bytes - length + bytes.len() as u64));
        }
        if length > 0 && Tail::of(&bytes) != self.tail {
            let message = format!(
                "the bytes before {} differ from those that the snapshot knows: it is another input",
                self.bytes
            );
            return Err(FleetError::format(path, message));
        }
        Ok(())
    }

    fn other(&self, path: &Path, length: u64) -> FleetError {
        let message = format!(
            "has {length} bytes, but the snapshot includes the first {}: it is another input",
            self.bytes
        );
        FleetError::format(path, message)
    }

    /// Returns the input after the position. If the last line lacked its end, that may have arrived
    /// since.
    pub(super) fn rest<R: Read>(&mut self, mut input: R) -> io::Result<impl Read + use<R>> {
        let mut first = Vec::new();
        if self.is_open {
            input.by_ref().take(1).read_to_end(&mut first)?;
            self.is_open = first.is_empty();
            // The last line was taken without this line end. So it is not an empty line of its own,
            // and the tail no longer ends what was read.
            if first == b"\n" {
                first.clear();
                self.bytes += 1;
                self.tail = Tail::default();
            }
        }
        Ok(Cursor::new(first).chain(input))
    }
}

/// Opens an output, and cuts off whatever follows the answers counted by the snapshot: they will be
/// given again. The file stays locked while it is open.
pub(super) fn open_output(path: &Path, answers: u64, is_first: bool) -> Outcome<File> {
    let wrong = FleetError::file(path);
    let mut options = OpenOptions::new();
    let mut file =
        options.write(true).create(is_first).truncate(false).open(path).map_err(&wrong)?;
    file.try_lock().map_err(|_| {
        FleetError::format(path, "another run writes to it, or it cannot be locked")
    })?;
    let length = file.metadata().map_err(&wrong)?.len();
    if is_first && length > 0 {
        return Err(FleetError::format(
            path,
            "exists, but no snapshot tells how much of it counts; remove it first",
        ));
    }
    if length < answers {
        let message =
            format!("has {length} bytes, but the snapshot counts {answers} bytes of answers");
        return Err(FleetError::format(path, message));
    }
    file.set_len(answers).map_err(&wrong)?;
    file.seek(SeekFrom::Start(answers)).map_err(&wrong)?;
    Ok(file)
}
