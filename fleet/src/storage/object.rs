//! Objects of a store.
//!
//! The store is chosen by the crate `object_store` from the URL, with its settings from the
//! environment. Each request asks for the very object that was opened (by its ETag), and its answer
//! says which one it is from, so an object that was replaced is an error, never a mixture of two.

use std::fmt;
use std::future::Future;
use std::io::{self, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, LazyLock};

use bytes::{Buf, Bytes};
use futures::TryStreamExt;
use object_store::path::Path as Location;
use object_store::registry::{DefaultObjectStoreRegistry, ObjectStoreRegistry};
use object_store::{
    Error, GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt, coalesce_ranges,
};
use tokio::runtime::{Builder, Runtime};
use url::Url;

use super::{Listed, Reader};
use crate::error::{FleetError, Outcome, Replaced};
use crate::input::files::is_hidden;

/// Size of the first request of a reader, which often needs only a header; later ones are larger.
const FIRST: u64 = 1 << 16;
/// Maximum size of a request of a reader.
const MOST: u64 = 1 << 23;

static STORES: LazyLock<DefaultObjectStoreRegistry> = LazyLock::new(Default::default);
/// Runtime for requests. One thread suffices: it only waits.
static RUNTIME: LazyLock<io::Result<Runtime>> =
    LazyLock::new(|| Builder::new_multi_thread().worker_threads(1).enable_all().build());

/// Registers a store under the prefix of a URL, such as `memory:///name`, in place of the one that
/// the environment describes.
///
/// # Errors
///
/// [`FleetError::Format`] if it is not a URL.
pub fn register_store(url: &str, store: Arc<dyn ObjectStore>) -> Outcome<()> {
    STORES.register(parse(Path::new(url))?, store);
    Ok(())
}

/// An object as it was when it was opened.
#[derive(Clone)]
pub(crate) struct Object {
    store: Arc<dyn ObjectStore>,
    found: ObjectMeta,
    /// Ranges in memory, sorted by their first byte.
    known: Vec<(u64, Bytes)>,
}

impl fmt::Debug for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Object").field("found", &self.found).finish_non_exhaustive()
    }
}

impl Object {
    pub(super) fn open(url: &Path) -> Outcome<Self> {
        let (store, location) = resolve(url)?;
        let head = store.clone();
        let found = wait(async move { Ok(head.head(&location).await?) });
        Ok(Self { store, found: found.map_err(FleetError::file(url))?, known: Vec::new() })
    }

    pub(super) fn len(&self) -> u64 {
        self.found.size
    }

    /// The same object with these ranges in memory, as far as they lie within it.
    pub(super) fn with(&self, ranges: &[Range<u64>]) -> io::Result<Self> {
        let size = self.found.size;
        // A damaged footer may name any range; the reader then finds the end of the file and
        // reports it.
        let ends = ranges.iter().map(|range| range.start.min(size)..range.end.min(size));
        let mut ranges: Vec<Range<u64>> = ends.filter(|range| !range.is_empty()).collect();
        ranges.sort_unstable_by_key(|range| range.start);
        let bytes = self.fetch(ranges.clone())?;
        let known = ranges.iter().map(|range| range.start).zip(bytes).collect();
        Ok(Self { known, ..self.clone() })
    }

