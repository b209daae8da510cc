//! A store in memory that records what is requested.

use std::fmt;
use std::fs;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use async_trait::async_trait;
use futures::stream::BoxStream;
use object_store::memory::InMemory;
use object_store::path::Path;
use object_store::{
    CopyOptions, GetOptions, GetRange, GetResult, ListResult, MultipartUpload, ObjectMeta,
    ObjectStore, ObjectStoreExt, PutMultipartOptions, PutOptions, PutPayload, PutResult, Result,
};
use tokio::runtime::Builder;
use wayfix_fleet::register_store;

use crate::kit::Folder;

type Reads = Mutex<Vec<(String, Range<u64>)>>;

/// A store under a URL of its own.
#[derive(Debug, Clone, Default)]
pub(crate) struct Shelf {
    store: Arc<InMemory>,
    /// Objects and ranges of them that were read.
    pub(crate) read: Arc<Reads>,
    pub(crate) url: String,
}

impl Shelf {
    pub(crate) fn new() -> Self {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let url = format!("memory:///shelf{}/", COUNT.fetch_add(1, Ordering::Relaxed));
        let shelf = Self { url, ..Self::default() };
        register_store(&shelf.url, Arc::new(shelf.clone())).unwrap();
        shelf
    }

    pub(crate) fn put(&self, name: &str, bytes: Vec<u8>) {
        let put = async { self.store.put(&Path::parse(name).unwrap(), bytes.into()).await };
        Builder::new_current_thread().build().unwrap().block_on(put).unwrap();
    }

    /// Puts a file of a folder.
    pub(crate) fn copy(&self, folder: &Folder, name: &str) {
        self.put(name, fs::read(folder.path(name)).unwrap());
    }
}

impl fmt::Display for Shelf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.url)
    }
}

#[async_trait]
impl ObjectStore for Shelf {
    async fn put_opts(&self, at: &Path, bytes: PutPayload, how: PutOptions) -> Result<PutResult> {
        self.store.put_opts(at, bytes, how).await
    }

    async fn put_multipart_opts(
        &self,
        at: &Path,
        how: PutMultipartOptions,
    ) -> Result<Box<dyn MultipartUpload>> {
        self.store.put_multipart_opts(at, how).await
    }

    async fn get_opts(&self, at: &Path, how: GetOptions) -> Result<GetResult> {
        match &how.range {
            Some(GetRange::Bounded(range)) => {
                self.read.lock().unwrap().push((at.to_string(), range.clone()));
            }
            None if how.head => {}
            other => panic!("a request for {other:?}"),
        }
        self.store.get_opts(at, how).await
    }

    fn delete_stream(
        &self,
        all: BoxStream<'static, Result<Path>>,
    ) -> BoxStream<'static, Result<Path>> {
        self.store.delete_stream(all)
    }

    fn list(&self, prefix: Option<&Path>) -> BoxStream<'static, Result<ObjectMeta>> {
        self.store.list(prefix)
    }

    async fn list_with_delimiter(&self, prefix: Option<&Path>) -> Result<ListResult> {
        self.store.list_with_delimiter(prefix).await
    }

    async fn copy_opts(&self, from: &Path, to: &Path, how: CopyOptions) -> Result<()> {
        self.store.copy_opts(from, to, how).await
    }
}
