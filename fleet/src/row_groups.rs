//! Row groups of an output: written, or told to the writer when they are in the file already.

use std::sync::Arc;

use parquet::arrow::arrow_writer::ArrowColumnWriter;
use parquet::column::writer::ColumnCloseResult;
use parquet::errors::ParquetError;
use parquet::file::metadata::{
    ColumnChunkMetaData, FileMetaData, ParquetMetaDataBuilder, ParquetMetaDataOptions,
    ParquetMetaDataReader, ParquetMetaDataWriter, RowGroupMetaData,
};
use parquet::file::statistics::Statistics;
use parquet::file::writer::SerializedFileWriter;

use crate::journal::Part;
use crate::spool::{Nothing, Spool};

/// Bytes of the end of a footer: the length of the metadata, and a mark.
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

/// Tells the writer of a row group that is in the file already.
pub(crate) fn replay(
    writer: &mut SerializedFileWriter<Spool>,
    part: &Part,
) -> Result<(), ParquetError> {
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
pub(crate) fn footer(
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

pub(crate) fn hex(bytes: &[u8]) -> String {
    let digit = |half: u8| char::from_digit(u32::from(half), 16).unwrap_or('0');
    bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]).collect()
}

fn unhex(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    let byte = |pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    pairs.map(byte).collect()
}
