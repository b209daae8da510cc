//! Files that are appended to, and synced to disk in the background.

use std::fs::File;
use std::hash::Hasher;
use std::io::{self, Write};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, Length};
use twox_hash::XxHash3_64;

/// Writer that appends to a file and hashes what it writes, and drops the first `skip` bytes, which
/// the file has already.
pub(crate) struct Spool {
    pub(crate) file: File,
    pub(crate) skip: u64,
    pub(crate) hash: XxHash3_64,
}

impl Write for Spool {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.skip > 0 {
            // A short write is allowed: the caller comes back with the rest, which may be past
            // `skip`. Skipped bytes do not enter the hash, which starts anew with each part.
            let skipped = (bytes.len() as u64).min(self.skip);
            self.skip -= skipped;
            return Ok(skipped as usize);
        }
        let written = self.file.write(bytes)?;
        self.hash.write(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Stands in for column chunks that are in the file already.
pub(crate) struct Nothing;

impl Length for Nothing {
    fn len(&self) -> u64 {
        // Any range that the metadata asks for is inside.
        u64::MAX
    }
}

impl ChunkReader for Nothing {
    type T = io::Repeat;

    fn get_read(&self, _: u64) -> Result<io::Repeat, ParquetError> {
        Ok(io::repeat(0))
    }

    fn get_bytes(&self, _: u64, _: usize) -> Result<bytes::Bytes, ParquetError> {
        Err(ParquetError::General("written bytes cannot be read back".to_owned()))
    }
}

/// Thread that syncs written parts, so that little is left to do at the end.
pub(crate) struct Disk {
    sender: SyncSender<()>,
    thread: JoinHandle<()>,
}

impl Disk {
    pub(crate) fn new(file: &File) -> io::Result<Self> {
        let file = file.try_clone()?;
        // One place in the queue: a sync covers all bytes written before it, so one pending request
        // is enough.
        let (sender, receiver) = sync_channel(1);
        let thread = thread::spawn(move || {
            while receiver.recv().is_ok() {
                // An error will come back when the finished file is synced.
                _ = file.sync_data();
            }
        });
        Ok(Self { sender, thread })
    }

    pub(crate) fn push(&self) {
        // If the thread is busy, the pending request also covers the new part.
        _ = self.sender.try_send(());
    }

    pub(crate) fn end(self) {
        drop(self.sender);
        _ = self.thread.join();
    }
}
