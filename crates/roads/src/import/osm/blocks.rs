//! Blocks of an OpenStreetMap extract, whose errors name the block and its first byte.
//!
//! A block consists of the length of its head, the head with the kind and length of the data, and
//! the data, usually compressed. All lengths are limited, and memory grows with the bytes read, not
//! with a claimed length.

use std::io::{Error, Read, Seek, SeekFrom};

use miniz_oxide::inflate::{TINFLStatus, decompress_to_vec_zlib_with_limit};

use super::elements::Block;
use super::wire::each_field;
use crate::NetworkError;
use wayfix::internal::excerpt;

/// Largest sizes of a head and of data in bytes, as the format defines them.
const LONGEST_HEAD: u64 = 64 * 1024;
const LONGEST_DATA: u64 = 32 * 1024 * 1024;

/// A reader of blocks.
pub(super) struct Blocks<'a, R> {
    file: &'a str,
    reader: R,
}

/// Number of a block, from 1, and where it starts.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlockPlace {
    block: u64,
    byte: u64,
}

/// A block with its message decompressed.
struct Blob {
    kind: String,
    message: Vec<u8>,
    /// Bytes of the block in the file.
    length: u64,
}

/// Reason why a block can't be read.
enum Failure {
    /// The reader fails.
    Read(Error),
    /// The block is not valid.
    Invalid(String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Read(error)
    }
}

impl From<String> for Failure {
    fn from(problem: String) -> Self {
        Self::Invalid(problem)
    }
}

impl<'a, R: Read + Seek> Blocks<'a, R> {
    pub(super) fn new(file: &'a str, reader: R) -> Self {
        Self { file, reader }
    }

