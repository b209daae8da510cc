//! An output under construction, which a later run can continue.
//!
//! Parts are row groups of one file under a temporary name: one each, or several for a query. As
//! soon as a part is written, a line in the [journal](crate::journal) records where it ends, with
//! its metadata, which Parquet itself only stores at the end of a file. A run that continues checks
//! the parts by their hashes, cuts off what follows them, and replays their metadata to the writer
//! without rewriting them. Once the footer is written, the file gets its name.

mod open;

use std::fs::{self, File};
use std::hash::Hasher;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use parquet::arrow::arrow_writer::{ArrowColumnWriter, ArrowRowGroupWriterFactory, compute_leaves};
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::writer::SerializedFileWriter;
use serde_json::Value;
use twox_hash::XxHash3_64;

use crate::error::{FleetError, Outcome};
use crate::finished::Finished;
use crate::input::Invalid;
use crate::input::pieces::{Digest, Piece, Pieces};
use crate::journal::{Journal, Part};
use crate::left_out::LeftOut;
use crate::row_groups::{append, footer, hex};
use crate::spool::{Disk, Spool};
pub(crate) use open::{Opened, Plan};

/// How to treat an output that exists already, finished or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Start {
    /// Replaces an existing output.
    pub force: bool,
    /// Discards what an unfinished run has done.
    pub restart: bool,
}

/// An output under construction.
pub(crate) struct Partial {
    output: PathBuf,
    path: PathBuf,
    journal: Journal,
    schema: Arc<Schema>,
    writer: SerializedFileWriter<Spool>,
    factory: ArrowRowGroupWriterFactory,
    /// Encoded columns of the part under construction, and its weight.
    part: Option<(Vec<ArrowColumnWriter>, usize)>,
    counts: [u64; 4],
    disk: Disk,
    left_out: Option<LeftOut>,
    /// Pieces of the input read so far.
    pieces: Pieces,
    /// File and number of the last piece noted, and the digest of all up to it.
    noted: (Option<(usize, u64)>, Digest),
    settings: Value,
}

impl Partial {
    /// Complete parts.
    pub(crate) fn made(&self) -> &[Part] {
        &self.journal.parts
    }

    /// Number of complete parts.
    pub(crate) fn parts(&self) -> usize {
        self.journal.parts.len()
    }

    /// Input file and row up to which complete parts reach.
    pub(crate) fn position(&self) -> (usize, u64) {
        self.journal.parts.last().map_or((0, 0), |part| (part.file, part.end_row))
    }

    /// Drives, steps, failed drives and left-out drives, of all rows so far.
    pub(crate) fn counts(&self) -> [u64; 4] {
        self.counts
    }

    /// Weight of the part under construction.
    pub(crate) fn weight(&self) -> usize {
        self.part.as_ref().map_or(0, |part| part.1)
    }

    /// Adds rows to the part under construction.
    pub(crate) fn write(
        &mut self,
        batch: &RecordBatch,
        weight: usize,
        counts: [u64; 4],
    ) -> Outcome<()> {
        let wrong = FleetError::parquet(&self.path);
        let index = self.journal.parts.len();
        let (columns, sum) = match &mut self.part {
            Some(part) => part,
            empty => {
                let columns = self.factory.create_column_writers(index).map_err(&wrong)?;
                empty.insert((columns, 0))
            }
        };
        *sum += weight;
        // A nested field has several leaves, in the order of the column writers.
        let mut columns = columns.iter_mut();
        for (field, array) in self.schema.fields().iter().zip(batch.columns()) {
            for leaf in compute_leaves(field, array).map_err(&wrong)? {
                if let Some(column) = columns.next() {
                    column.write(&leaf).map_err(&wrong)?;
                }
            }
        }
        self.counts.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        Ok(())
    }

    /// Records left-out drives.
    pub(crate) fn leave_out(&mut self, file: &str, invalid: &[Invalid]) -> Outcome<()> {
        self.counts[3] += invalid.len() as u64;
        self.left_out.as_mut().map_or(Ok(()), |left_out| left_out.write(file, invalid))
    }