    pub(super) fn bytes(&self, range: Range<u64>) -> io::Result<Bytes> {
        // A range that runs past the one in memory is fetched anew as a whole.
        if let Some(bytes) = self.known_from(range.start)
            && let Ok(length) = usize::try_from(range.end - range.start)
            && length <= bytes.len()
        {
            return Ok(bytes.slice(..length));
        }
        if range.is_empty() {
            return Ok(Bytes::new());
        }
        if range.end > self.found.size {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let mut found = self.fetch(vec![range])?;
        found.pop().ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
    }

    /// Reads from memory to the end of the range at hand, or else from the store.
    pub(super) fn read_from(&self, start: u64) -> Reader {
        if let Some(bytes) = self.known_from(start) {
            return Box::new(bytes.reader());
        }
        Box::new(Windows { object: self.clone(), bytes: Bytes::new(), at: start, length: FIRST })
    }

    /// Bytes in memory from byte `start` onwards.
    fn known_from(&self, start: u64) -> Option<Bytes> {
        let after = self.known.partition_point(|(first, _)| *first <= start);
        let (first, bytes) = self.known.get(after.checked_sub(1)?)?;
        let skip = usize::try_from(start - first).ok()?;
        (skip < bytes.len()).then(|| bytes.slice(skip..))
    }

    /// Fetches ranges; adjacent ones share a request.
    fn fetch(&self, ranges: Vec<Range<u64>>) -> io::Result<Vec<Bytes>> {
        let (store, found) = (self.store.clone(), self.found.clone());
        wait(async move {
            let fetch = |range| fetch(store.clone(), found.clone(), range);
            coalesce_ranges(&ranges, fetch, 0).await
        })
    }
}

async fn fetch(
    store: Arc<dyn ObjectStore>,
    opened: ObjectMeta,
    range: Range<u64>,
) -> io::Result<Bytes> {
    let length = range.end - range.start;
    let options = GetOptions {
        range: Some(GetRange::Bounded(range)),
        if_match: opened.e_tag.clone(),
        ..GetOptions::default()
    };
    let found = match store.get_opts(&opened.location, options).await {
        Err(Error::Precondition { .. }) => return Err(io::Error::other(Replaced)),
        found => found?,
    };
    // Not every store supports conditions or tags, so also compare what the answer says about
    // itself.
    let stamp = |of: &ObjectMeta| (of.size, of.last_modified, of.e_tag.clone());
    if stamp(&found.meta) != stamp(&opened) {
        return Err(io::Error::other(Replaced));
    }
    let bytes = found.bytes().await?;
    // A connection that broke off must not pass for a short object.
    if bytes.len() as u64 == length { Ok(bytes) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}

/// Reads an object from a given byte, some megabytes at a time.
struct Windows {
    object: Object,
    bytes: Bytes,
    /// First byte of the object after those at hand.
    at: u64,
    length: u64,
}

impl Read for Windows {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.bytes.is_empty() {
            let end = self.object.len().min(self.at + self.length);
            if self.at >= end {
                return Ok(0);
            }
            self.bytes = self.object.bytes(self.at..end)?;
            self.at = end;
            // Growing windows: cheap for a header, few requests for a whole file.
            self.length = (self.length * 4).min(MOST);
        }
        let count = buffer.len().min(self.bytes.len());
        self.bytes.copy_to_slice(&mut buffer[..count]);
        Ok(count)
    }
}

/// Lists the objects of a URL.
pub(super) fn list(url: &Path) -> Outcome<Listed> {
    let wrong = FleetError::file(url);
    let (store, location) = resolve(url)?;
    let is_prefix = url.as_os_str().as_encoded_bytes().ends_with(b"/");
    // Without a trailing slash, an object of that very name comes first; otherwise the name is a
    // prefix.
    if !is_prefix {
        let (store, location) = (store.clone(), location.clone());
        let head = wait(async move {
            match store.head(&location).await {
                Err(Error::NotFound { .. }) => Ok(false),
                found => Ok(found.map(|_| true)?),
            }
        });
        if head.map_err(&wrong)? {
            return Ok(Listed::One(url.to_owned()));
        }
    }
    let prefix = location.clone();
    let found = wait(async move {
        let all = store.list(Some(&prefix)).map_ok(|found| found.location);
        Ok(all.try_collect::<Vec<Location>>().await?)
    });
    let mut objects = Vec::new();
    for object in found.map_err(&wrong)? {
        let Some(parts) = object.prefix_match(&location) else { continue };
        let parts: Vec<_> = parts.map(|part| part.as_ref().to_owned()).collect();
        // An object without parts is the marker of an empty folder.
        if parts.is_empty() || parts.iter().any(|part| is_hidden(part)) {
            continue;
        }
        // Segments are encoded as the URL needs it, so that `resolve` gets back the same location.
        let mut name = parse(url)?;
        if let Ok(mut segments) = name.path_segments_mut() {
            segments.pop_if_empty().extend(&parts);
        }
        objects.push((PathBuf::from(name.as_str()), parts.iter().collect::<PathBuf>()));
    }
    objects.sort_unstable_by(|a, b| a.1.cmp(&b.1));
    Ok(Listed::Folder(objects, on_disk(url)))
}

pub(super) fn on_disk(url: &Path) -> Option<PathBuf> {
    let name = parse(url).ok()?;
    (name.scheme() == "file").then(|| name.to_file_path().ok()).flatten()
}

fn parse(url: &Path) -> Outcome<Url> {
    let text = url.to_str().unwrap_or_default();
    Url::parse(text).map_err(|error| FleetError::format(url, format!("is not a URL: {error}")))
}

fn resolve(url: &Path) -> Outcome<(Arc<dyn ObjectStore>, Location)> {
    let unknown = |error: Error| {
        let message = format!(
            "no store for this URL ({error}); expected s3://, gs://, az://, abfss://, https://, \
             file:// or memory://, and the settings that the store needs"
        );
        FleetError::format(url, message)
    };
    let (store, location) = STORES.resolve(&parse(url)?).map_err(unknown)?;
    // Decodes the URL: `%20` is a space.
    let location =
        Location::from_url_path(location.as_ref()).map_err(|error| unknown(error.into()))?;
    Ok((store, location))
}

/// Waits for the result of a request, wherever the caller is.
fn wait<T: Send + 'static>(
    request: impl Future<Output = io::Result<T>> + Send + 'static,
) -> io::Result<T> {
    let runtime = RUNTIME.as_ref().map_err(|error| io::Error::other(error.to_string()))?;
    // Not `block_on`, which panics inside another runtime (that of a query, say). This blocks a
    // thread of that runtime instead.
    let (sender, receiver) = sync_channel(1);
    runtime.spawn(async move {
        // The receiver is waiting below.
        _ = sender.send(request.await);
    });
    receiver.recv().unwrap_or_else(|_| Err(io::Error::other("a request to a store has panicked")))
}
