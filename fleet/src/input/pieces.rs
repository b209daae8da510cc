//! Identity of the input: hashes of its pieces.
//!
//! In a Parquet file a piece is a row group: the chunks of the columns that are read, and their
//! description. In a CSV file it is a block of bytes. A run records the pieces as it reads them,
//! and the journal lists those each finished part was made from, so that a run that continues can
//! tell whether they are still the same.

use std::collections::VecDeque;
use std::hash::Hasher;
use std::io::{self, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use parquet::arrow::ProjectionMask;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData};
use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_64;

use super::columns::ColumnNames;
use super::{is_csv, parquet as groups};
use crate::error::{FleetError, Outcome};
use crate::sensor::Sensor;
use crate::storage::{Reader, Stored};

/// Size of a piece of a CSV file, in bytes.
pub(super) const BLOCK: usize = 1 << 16;

/// A piece of the input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Piece {
    /// Number of the file.
    pub(crate) file: usize,
    /// Number of the row group or block.
    pub(crate) number: u64,
    /// Row at which, or within which, the piece begins.
    pub(crate) first_row: u64,
    /// Hash (XXH3).
    pub(crate) hash: u64,
}

/// Pieces that were read and not taken yet, in order. Shared by the reader, which adds them, and
/// the run, which takes them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pieces(Arc<Mutex<VecDeque<Piece>>>);

impl Pieces {
    pub(super) fn add(&self, piece: Piece) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push_back(piece);
    }

    /// Takes the pieces that contain rows before row `end_row` of a file.
    pub(crate) fn take(&self, file: usize, end_row: u64) -> Vec<Piece> {
        let mut pieces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // The reader is ahead of the results, so pieces of later rows may be here already. A piece
        // that begins before `end_row` may also hold later rows; those then need no second mention.
        let before = |piece: &Piece| (piece.file, piece.first_row) < (file, end_row);
        let count = pieces.iter().take_while(|piece| before(piece)).count();
        pieces.drain(..count).collect()
    }
}

/// Hash of a sequence of pieces.
#[derive(Clone, Default)]
pub(crate) struct Digest(XxHash3_64);

impl Digest {
    pub(crate) fn add(&mut self, piece: &Piece) {
        // The first row is left out: it depends on where reading began.
        for part in [piece.file as u64, piece.number, piece.hash] {
            self.0.write(&part.to_le_bytes());
        }
    }

    pub(crate) fn text(&self) -> String {
        format!("{:016x}", self.0.finish())
    }
}

/// A file opened to hash its pieces.
pub(super) struct Content {
    path: PathBuf,
    stored: Stored,
    kind: Kind,
}

enum Kind {
    Parquet(Arc<ParquetMetaData>, ProjectionMask),
    /// Reader, and the number of the block it will read next.
    Csv(Reader, u64),
}

impl Content {
    pub(super) fn open(path: &Path, names: &ColumnNames, sensor: &Sensor) -> Outcome<Self> {
        let owned = path.to_owned();
        if is_csv(path) {
            let stored = Stored::open(path)?;
            let reader = stored.read_from(0).map_err(FleetError::file(path))?;
            return Ok(Self { path: owned, stored, kind: Kind::Csv(reader, 0) });
        }
        let (stored, metadata, mask) = groups::columns(path, names, sensor)?;
        Ok(Self { path: owned, stored, kind: Kind::Parquet(metadata, mask) })
    }

    /// Hash of a piece, or `None` after the last one.
    pub(super) fn hash(&mut self, number: u64) -> Outcome<Option<u64>> {
        let hash = match &mut self.kind {
            Kind::Parquet(metadata, mask) => {
                let index = usize::try_from(number).unwrap_or(usize::MAX);
                if index >= metadata.num_row_groups() {
                    return Ok(None);
                }
                // One fetch for all chunks of the group, if the file is an object of a store.
                let stored = self.stored.with(&ranges(metadata, mask, index));
                stored.and_then(|stored| group(&stored, metadata, mask, index)).map(Some)
            }
            Kind::Csv(reader, next) => self.stored.block(reader, next, number),
        };
        hash.map_err(FleetError::file(&self.path))
    }

