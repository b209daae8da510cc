//! An output under construction, which a later run can continue.
//!
//! Parts are row groups of one file with a temporary name. As soon as a part is written, a line
//! in the [journal](crate::journal) says where it ends, and has its metadata, which Parquet keeps
//! in the last bytes of a file. A run that continues checks the parts by their hashes, cuts off
//! what follows them, and tells the writer their metadata, without writing them again. When the
//! footer is written, the file gets its name.

use std::fs::{self, File, OpenOptions};
use std::hash::Hasher;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow::array::RecordBatch;
use arrow::datatypes::Schema;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_writer::{
    ArrowColumnWriter, ArrowRowGroupWriterFactory, ArrowWriterOptions, compute_leaves,
};
use parquet::column::writer::ColumnCloseResult;
use parquet::errors::ParquetError;
use parquet::file::metadata::{
    ColumnChunkMetaData, FileMetaData, ParquetMetaDataBuilder, ParquetMetaDataOptions,
    ParquetMetaDataReader, ParquetMetaDataWriter, RowGroupMetaData,
};
use parquet::file::properties::WriterProperties;
use parquet::file::statistics::Statistics;
use parquet::file::writer::SerializedFileWriter;
use serde_json::Value;
use twox_hash::XxHash3_64;

use crate::error::{FleetError, Outcome};
use crate::journal::{Journal, Part};
use crate::spool::{Disk, Nothing, Spool};

/// Bytes of the end of a footer: the length of the metadata, and a mark.
const FOOTER_TAIL: usize = 8;

/// Way to begin an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Start {
    /// Replaces an output that exists.
    pub force: bool,
    /// Forgets what an unfinished run has done.
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
    /// Columns of the part under construction, and its weight.
    part: Option<(Vec<ArrowColumnWriter>, usize)>,
    counts: [u64; 3],
    disk: Disk,
}

/// Output that is finished already, or can be continued.
pub(crate) enum Opened {
    /// It was complete but for the removal of the journal.
    Finished([u64; 3]),
    Partial(Box<Partial>),
}

/// Name of a file beside the output.
pub(crate) fn beside(output: &Path, ending: &str) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

impl Partial {
    /// Begins an output, or continues one with the same settings.
    pub(crate) fn open(
        output: &Path,
        settings: &Value,
        schema: &Arc<Schema>,
        properties: WriterProperties,
        start: Start,
    ) -> Outcome<Opened> {
        let partial = beside(output, ".partial");
        let path = beside(output, ".journal");
        if output.exists() && !path.exists() && !start.force {
            let output = output.display();
            let message = format!("{output} exists; replace it with --force");
            return Err(FleetError::Settings(message));
        }
        let mut journal = Journal::open(&path, settings, start.restart)?;
        // Under the lock: another run may have ended since.
        let exists = output.exists();
        // Settings are written after the partial file is made, which gets the name of the output
        // at the end.
        if exists && journal.begun && !partial.exists() {
            let counts = journal.parts.last().map_or([0; 3], |part| part.counts);
            journal.remove()?;
            return Ok(Opened::Finished(counts));
        }
        if exists && !start.force {
            if !journal.begun {
                journal.remove()?;
            }
            let output = output.display();
            let message = format!("{output} exists; replace it with --force");
            return Err(FleetError::Settings(message));
        }
        let at = partial.clone();
        let (wrong, failed) = (FleetError::file(&at), FleetError::parquet(&at));
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&partial)
            .map_err(&wrong)?;
        let valid = intact(&mut file, &journal.parts).map_err(&wrong)?;
        journal.keep(valid, settings)?;
        let (end, counts) =
            journal.parts.last().map_or((0, [0; 3]), |part| (part.end, part.counts));
        file.set_len(end).map_err(&wrong)?;
        file.seek(SeekFrom::Start(end)).map_err(&wrong)?;
        if !journal.begun {
            journal.begin(settings)?;
        }
        let disk = Disk::new(&file).map_err(&wrong)?;
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
        if writer.inner().skip > 0 {
            let message = "its parts do not follow each other as the journal says";
            return Err(FleetError::format(&partial, message));
        }
        let (output, schema) = (output.to_owned(), schema.clone());
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
        })))
    }

    /// Number of complete parts.
    pub(crate) fn parts(&self) -> usize {
        self.journal.parts.len()
    }

    /// Rows of the input that complete parts are made of.
    pub(crate) fn end_row(&self) -> u64 {
        self.journal.parts.last().map_or(0, |part| part.end_row)
    }

    /// Drives, steps, and drives that failed, of all rows so far.
    pub(crate) fn counts(&self) -> [u64; 3] {
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
        counts: [u64; 3],
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

    /// Completes the part, of which the input ends before a row.
    pub(crate) fn end_part(&mut self, end_row: u64) -> Outcome<()> {
        let Some((columns, _)) = self.part.take() else { return Ok(()) };
        let wrong = FleetError::parquet(&self.path);
        let group = append(&mut self.writer, columns).map_err(&wrong)?;
        self.writer.flush().map_err(FleetError::file(&self.path))?;
        let end = self.writer.bytes_written() as u64;
        let hash = std::mem::take(&mut self.writer.inner_mut().hash).finish();
        let metadata = hex(&footer(&self.writer, group).map_err(&wrong)?);
        self.disk.push();
        self.journal.add(Part { end_row, end, hash, counts: self.counts, metadata })
    }

    /// Writes the footer, and gives the file its name.
    pub(crate) fn finish(self) -> Outcome<[u64; 3]> {
        let Self { output, path: partial, journal, mut writer, counts, disk, .. } = self;
        writer.finish().map_err(FleetError::parquet(&partial))?;
        writer.flush().map_err(FleetError::file(&partial))?;
        disk.end();
        writer.inner().file.sync_all().map_err(FleetError::file(&partial))?;
        fs::rename(&partial, &output).map_err(FleetError::file(&output))?;
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
        // Not all systems can do this, and the file is complete in any case.
        _ = File::open(folder.unwrap_or(Path::new("."))).and_then(|folder| folder.sync_all());
        journal.remove()?;
        Ok(counts)
    }

    /// Removes what has been written.
    pub(crate) fn discard(self) -> Outcome<()> {
        fs::remove_file(&self.path).map_err(FleetError::file(&self.path))?;
        self.journal.remove()
    }
}