    /// Visits all blocks of data. Returns the places of those for which `visit` returned true.
    pub(super) fn each(
        &mut self,
        mut visit: impl FnMut(&Block<'_>) -> Result<bool, String>,
    ) -> Result<Vec<BlockPlace>, NetworkError> {
        let (mut wanted, mut place) = (Vec::new(), BlockPlace { block: 1, byte: 0 });
        self.seek(0).map_err(|failure| self.error(place, failure))?;
        loop {
            let blob = self.next().map_err(|failure| self.error(place, failure))?;
            let Some(blob) = blob else {
                if place.block > 1 {
                    return Ok(wanted);
                }
                let problem = String::from("the file is empty");
                return Err(self.error(place, Failure::Invalid(problem)));
            };
            let visited = visited(&blob, place, &mut visit);
            let visited =
                visited.map_err(|problem| self.error(place, Failure::Invalid(problem)))?;
            if visited == Some(true) {
                wanted.push(place);
            }
            place = BlockPlace { block: place.block + 1, byte: place.byte + blob.length };
        }
    }

    /// Visits the blocks at the given places.
    pub(super) fn each_of(
        &mut self,
        places: &[BlockPlace],
        mut visit: impl FnMut(&Block<'_>) -> Result<(), String>,
    ) -> Result<(), NetworkError> {
        for &place in places {
            let blob = self.seek(place.byte).and_then(|()| self.next());
            let blob = blob.map_err(|failure| self.error(place, failure))?;
            // There is no block if the file was truncated in the meantime.
            if let Some(blob) = blob {
                let visited = visited(&blob, place, &mut visit);
                visited.map_err(|problem| self.error(place, Failure::Invalid(problem)))?;
            }
        }
        Ok(())
    }

    fn seek(&mut self, byte: u64) -> Result<(), Failure> {
        self.reader.seek(SeekFrom::Start(byte))?;
        Ok(())
    }

    /// Reads the next block; `None` at the end of the file.
    fn next(&mut self) -> Result<Option<Blob>, Failure> {
        let length = self.bytes(4)?;
        let Ok(length) = <[u8; 4]>::try_from(&length[..]) else {
            return match length.len() {
                0 => Ok(None),
                left => Err(format!("{left} bytes are left, too few for a block").into()),
            };
        };
        let head_length = u64::from(u32::from_be_bytes(length));
        if head_length >= LONGEST_HEAD {
            return Err(format!("a head of {head_length} bytes, expected fewer than 65536").into());
        }
        let head = self.whole(head_length, "head")?;
        let (mut kind, mut data_length) = ("", 0);
        each_field(&head, |field, value| {
            match field {
                1 => kind = std::str::from_utf8(value.bytes()?).map_err(|e| e.to_string())?,
                3 => data_length = value.number()?,
                _ => {}
            }
            Ok(())
        })?;
        if data_length > LONGEST_DATA {
            let problem = format!("{data_length} bytes of data, expected at most {LONGEST_DATA}");
            return Err(problem.into());
        }
        let message = message(&self.whole(data_length, "data")?)?;
        let length = 4 + head_length + data_length;
        Ok(Some(Blob { kind: kind.to_owned(), message, length }))
    }

    /// Reads `length` bytes, or those that are left.
    fn bytes(&mut self, length: u64) -> Result<Vec<u8>, Failure> {
        // Grown as bytes arrive: a false length in a short file allocates nothing.
        let mut bytes = Vec::new();
        self.reader.by_ref().take(length).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Reads exactly `length` bytes.
    fn whole(&mut self, length: u64, what: &str) -> Result<Vec<u8>, Failure> {
        let bytes = self.bytes(length)?;
        if bytes.len() as u64 == length {
            return Ok(bytes);
        }
        Err(format!("the file ends after {} of {length} bytes of {what}", bytes.len()).into())
    }

    fn error(&self, BlockPlace { block, byte }: BlockPlace, failure: Failure) -> NetworkError {
        let file = self.file.to_owned();
        let mut problem = match failure {
            Failure::Read(error) => return NetworkError::Read { file, reason: error.to_string() },
            Failure::Invalid(problem) => problem,
        };
        if block == 1 {
            // Most likely a file of another format.
            problem += "; expected an OpenStreetMap extract (.osm.pbf)";
        }
        NetworkError::Block { file, block, byte, problem }
    }
}

/// Message in the data of a block, decompressed.
fn message(data: &[u8]) -> Result<Vec<u8>, String> {
    let (mut plain, mut compressed, mut unknown) = (None, None, false);
    each_field(data, |field, value| {
        match field {
            1 => plain = Some(value.bytes()?),
            3 => compressed = Some(value.bytes()?),
            4..=7 => unknown = true,
            _ => {}
        }
        Ok(())
    })?;
    if let Some(plain) = plain {
        return Ok(plain.to_vec());
    }
    let Some(compressed) = compressed else {
        let found = if unknown { "data in another compression" } else { "no data" };
        return Err(format!("{found}, expected them plain or compressed by zlib"));
    };
    decompress_to_vec_zlib_with_limit(compressed, LONGEST_DATA as usize).map_err(
        |error| match error.status {
            TINFLStatus::HasMoreOutput => format!("more than {LONGEST_DATA} bytes of data"),
            _ => String::from("damaged compressed data"),
        },
    )
}

/// Visits a block if it has data. Checks the header.
fn visited<T>(
    blob: &Blob,
    place: BlockPlace,
    visit: &mut impl FnMut(&Block<'_>) -> Result<T, String>,
) -> Result<Option<T>, String> {
    match &blob.kind[..] {
        // Field 4 lists the features that a reader must support.
        "OSMHeader" => each_field(&blob.message, |field, value| {
            if field != 4 || matches!(value.bytes()?, b"OsmSchema-V0.6" | b"DenseNodes") {
                return Ok(());
            }
            let feature = String::from_utf8_lossy(value.bytes()?);
            Err(format!("the file requires {:?}, which is not supported", excerpt(&feature)))
        })
        .map(|()| None),
        _ if place.block == 1 => Err(String::from("expected the header, found other data")),
        "OSMData" => visit(&Block::parse(&blob.message)?).map(Some),
        _ => Ok(None),
    }
}