    /// Completes the part, whose input ends before row `end_row` of a file. `names` is the hash of
    /// the names of all files up to that one.
    pub(crate) fn end_part(&mut self, file: usize, end_row: u64, names: u64) -> Outcome<()> {
        let Some((columns, _)) = self.part.take() else { return Ok(()) };
        let group = append(&mut self.writer, columns).map_err(FleetError::parquet(&self.path))?;
        self.note_part(vec![group], file, end_row, names)
    }

    /// Adds a part from a Parquet file with the same columns: `rows` rows of results, made from
    /// input rows before `end_row`.
    #[cfg(feature = "sql")]
    pub(crate) fn add_part(&mut self, made: &File, rows: u64, end_row: u64) -> Outcome<()> {
        let groups = crate::row_groups::copy(&mut self.writer, made);
        let groups = groups.map_err(FleetError::parquet(&self.path))?;
        self.counts[0] += rows;
        self.note_part(groups, 0, end_row, 0)
    }

    /// Records written row groups in the journal.
    fn note_part(
        &mut self,
        groups: Vec<RowGroupMetaData>,
        file: usize,
        end_row: u64,
        names: u64,
    ) -> Outcome<()> {
        let wrong = FleetError::parquet(&self.path);
        // Order matters: bytes to the file, then lines of left-out drives, then the journal line
        // that vouches for both.
        self.writer.flush().map_err(FleetError::file(&self.path))?;
        let end = self.writer.bytes_written() as u64;
        let hash = std::mem::take(&mut self.writer.inner_mut().hash).finish();
        let metadata = hex(&footer(&self.writer, groups).map_err(&wrong)?);
        let lines = match &mut self.left_out {
            Some(left_out) => left_out.end_part()?,
            None => (0, XxHash3_64::default().finish()),
        };
        // A piece (row group or block) may span several parts, and is listed with the first.
        let mut pieces = self.pieces.take(file, end_row);
        pieces.retain(|piece| note(&mut self.noted, piece));
        let counts = self.counts;
        // Syncing happens in the background: should the system crash first, the hash in the journal
        // no longer matches, and the part is made again.
        self.disk.push();
        self.journal.add(Part { file, end_row, names, pieces, lines, end, hash, counts, metadata })
    }

    /// Writes the footer, and renames the file. `names` is the hash of the names of all files.
    pub(crate) fn finish(self, names: u64) -> Outcome<[u64; 4]> {
        let Self { output, path: partial, journal, mut writer, counts, disk, .. } = self;
        let (mut left_out, pieces, mut noted) = (self.left_out, self.pieces, self.noted);
        // Pieces read after the last row that made a part, such as those with left-out drives only.
        for piece in pieces.take(usize::MAX, u64::MAX) {
            note(&mut noted, &piece);
        }
        let about = Finished { settings: self.settings, content: noted.1.text(), names, counts };
        writer.append_key_value_metadata(about.metadata());
        writer.finish().map_err(FleetError::parquet(&partial))?;
        writer.flush().map_err(FleetError::file(&partial))?;
        disk.end();
        writer.inner().file.sync_all().map_err(FleetError::file(&partial))?;
        left_out.as_mut().map_or(Ok(()), LeftOut::sync)?;
        fs::rename(&partial, &output).map_err(FleetError::file(&output))?;
        // If the run is killed here, the next one finds both the output and the journal, and does
        // the rest.
        left_out.map_or(Ok(()), LeftOut::finish)?;
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
        // Makes the rename durable. Not all systems allow it, and the file is complete in any case.
        _ = File::open(folder.unwrap_or(Path::new("."))).and_then(|folder| folder.sync_all());
        journal.remove()?;
        Ok(counts)
    }

    /// Removes what has been written.
    pub(crate) fn discard(self) -> Outcome<()> {
        fs::remove_file(&self.path).map_err(FleetError::file(&self.path))?;
        self.left_out.map_or(Ok(()), LeftOut::discard)?;
        self.journal.remove()
    }
}

/// Adds a piece to the digest and returns true, unless it was noted already.
fn note(noted: &mut (Option<(usize, u64)>, Digest), piece: &Piece) -> bool {
    // Pieces come in order, except that a run that resumes within a piece reads that piece again.
    let place = Some((piece.file, piece.number));
    let is_new = place > noted.0;
    if is_new {
        noted.0 = place;
        noted.1.add(piece);
    }
    is_new
}
