//! Blocks of an OpenStreetMap extract, with the place of each in errors.

use std::fmt::Display;
use std::io::{Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use osmpbf::{Blob, BlobDecode, BlobReader, ByteOffset, PrimitiveBlock};

use crate::files::excerpt;
use crate::map::MapError;

/// A file of blocks.
pub(super) struct Blocks<'a, R: Read + Send> {
    file: &'a str,
    reader: BlobReader<R>,
}

/// Number of a block, from 1, and where it starts.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlockPlace {
    block: u64,
    byte: u64,
}

impl<'a, R: Read + Seek + Send> Blocks<'a, R> {
    pub(super) fn new(file: &'a str, mut reader: R) -> Result<Self, MapError> {
        let cannot = |reason: String| MapError::Read { file: file.to_owned(), reason };
        reader.rewind().map_err(|error| cannot(error.to_string()))?;
        let reader = BlobReader::new_seekable(reader).map_err(|error| cannot(error.to_string()))?;
        Ok(Self { file, reader })
    }

    /// Visits all blocks of data. Returns the places of those for which `visit` says true.
    pub(super) fn each(
        &mut self,
        mut visit: impl FnMut(&PrimitiveBlock) -> Result<bool, String>,
    ) -> Result<Vec<BlockPlace>, MapError> {
        let mut wanted = Vec::new();
        for block in 1.. {
            let byte = self.position(SeekFrom::Current(0))?;
            let place = BlockPlace { block, byte };
            let Some(blob) = unwinding(|| self.reader.next()).transpose() else {
                // The reader takes a rest of up to three bytes for the end.
                let end = self.position(SeekFrom::End(0))?;
                if end > byte || block == 1 {
                    let left = end - byte;
                    let problem = format!("{left} bytes are left, too few for a block");
                    return Err(self.error(place, problem));
                }
                break;
            };
            let blob = blob.and_then(|blob| blob.map_err(|error| error.to_string()));
            let blob = blob.map_err(|error| self.error(place, error))?;
            if self.visit(&blob, place, &mut visit)? == Some(true) {
                wanted.push(place);
            }
        }
        Ok(wanted)
    }

    /// Visits the blocks at some places.
    pub(super) fn each_of(
        &mut self,
        places: &[BlockPlace],
        mut visit: impl FnMut(&PrimitiveBlock) -> Result<(), String>,
    ) -> Result<(), MapError> {
        for &place in places {
            let blob = unwinding(|| self.reader.blob_from_offset(ByteOffset(place.byte)));
            let blob = blob.and_then(|blob| blob.map_err(|error| error.to_string()));
            let blob = blob.map_err(|error| self.error(place, error))?;
            self.visit(&blob, place, &mut visit)?;
        }
        Ok(())
    }

    /// Decodes a block and visits its data, if it holds any.
    fn visit<T>(
        &self,
        blob: &Blob,
        place: BlockPlace,
        visit: &mut impl FnMut(&PrimitiveBlock) -> Result<T, String>,
    ) -> Result<Option<T>, MapError> {
        let decoded = blob.decode().map_err(|error| self.error(place, error))?;
        let block = match decoded {
            BlobDecode::OsmHeader(header) => {
                let known = ["OsmSchema-V0.6", "DenseNodes"];
                let mut needed = header.required_features().iter();
                return match needed.find(|feature| !known.contains(&feature.as_str())) {
                    Some(feature) => {
                        let feature = excerpt(feature);
                        let problem = format!("{feature:?} is needed, which is not supported");
                        Err(self.error(place, problem))
                    }
                    None => Ok(None),
                };
            }
            _ if place.block == 1 => {
                return Err(self.error(place, "expected the header, found other data"));
            }
            BlobDecode::OsmData(block) => block,
            BlobDecode::Unknown(_) => return Ok(None),
        };
        let result = unwinding(|| visit(&block)).and_then(|result| result);
        result.map(Some).map_err(|problem| self.error(place, problem))
    }

    fn position(&mut self, from: SeekFrom) -> Result<u64, MapError> {
        let position = self.reader.seek_raw(from);
        let file = || self.file.to_owned();
        position.map_err(|error| MapError::Read { file: file(), reason: error.to_string() })
    }

    fn error(&self, BlockPlace { block, byte }: BlockPlace, problem: impl Display) -> MapError {
        let mut problem = problem.to_string();
        if block == 1 {
            problem += "; expected an OpenStreetMap extract (.osm.pbf)";
        }
        MapError::Block { file: self.file.to_owned(), block, byte, problem }
    }
}

/// Calls `osmpbf`, which panics on some damaged numbers: sums that overflow, in builds that check
/// them, and kinds of members that it doesn't know.
fn unwinding<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    let result = catch_unwind(AssertUnwindSafe(call));
    result.map_err(|_| String::from("numbers out of their range"))
}