    /// Name of a piece in messages.
    pub(super) fn name(&self, number: u64) -> String {
        match &self.kind {
            Kind::Parquet(metadata, _) => {
                let groups = metadata.row_groups().iter().map(|group| group.num_rows().max(0));
                let first: i64 = groups.clone().take(number as usize).sum();
                let rows = groups.clone().nth(number as usize).unwrap_or(0);
                format!("row group {number} (rows {first} to {})", first + rows - 1)
            }
            Kind::Csv(..) => {
                let start = number.saturating_mul(BLOCK as u64);
                format!("the block of {BLOCK} bytes at byte {start}")
            }
        }
    }
}

impl Stored {
    /// Hash of a block of text, or `None` after the last one.
    fn block(&self, reader: &mut Reader, next: &mut u64, number: u64) -> io::Result<Option<u64>> {
        // Blocks in sequence need no seek, which for an object would be a new request.
        if *next != number {
            *reader = self.read_from(number.saturating_mul(BLOCK as u64))?;
        }
        *next = number + 1;
        let mut buffer = Vec::with_capacity(BLOCK);
        block(reader, &mut buffer)?;
        Ok((!buffer.is_empty()).then(|| hash_of(&buffer)))
    }
}

/// Columns of a row group that the mask includes.
fn read<'a>(
    metadata: &'a ParquetMetaData,
    mask: &'a ProjectionMask,
    group: usize,
) -> impl Iterator<Item = &'a ColumnChunkMetaData> {
    let columns = metadata.row_group(group).columns().iter().enumerate();
    columns.filter(|(leaf, _)| mask.leaf_included(*leaf)).map(|(_, column)| column)
}

/// Bytes of a chunk. A damaged file may have any numbers here; the reader reports it.
fn range(column: &ColumnChunkMetaData) -> Range<u64> {
    // The chunk begins with its dictionary page, if it has one.
    let start = column.dictionary_page_offset().unwrap_or(column.data_page_offset());
    let start = start.min(column.data_page_offset()).max(0).cast_unsigned();
    start..start.saturating_add(column.compressed_size().max(0).cast_unsigned())
}

/// Byte ranges of the included columns of a row group.
pub(super) fn ranges(
    metadata: &ParquetMetaData,
    mask: &ProjectionMask,
    group: usize,
) -> Vec<Range<u64>> {
    read(metadata, mask, group).map(range).collect()
}

/// Hash of a row group: of the bytes of the included columns, and of the metadata that tell how to
/// decode them.
pub(super) fn group(
    stored: &Stored,
    metadata: &ParquetMetaData,
    mask: &ProjectionMask,
    index: usize,
) -> io::Result<u64> {
    let mut hash = XxHash3_64::default();
    hash.write(&metadata.row_group(index).num_rows().to_le_bytes());
    for column in read(metadata, mask, index) {
        let described = column.column_descr();
        // The same bytes under another type or codec are other values. Offsets are left out: a copy
        // of the group elsewhere in a file is the same piece.
        let about = format!(
            "{} {:?} {:?} {:?} {} {}",
            column.column_path().string(),
            described.logical_type_ref(),
            column.column_type(),
            column.compression(),
            described.max_def_level(),
            described.max_rep_level(),
        );
        hash.write(about.as_bytes());
        hash.write(&column.num_values().to_le_bytes());
        stored.hash(range(column), &mut hash)?;
    }
    Ok(hash.finish())
}

/// Reads a block, shorter only at the end of the file.
pub(super) fn block(file: &mut impl Read, buffer: &mut Vec<u8>) -> io::Result<()> {
    buffer.clear();
    file.take(BLOCK as u64).read_to_end(buffer).map(|_| ())
}

/// Hash of a block.
pub(super) fn hash_of(bytes: &[u8]) -> u64 {
    XxHash3_64::oneshot(bytes)
}