/// Number of parts, from the first, whose bytes are as they were written.
fn intact(file: &mut File, parts: &[Part]) -> io::Result<usize> {
    file.seek(SeekFrom::Start(0))?;
    let (mut start, mut buffer) = (0, vec![0; 1 << 20]);
    for (number, part) in parts.iter().enumerate() {
        let mut hash = XxHash3_64::default();
        let mut left = part.end.saturating_sub(start);
        while left > 0 {
            let most = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
            let read = file.read(&mut buffer[..most])?;
            if read == 0 {
                return Ok(number);
            }
            hash.write(&buffer[..read]);
            left -= read as u64;
        }
        if hash.finish() != part.hash {
            return Ok(number);
        }
        start = part.end;
    }
    Ok(parts.len())
}

/// Writes the columns of a row group.
fn append(
    writer: &mut SerializedFileWriter<Spool>,
    columns: Vec<ArrowColumnWriter>,
) -> Result<RowGroupMetaData, ParquetError> {
    let mut group = writer.next_row_group()?;
    for column in columns {
        column.close()?.append_to_row_group(&mut group)?;
    }
    Ok(Arc::unwrap_or_clone(group.close()?))
}

/// Tells the writer of a row group that is in the file already.
fn replay(writer: &mut SerializedFileWriter<Spool>, part: &Part) -> Result<(), ParquetError> {
    let damaged = || ParquetError::General("the journal has damaged metadata".to_owned());
    let bytes = unhex(&part.metadata).ok_or_else(damaged)?;
    let length = bytes.len().checked_sub(FOOTER_TAIL).ok_or_else(damaged)?;
    // As they were, so that the file gets the same footer as without an interruption.
    let whole = ParquetMetaDataOptions::new().with_encoding_stats_as_mask(false);
    let metadata =
        ParquetMetaDataReader::decode_metadata_with_options(&bytes[..length], Some(&whole))?;
    let group = metadata.row_groups().first().ok_or_else(damaged)?;
    let mut out = writer.next_row_group()?;
    for column in group.columns() {
        let close = ColumnCloseResult {
            bytes_written: column.compressed_size().max(0).cast_unsigned(),
            rows_written: group.num_rows().max(0).cast_unsigned(),
            metadata: as_written(column)?,
            bloom_filter: None,
            column_index: None,
            offset_index: None,
        };
        out.append_column(&Nothing, close)?;
    }
    out.close()?;
    Ok(())
}

/// Metadata as the writer had it: what is read no longer says that bounds of integers also stand
/// in the fields of old readers.
fn as_written(column: &ColumnChunkMetaData) -> Result<ColumnChunkMetaData, ParquetError> {
    let Some(Statistics::Int64(bounds)) = column.statistics() else { return Ok(column.clone()) };
    let bounds = bounds.clone().with_backwards_compatible_min_max(true);
    column.clone().into_builder().set_statistics(Statistics::Int64(bounds)).build()
}

/// Metadata of a row group as a file would end with it.
fn footer(
    writer: &SerializedFileWriter<Spool>,
    group: RowGroupMetaData,
) -> Result<Vec<u8>, ParquetError> {
    let schema = group.schema_descr_ptr();
    let file = FileMetaData::new(
        writer.properties().writer_version().as_num(),
        group.num_rows(),
        None,
        None,
        schema,
        None,
    );
    let metadata = ParquetMetaDataBuilder::new(file).add_row_group(group).build();
    let mut bytes = Vec::new();
    ParquetMetaDataWriter::new(&mut bytes, &metadata).finish()?;
    Ok(bytes)
}

fn hex(bytes: &[u8]) -> String {
    let digit = |half: u8| char::from_digit(u32::from(half), 16).unwrap_or('0');
    bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]).collect()
}

fn unhex(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    let byte = |pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    pairs.map(byte).collect()
}
