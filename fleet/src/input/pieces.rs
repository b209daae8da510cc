//! Identity of what is read: hashes of pieces of the input.
//!
//! A piece of a Parquet file is a row group: the chunks of the columns that are read, and where
//! they are. Of a CSV file it is a block of bytes. A run notes the pieces as it reads them, and the
//! journal which of them a finished part is made of, so that a run that continues can tell whether
//! they are the same.

use std::collections::VecDeque;
use std::fs::File;
use std::hash::Hasher;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use parquet::arrow::ProjectionMask;
use parquet::file::metadata::ParquetMetaData;
use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_64;

use super::columns::ColumnNames;
use super::{is_csv, parquet as groups};
use crate::error::{FleetError, Outcome};
use crate::sensor::Sensor;

/// Bytes of a piece of a CSV file.
pub(super) const BLOCK: usize = 1 << 16;
/// Bytes that are read at a time.
const BUFFER: usize = 1 << 20;

/// A piece of the input that was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Piece {
    /// Number of the file.
    pub(crate) file: usize,
    /// Number of the row group or block.
    pub(crate) number: u64,
    /// Row that the piece begins with, or within.
    pub(crate) first_row: u64,
    /// Hash (XXH3).
    pub(crate) hash: u64,
}

/// Pieces that were read and are not yet asked for, in their order.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pieces(Arc<Mutex<VecDeque<Piece>>>);

impl Pieces {
    pub(super) fn add(&self, piece: Piece) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push_back(piece);
    }

    /// Takes the pieces that rows before a row of a file come from.
    pub(crate) fn take(&self, file: usize, end_row: u64) -> Vec<Piece> {
        let mut pieces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let before = |piece: &Piece| (piece.file, piece.first_row) < (file, end_row);
        let count = pieces.iter().take_while(|piece| before(piece)).count();
        pieces.drain(..count).collect()
    }
}

/// Hash of pieces in their order.
#[derive(Clone, Default)]
pub(crate) struct Digest(XxHash3_64);

impl Digest {
    pub(crate) fn add(&mut self, piece: &Piece) {
        for part in [piece.file as u64, piece.number, piece.hash] {
            self.0.write(&part.to_le_bytes());
        }
    }

    pub(crate) fn text(&self) -> String {
        format!("{:016x}", self.0.finish())
    }
}

/// A file whose pieces are hashed.
pub(super) enum Content {
    Parquet(Box<(PathBuf, File, Arc<ParquetMetaData>, ProjectionMask)>),
    Csv(PathBuf, File),
}

impl Content {
    pub(super) fn open(path: &Path, names: &ColumnNames, sensor: &Sensor) -> Outcome<Self> {
        let owned = path.to_owned();
        if is_csv(path) {
            let file = File::open(path).map_err(FleetError::file(path))?;
            return Ok(Self::Csv(owned, file));
        }
        let (file, metadata, mask) = groups::columns(path, names, sensor)?;
        Ok(Self::Parquet(Box::new((owned, file, metadata, mask))))
    }

    /// Hash of a piece, or nothing after the last one.
    pub(super) fn hash(&self, number: u64) -> Outcome<Option<u64>> {
        match self {
            Self::Parquet(parts) => {
                let (path, file, metadata, mask) = &**parts;
                let index = usize::try_from(number).unwrap_or(usize::MAX);
                if index >= metadata.num_row_groups() {
                    return Ok(None);
                }
                group(file, metadata, mask, index).map(Some).map_err(FleetError::file(path))
            }
            Self::Csv(path, file) => {
                let mut hash = XxHash3_64::default();
                let start = number.saturating_mul(BLOCK as u64);
                let count = hash_range(file, start, BLOCK as u64, &mut hash)
                    .map_err(FleetError::file(path))?;
                Ok((count > 0).then(|| hash.finish()))
            }
        }
    }

    /// Name of a piece, for messages.
    pub(super) fn name(&self, number: u64) -> String {
        match self {
            Self::Parquet(parts) => {
                let groups = parts.2.row_groups().iter().map(|group| group.num_rows().max(0));
                let first: i64 = groups.clone().take(number as usize).sum();
                let rows = groups.clone().nth(number as usize).unwrap_or(0);
                format!("row group {number} (rows {first} to {})", first + rows - 1)
            }
            Self::Csv(..) => {
                let start = number.saturating_mul(BLOCK as u64);
                format!("the block of {BLOCK} bytes at byte {start}")
            }
        }
    }
}

/// Hash of a row group: of the bytes of the columns that are read, and of what says how to read
/// them.
pub(super) fn group(
    file: &File,
    metadata: &ParquetMetaData,
    mask: &ProjectionMask,
    index: usize,
) -> io::Result<u64> {
    let mut hash = XxHash3_64::default();
    let group = metadata.row_group(index);
    hash.write(&group.num_rows().to_le_bytes());
    for (leaf, column) in group.columns().iter().enumerate() {
        if !mask.leaf_included(leaf) {
            continue;
        }
        let described = column.column_descr();
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
        // A damaged file may have any numbers here; the reader says so.
        let start = column.dictionary_page_offset().unwrap_or(column.data_page_offset());
        let start = start.min(column.data_page_offset()).max(0).cast_unsigned();
        let length = column.compressed_size().max(0).cast_unsigned();
        hash_range(file, start, length, &mut hash)?;
    }
    Ok(hash.finish())
}

/// Hashes so many bytes of a file, or fewer at its end; returns their number.
fn hash_range(file: &File, start: u64, length: u64, hash: &mut XxHash3_64) -> io::Result<u64> {
    let mut file = file;
    let mut bytes = file.seek(SeekFrom::Start(start)).map(|_| file.take(length))?;
    let mut buffer = vec![0; BUFFER.min(usize::try_from(length).unwrap_or(BUFFER))];
    let mut count = 0;
    loop {
        match bytes.read(&mut buffer) {
            Ok(0) => return Ok(count),
            Ok(read) => {
                hash.write(&buffer[..read]);
                count += read as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// Reads a block, or less at the end of the file.
pub(super) fn block(file: &mut File, buffer: &mut Vec<u8>) -> io::Result<()> {
    buffer.clear();
    file.take(BLOCK as u64).read_to_end(buffer).map(|_| ())
}

/// Hash of a block.
pub(super) fn hash_of(bytes: &[u8]) -> u64 {
    XxHash3_64::oneshot(bytes)
}
