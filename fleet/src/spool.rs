//! Files that are written on, and put on the disk meanwhile.

use std::fs::File;
use std::hash::Hasher;
use std::io::{self, Write};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, Length};
use twox_hash::XxHash3_64;

/// File that takes note of what is written, without the first bytes, which it has already.
pub(crate) struct Spool {
    pub(crate) file: File,
    pub(crate) skip: u64,
    pub(crate) hash: XxHash3_64,
}

impl Write for Spool {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.skip > 0 {
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

/// Stands for bytes that are in the file already.
pub(crate) struct Nothing;

impl Length for Nothing {
    fn len(&self) -> u64 {
        u64::MAX
    }
}

impl ChunkReader for Nothing {
    type T = io::Repeat;

    fn get_read(&self, _: u64) -> Result<io::Repeat, ParquetError> {
        Ok(io::repeat(0))
    }

    fn get_bytes(&self, _: u64, _: usize) -> Result<bytes::Bytes, ParquetError> {
        Err(ParquetError::General("bytes that are written are not read".to_owned()))
    }
}

/// Thread that has written parts put on the disk, so that little is left to do at the end.
pub(crate) struct Disk {
    sender: SyncSender<()>,
    thread: JoinHandle<()>,
}

impl Disk {
    pub(crate) fn new(file: &File) -> io::Result<Self> {
        let file = file.try_clone()?;
        let (sender, receiver) = sync_channel(1);
        let thread = thread::spawn(move || {
            while receiver.recv().is_ok() {
                // An error comes back when the file is finished.
                _ = file.sync_data();
            }
        });
        Ok(Self { sender, thread })
    }

    pub(crate) fn push(&self) {
        // The thread may still be busy, and takes the new part along next time.
        _ = self.sender.try_send(());
    }

    pub(crate) fn end(self) {
        drop(self.sender);
        _ = self.thread.join();
    }
}
