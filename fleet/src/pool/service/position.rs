//! The place in the input up to which a snapshot has the vehicles.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{FleetError, Outcome};
use crate::pool::VehicleId;
use crate::pool::block::Source;
use crate::pool::file::Header;
use crate::pool::latest::Latest;

/// Place in the input up to which a snapshot has the vehicles, and in the output up to which there
/// are answers to it.
///
/// Counts are those of all runs that went on from one another, as if there had been one.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Position {
    /// Number of lines of the input.
    pub lines: u64,
    /// Number of bytes of these lines.
    pub bytes: u64,
    /// The last `offset` that a line had; those of connections are the clients'.
    pub offset: Option<VehicleId>,
    /// The last offset of each client with a name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub clients: BTreeMap<String, VehicleId>,
    /// Number of bytes of the answers.
    pub answers: u64,
    /// The latest time.
    pub latest: Option<i64>,
    /// More of it, of the updates that have been taken, and of the lines if these wait for others.
    #[serde(default)]
    pub(super) of_updates: Option<Latest>,
    #[serde(default)]
    pub(super) of_lines: Option<Latest>,
    /// Name of the model, if a line has exchanged it.
    pub model: Option<String>,
    /// Lines that wait for others that are late: their number, and the text.
    pub waiting: Vec<(u64, String)>,
}

/// Reads the position from a snapshot. One that a program has written without lines has none.
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
    position
        .map(Some)
        .map_err(|error| FleetError::format(snapshot, format!("the position is not one: {error}")))
}

impl Position {
    pub(super) fn note(&self) -> Vec<u8> {
        // Neither memory nor such fields refuse anything.
        serde_json::to_vec(self).unwrap_or_default()
    }
}

/// Opens an input, at a byte.
pub(super) fn open_input(path: &Path, bytes: u64) -> Outcome<File> {
    let wrong = FleetError::file(path);
    let mut file = File::open(path).map_err(&wrong)?;
    if bytes > 0 {
        let length = file.metadata().map_err(&wrong)?.len();
        if length < bytes {
            let message = format!(
                "has {length} bytes, but the snapshot is of the first {bytes}: it is another input"
            );
            return Err(FleetError::format(path, message));
        }
        file.seek(SeekFrom::Start(bytes)).map_err(&wrong)?;
    }
    Ok(file)
}

/// Skips the first bytes of an input that comes again.
pub(super) fn skip(input: &mut impl Read, bytes: u64) -> Outcome<()> {
    let path = Path::new("standard input");
    let skipped = io::copy(&mut input.take(bytes), &mut io::sink());
    let skipped = skipped.map_err(FleetError::file(path))?;
    if skipped < bytes {
        let message = format!(
            "has {skipped} bytes, but the snapshot is of the first {bytes}: it is another input"
        );
        return Err(FleetError::format(path, message));
    }
    Ok(())
}

/// Opens an output, and cuts off what follows the answers of the snapshot. The file is locked as long
/// as it is open.
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
            "exists, and there is no snapshot that says how much of it counts; remove it first",
        ));
    }
    if length < answers {
        let message =
            format!("has {length} bytes, but the snapshot is of {answers} bytes of answers");
        return Err(FleetError::format(path, message));
    }
    file.set_len(answers).map_err(&wrong)?;
    file.seek(SeekFrom::Start(answers)).map_err(&wrong)?;
    Ok(file)
}
