//! Opening an output: from nothing, or after its complete parts.
//!
//! A kill may hit between any two steps of the run before, so each state of (output, `.partial`,
//! `.journal`) is told apart here by what exists, in the order that a run creates and removes
//! them.

use std::fs::OpenOptions;
use std::io::{Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use arrow_schema::Schema;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_writer::ArrowWriterOptions;
use parquet::file::properties::WriterProperties;
use serde_json::Value;
use twox_hash::XxHash3_64;

use super::{Partial, Start, note};
use crate::error::{FleetError, Outcome};
use crate::finished::Finished;
use crate::input::pieces::{Digest, Pieces};
use crate::journal::{Journal, intact};
use crate::left_out::LeftOut;
use crate::overwrite::beside;
use crate::row_groups::replay;
use crate::spool::{Disk, Spool};

/// Description of an output under construction.
pub(crate) struct Plan<'a> {
    pub(crate) output: &'a Path,
    /// File for left-out drives.
    pub(crate) left_out: Option<&'a Path>,
    /// Settings that two runs must share for one to continue the other.
    pub(crate) settings: &'a Value,
    pub(crate) schema: &'a Arc<Schema>,
    pub(crate) properties: WriterProperties,
    pub(crate) start: Start,
    pub(crate) pieces: Pieces,
}

/// An output that is already finished, or ready to be written to.
pub(crate) enum Opened {
    /// Complete but for the removal of the journal.
    Finished([u64; 4]),
    Partial(Box<Partial>),
}

impl Partial {
    /// Begins an output, or continues one of the same settings.
    pub(crate) fn open(plan: Plan<'_>) -> Outcome<Opened> {
        let Plan { output, settings, schema, properties, start, pieces, .. } = plan;
        let exists = |path: &Path| {
            let message = format!("{} exists; replace it with --force", path.display());
            Err(FleetError::Settings(message))
        };
        let partial = beside(output, ".partial");
        let path = beside(output, ".journal");
        // Checked before the journal is created, so that a refused run leaves no trace.
        if output.exists() && !path.exists() && !start.force {
            return exists(output);
        }
        let mut journal = Journal::open(&path, settings, start.restart)?;
        // Checked under the lock, since another run may have ended meanwhile. The settings are
        // written after the `.partial` file is created, and that file is renamed to the output at
        // the end: with settings in the journal and no `.partial`, the output is of this very run,
        // killed between renaming and removing the journal.
        if output.exists() && journal.begun && !partial.exists() {
            let counts = Finished::read(output)?.map_or([0; 4], |finished| finished.counts);
            plan.left_out.map_or(Ok(()), LeftOut::rename)?;
            journal.remove()?;
            return Ok(Opened::Finished(counts));
        }
        // An empty journal was created just now, by this call: remove it again.
        for path in [Some(output), plan.left_out].into_iter().flatten() {
            if path.exists() && !start.force {
                if !journal.begun {
                    journal.remove()?;
                }
                return exists(path);
            }
        }
        let left_out = match LeftOut::open(plan.left_out, &journal.parts) {
            Err(error) if !journal.begun => {
                journal.remove()?;
                return Err(error);
            }
            opened => opened?,
        };
        let at = partial.clone();
        let (wrong, failed) = (FleetError::file(&at), FleetError::parquet(&at));
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&partial)
            .map_err(&wrong)?;
        // The journal cannot be ahead of the file after a kill, but it can after a crash of the
        // system, which may lose unsynced bytes.
        let ends = journal.parts.iter().map(|part| (part.end, part.hash));
        let mut valid = intact(&mut file, ends).map_err(&wrong)?;
        let left_out = match left_out {
            Some((left_out, lines)) => {
                // A part counts only if both files have it.
                valid = valid.min(lines);
                Some(left_out)
            }
            None => None,
        };
        journal.keep(valid, settings)?;
        let (end, counts) =
            journal.parts.last().map_or((0, [0; 4]), |part| (part.end, part.counts));
        let left_out = left_out.map(|left_out| left_out.cut(&journal.parts)).transpose()?;
        // Whatever follows the last intact part was never in the journal.
        file.set_len(end).map_err(&wrong)?;
        file.seek(SeekFrom::Start(end)).map_err(&wrong)?;
        if !journal.begun {
            journal.begin(settings)?;
        }
        let disk = Disk::new(&file).map_err(&wrong)?;
        // The writer starts at byte 0 and emits the magic number and the replayed groups again; the
        // spool swallows exactly the `end` bytes that the file has.
        let spool = Spool { file, skip: end, hash: XxHash3_64::default() };
        let options = ArrowWriterOptions::new().with_properties(properties);
        let (mut writer, factory) =
            ArrowWriter::try_new_with_options(spool, schema.clone(), options)
                .and_then(ArrowWriter::into_serialized_writer)
                .map_err(&failed)?;
        for part in &journal.parts {
            replay(&mut writer, part).map_err(&failed)?;
        }
        writer.flush().map_err(&wrong)?;
        // All `end` bytes must have been replayed, or new groups would land at wrong offsets.
        if writer.inner().skip > 0 {
            let message = "its parts do not add up to the length in the journal";
            return Err(FleetError::format(&partial, message));
        }
        let (output, schema, settings) = (output.to_owned(), schema.clone(), settings.clone());
        // The digest of the whole input goes into the finished file, so parts of earlier runs
        // count.
        let mut noted = (None, Digest::default());
        journal.parts.iter().flat_map(|part| &part.pieces).for_each(|piece| {
            note(&mut noted, piece);
        });
        Ok(Opened::Partial(Box::new(Self {
            output,
            path: partial,
            journal,
            schema,
            writer,
            factory,
            part: None,
            counts,
            disk,
            left_out,
            pieces,
            noted,
            settings,
        })))
    }
}
