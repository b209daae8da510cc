//! Snapshots written in the background while updates go on.
//!
//! Beginning one takes a cut through every shard, in O(entries / 64); the thread then copies a few
//! states at a time under the lock of a shard and encodes them without it.
//! [`shard::cut`](super::shard) explains why all states are of one moment.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use wayfix::{Likelihood, Transition};

use super::block::Block;
use super::file::{BLOCK, named};
use super::{Pool, Shard, lock};
use crate::error::{FleetError, Outcome};

/// Approximate bytes copied while a shard is locked.
const SLICE: usize = 1 << 15;
/// Bytes after which the file is synced. A single sync at the end would hold up all other writers
/// to that disk, the answers among them.
const SYNC: usize = 16 << 20;

/// A snapshot being written on a thread of its own.
#[derive(Debug)]
pub struct Writing {
    thread: JoinHandle<Outcome<u64>>,
}

impl Writing {
    /// True if the file is complete, or writing it failed.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits for the file, and returns its length in bytes.
    ///
    /// # Errors
    ///
    /// As [`Pool::snapshot`].
    pub fn wait(self) -> Outcome<u64> {
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

impl<A, B> Pool<A, B>
where
    A: Transition + Send + Sync,
    B: Likelihood + Send + Sync,
{
    /// Begins a snapshot of all vehicles as they are now, and returns at once; updates go on while
    /// it is written. Vehicles that change before they are written are encoded first and kept in
    /// memory until they are.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if another snapshot is under way.
    pub fn begin_snapshot(&mut self, path: &Path) -> Outcome<Writing> {
        self.begin_snapshot_with(path, &[], || Ok(()))
    }

    /// The same with a note, and with something to do before the file is renamed.
    pub(super) fn begin_snapshot_with(
        &mut self,
        path: &Path,
        note: &[u8],
        before: impl FnOnce() -> Outcome<()> + Send + 'static,
    ) -> Outcome<Writing> {
        // The thread of a previous snapshot holds the shards until it ends. A second cut would
        // overwrite the first.
        if Arc::strong_count(&self.shards) > 1 {
            return Err(FleetError::Settings("another snapshot is under way".to_owned()));
        }
        // `&mut self`: no update runs between the cuts of two shards, so all are of the same
        // moment.
        self.shards.iter().for_each(|shard| lock(shard).begin_cut());
        let shards = Arc::clone(&self.shards);
        let (path, header) = (path.to_owned(), self.header(note));
        let count = (SLICE / (8 * self.model.states() + 64)).max(1);
        let thread = thread::spawn(move || {
            let written = named(&path, |partial| {
                let length = write(&shards, partial, &header, count)?;
                before()?;
                Ok(length)
            });
            if written.is_err() {
                // Otherwise updates would keep saving entries for nobody.
                shards.iter().for_each(|shard| lock(shard).end_cut());
            }
            written
        });
        Ok(Writing { thread })
    }
}

/// Writes the shards in small slices, round robin, so that no shard saves changed entries for long.
fn write(shards: &[Mutex<Shard>], path: &Path, header: &[u8], count: usize) -> Outcome<u64> {
    let wrong = FleetError::file(path);
    let mut file = File::create(path).map_err(&wrong)?;
    let (mut length, mut unsynced) = (0, 0);
    let mut put = |bytes: &[u8]| -> io::Result<()> {
        length += bytes.len() as u64;
        unsynced += bytes.len();
        file.write_all(bytes)?;
        if unsynced > SYNC {
            unsynced = 0;
            file.sync_data()?;
        }
        Ok(())
    };
    put(header).map_err(&wrong)?;
    let (mut block, mut blocks) = (Block::new(), 0);
    let mut left: Vec<&Mutex<Shard>> = shards.iter().collect();
    while !left.is_empty() {
        let mut open = Vec::with_capacity(left.len());
        for shard in left {
            let part = lock(shard).next_of_cut(count)?;
            block.append(&part.early);
            part.next.iter().for_each(|(vehicle, time, state)| block.push(vehicle, *time, state));
            if block.length() >= BLOCK {
                put(block.seal(blocks)).map_err(&wrong)?;
                (block, blocks) = (Block::new(), blocks + 1);
            }
            if !part.is_last {
                open.push(shard);
            }
        }
        left = open;
    }
    // An empty block marks the end.
    if block.vehicles > 0 {
        put(block.seal(blocks)).map_err(&wrong)?;
        blocks += 1;
    }
    put(Block::new().seal(blocks)).map_err(&wrong)?;
    file.sync_all().map_err(&wrong)?;
    Ok(length)
}
