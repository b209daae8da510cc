//! Input files: on a local disk, or objects of a store named by a URL.
//!
//! Readers see both as a [`Stored`]. A local file is read page by page. For an object, the chunks
//! of a row group are fetched together, and hashed and decoded from memory, so that no byte is
//! transferred twice.

#[cfg(feature = "object-store")]
mod object;

use std::fs::File;
use std::hash::Hasher;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use bytes::Bytes;
use parquet::errors::Result as ParquetResult;
use parquet::file::reader::{ChunkReader, Length};
use twox_hash::XxHash3_64;

use crate::error::{FleetError, Outcome};
#[cfg(feature = "object-store")]
pub use object::register_store;

/// Bytes read at a time for hashing.
const BUFFER: usize = 1 << 20;

/// An open input file.
#[derive(Debug, Clone)]
pub(crate) enum Stored {
    Disk(OnDisk),
    #[cfg(feature = "object-store")]
    Object(object::Object),
}

/// An open local file, with its size and time of modification when it was opened.
#[derive(Debug, Clone)]
pub(crate) struct OnDisk {
    file: Arc<File>,
    stamp: (u64, Option<SystemTime>),
}

/// Reader of a part of a file.
pub(crate) type Reader = Box<dyn Read + Send>;

impl Stored {
    /// Opens a file, or an object if the path is a URL.
    pub(crate) fn open(path: &Path) -> Outcome<Self> {
        if is_url(path) {
            return object(path);
        }
        let file = File::open(path).map_err(FleetError::file(path))?;
        let stamp = stamp(&file).map_err(FleetError::file(path))?;
        Ok(Self::Disk(OnDisk { file: Arc::new(file), stamp }))
    }

    /// Returns true if the file is unchanged since it was opened. An object always is: each request
    /// checks it.
    pub(crate) fn is_unchanged(&self) -> io::Result<bool> {
        match self {
            Self::Disk(disk) => Ok(stamp(&disk.file)? == disk.stamp),
            #[cfg(feature = "object-store")]
            Self::Object(_) => Ok(true),
        }
    }

    /// The same file with these ranges in memory, if reading them one by one would be slow.
    #[cfg_attr(
        not(feature = "object-store"),
        expect(clippy::unnecessary_wraps, reason = "nothing is fetched")
    )]
    pub(crate) fn with(&self, ranges: &[Range<u64>]) -> io::Result<Self> {
        match self {
            Self::Disk(_) => {
                _ = ranges;
                Ok(self.clone())
            }
            #[cfg(feature = "object-store")]
            Self::Object(object) => object.with(ranges).map(Self::Object),
        }
    }

    /// Reads from a given byte onwards. Two readers of a local file share their position.
    pub(crate) fn read_from(&self, start: u64) -> io::Result<Reader> {
        match self {
            Self::Disk(disk) => {
                // A clone shares the file offset. Callers finish one reader before they start the
                // next.
                let mut file = disk.file.try_clone()?;
                file.seek(SeekFrom::Start(start))?;
                Ok(Box::new(file))
            }
            #[cfg(feature = "object-store")]
            Self::Object(object) => Ok(object.read_from(start)),
        }
    }

    /// Hashes a range of bytes, cut off at the end of the file.
    pub(crate) fn hash(&self, range: Range<u64>, hash: &mut XxHash3_64) -> io::Result<()> {
        let length = range.end.saturating_sub(range.start);
        let mut bytes = self.read_from(range.start)?.take(length);
        let mut buffer = vec![0; BUFFER.min(usize::try_from(length).unwrap_or(BUFFER))];
        loop {
            match bytes.read(&mut buffer) {
                Ok(0) => return Ok(()),
                Ok(read) => hash.write(&buffer[..read]),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }
}

impl Length for Stored {
    fn len(&self) -> u64 {
        match self {
            Self::Disk(disk) => disk.file.len(),
            #[cfg(feature = "object-store")]
            Self::Object(object) => object.len(),
        }
    }
}

impl ChunkReader for Stored {
    type T = Reader;

    fn get_read(&self, start: u64) -> ParquetResult<Reader> {
        match self {
            Self::Disk(disk) => Ok(Box::new(disk.file.get_read(start)?)),
            #[cfg(feature = "object-store")]
            Self::Object(object) => Ok(object.read_from(start)),
        }
    }

    fn get_bytes(&self, start: u64, length: usize) -> ParquetResult<Bytes> {
        match self {
            Self::Disk(disk) => disk.file.get_bytes(start, length),
            #[cfg(feature = "object-store")]
            Self::Object(object) => Ok(object.bytes(start..start + length as u64)?),
        }
    }
}

/// Size and time of modification.
fn stamp(file: &File) -> io::Result<(u64, Option<SystemTime>)> {
    let metadata = file.metadata()?;
    Ok((metadata.len(), metadata.modified().ok()))
}

/// True for `s3://bucket/drives` and the like.
pub(crate) fn is_url(path: &Path) -> bool {
    let scheme = path.to_str().and_then(|text| text.split_once("://"));
    scheme.is_some_and(|(scheme, _)| {
        // A single letter is a Windows drive.
        scheme.len() > 1 && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric())
    })
}

/// Refuses a URL as the place of results.
pub(crate) fn local(path: &Path) -> Outcome<()> {
    if is_url(path) {
        let message =
            "is a URL; results are written to local files, to be uploaded with other tools";
        return Err(FleetError::format(path, message));
    }
    Ok(())
}

/// Lists the objects a URL names: one, or all whose names begin with it, sorted by the rest of
/// their path.
pub(crate) fn list(url: &Path) -> Outcome<Listed> {
    #[cfg(feature = "object-store")]
    return object::list(url);
    #[cfg(not(feature = "object-store"))]
    Err(without_feature(url))
}

/// Local file that a URL names, if it is one.
pub(crate) fn on_disk(url: &Path) -> Option<PathBuf> {
    #[cfg(feature = "object-store")]
    return object::on_disk(url);
    #[cfg(not(feature = "object-store"))]
    {
        _ = url;
        None
    }
}

/// The objects of a URL.
#[cfg_attr(not(feature = "object-store"), expect(dead_code, reason = "nothing can be listed"))]
pub(crate) enum Listed {
    /// A single object of that name.
    One(PathBuf),
    /// Objects below it: their URLs, and their paths relative to it; and the local folder that this
    /// is, if it is one.
    Folder(Vec<(PathBuf, PathBuf)>, Option<PathBuf>),
}

/// Reads a whole file, if it has at most `most` bytes.
pub(crate) fn whole(path: &Path, most: u64) -> Outcome<Vec<u8>> {
    let stored = Stored::open(path)?;
    // Asked before anything is read or allocated.
    if stored.len() > most {
        return Err(FleetError::format(path, format!("has more than {most} bytes")));
    }
    let mut bytes = Vec::new();
    let read = stored.read_from(0).and_then(|mut reader| reader.read_to_end(&mut bytes));
    read.map_err(FleetError::file(path))?;
    Ok(bytes)
}

#[cfg(feature = "object-store")]
fn object(url: &Path) -> Outcome<Stored> {
    object::Object::open(url).map(Stored::Object)
}

#[cfg(not(feature = "object-store"))]
fn object(url: &Path) -> Outcome<Stored> {
    Err(without_feature(url))
}

#[cfg(not(feature = "object-store"))]
fn without_feature(url: &Path) -> FleetError {
    FleetError::format(url, "is a URL; this command was built without the feature `object-store`")
}
