//! Row groups of an output: written, or replayed to the writer when they are in the file already.
//!
//! Replayed groups must leave the writer in the state it had after writing them, so that the
//! footer, and with it the whole file, comes out the same to the byte.

#[cfg(feature = "sql")]
use std::fs::File;
use std::sync::Arc;

use parquet::arrow::arrow_writer::ArrowColumnWriter;
use parquet::column::writer::ColumnCloseResult;
use parquet::errors::ParquetError;
use parquet::file::metadata::{
    ColumnChunkMetaData, FileMetaData, ParquetMetaData, ParquetMetaDataBuilder,
    ParquetMetaDataOptions, ParquetMetaDataReader, ParquetMetaDataWriter, RowGroupMetaData,
};
use parquet::file::reader::ChunkReader;
use parquet::file::statistics::Statistics;
use parquet::file::writer::SerializedFileWriter;

use crate::journal::Part;
use crate::spool::{Nothing, Spool};

/// Trailing bytes of a footer: the length of the metadata, and the magic number.
const FOOTER_TAIL: usize = 8;

/// Writes the columns of a row group.
pub(crate) fn append(
    writer: &mut SerializedFileWriter<Spool>,
    columns: Vec<ArrowColumnWriter>,
) -> Result<RowGroupMetaData, ParquetError> {
    let mut group = writer.next_row_group()?;
    for column in columns {
        column.close()?.append_to_row_group(&mut group)?;
    }
    Ok(Arc::unwrap_or_clone(group.close()?))
}

/// Replays the row groups of a part whose bytes are in the file already.
pub(crate) fn replay(
    writer: &mut SerializedFileWriter<Spool>,
    part: &Part,
) -> Result<(), ParquetError> {
    let damaged = || ParquetError::General("the journal has damaged metadata".to_owned());
    let bytes = unhex(&part.metadata).ok_or_else(damaged)?;
    let length = bytes.len().checked_sub(FOOTER_TAIL).ok_or_else(damaged)?;
    let metadata =
        ParquetMetaDataReader::decode_metadata_with_options(&bytes[..length], Some(&whole()))?;
    // `Nothing` feeds zeros in place of the columns, and the spool drops as many bytes as the file
    // has already: offsets advance, the disk is not touched.
    splice(writer, &Nothing, &metadata).map(|_| ())
}

/// Copies the row groups of a Parquet file with the same columns, without decoding them.
#[cfg(feature = "sql")]
pub(crate) fn copy(
    writer: &mut SerializedFileWriter<Spool>,
    file: &File,
) -> Result<Vec<RowGroupMetaData>, ParquetError> {
    let reader = ParquetMetaDataReader::new().with_metadata_options(Some(whole()));
    splice(writer, file, &reader.parse_and_finish(file)?)
}

/// Options that keep the metadata as written: the default folds encoding statistics into a mask,
/// and the footer would differ from that of an uninterrupted run.
fn whole() -> ParquetMetaDataOptions {
    ParquetMetaDataOptions::new().with_encoding_stats_as_mask(false)
}

fn splice(
    writer: &mut SerializedFileWriter<Spool>,
    reader: &impl ChunkReader,
    metadata: &ParquetMetaData,
) -> Result<Vec<RowGroupMetaData>, ParquetError> {
    let mut groups = Vec::with_capacity(metadata.num_row_groups());
    for group in metadata.row_groups() {
        let mut out = writer.next_row_group()?;
        for column in group.columns() {
            let close = ColumnCloseResult {
                // The writer copies exactly this many bytes from `reader`. `max(0)`: a damaged
                // journal may hold anything.
                bytes_written: column.compressed_size().max(0).cast_unsigned(),
                rows_written: group.num_rows().max(0).cast_unsigned(),
                metadata: as_written(column)?,
                // None of these is enabled in `properties`.
                bloom_filter: None,
                column_index: None,
                offset_index: None,
            };
            out.append_column(reader, close)?;
        }
        groups.push(Arc::unwrap_or_clone(out.close()?));
    }
    Ok(groups)
}

/// Metadata as the writer had it. The reader drops the mark that bounds of signed columns are also
/// stored in the deprecated `min`/`max` fields, so set it again.
fn as_written(column: &ColumnChunkMetaData) -> Result<ColumnChunkMetaData, ParquetError> {
    let Some(bounds) = column.statistics() else { return Ok(column.clone()) };
    let signed = column.column_descr().sort_order().is_signed();
    macro_rules! with_old_fields {
        ($($kind:ident)*) => {
            match bounds.clone() {
                $(Statistics::$kind(bounds) => {
                    Statistics::$kind(bounds.with_backwards_compatible_min_max(signed))
                })*
            }
        };
    }
    let bounds =
        with_old_fields!(Boolean Int32 Int64 Int96 Float Double ByteArray FixedLenByteArray);
    column.clone().into_builder().set_statistics(bounds).build()
}

/// Encodes the metadata of row groups as the footer of a file that has only these.
pub(crate) fn footer(
    writer: &SerializedFileWriter<Spool>,
    groups: Vec<RowGroupMetaData>,
) -> Result<Vec<u8>, ParquetError> {
    let schema = Arc::new(writer.schema_descr().clone());
    let file = FileMetaData::new(
        writer.properties().writer_version().as_num(),
        groups.iter().map(RowGroupMetaData::num_rows).sum(),
        None,
        None,
        schema,
        None,
    );
    let metadata = ParquetMetaDataBuilder::new(file).set_row_groups(groups).build();
    let mut bytes = Vec::new();
    ParquetMetaDataWriter::new(&mut bytes, &metadata).finish()?;
    Ok(bytes)
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    let digit = |half: u8| char::from_digit(u32::from(half), 16).unwrap_or('0');
    bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]).collect()
}

fn unhex(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    let byte = |pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    pairs.map(byte).collect()
}
