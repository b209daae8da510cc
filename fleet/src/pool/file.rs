//! Snapshots of a pool: a file with the states of all vehicles.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `wayfixpl` |
//! | 4, 4 | version, 2; length of the hash of the model |
//! | 8, 8 | number of states of the model; number of vehicles |
//! | 8 | length of the note (none in version 1) |
//! | | the hash of the model; the note, for the writer's own use |
//! | 8 | checksum of all of the above |
//!
//! Then come blocks: the number of vehicles (4 bytes), the number of bytes of their encoding (8),
//! these bytes, and a checksum (8) that also depends on the number of the block. The last block is
//! empty. A vehicle is a byte, 0 for a number of 8 bytes or 1 for a text with its length (4); its
//! time (8); and the length (4) and bytes of its state, as
//! [`FilterSnapshot::to_bytes`](wayfix::inference::FilterSnapshot::to_bytes) gives them. Numbers
//! are little-endian; checksums are XXH3 of 64 bits.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::Arc;

use twox_hash::XxHash3_64;
use wayfix::inference::FilterSnapshot;
use wayfix::{Hmm, Likelihood, Transition};

use super::block::{Block, Fields, Source};
use super::{LONGEST_HASH, Pool, PoolOptions, lock};
use crate::error::{FleetError, Outcome};
use crate::overwrite::beside;
use crate::pipeline::in_order;

const MAGIC: &[u8; 8] = b"wayfixpl";
const VERSION: u32 = 2;
/// The version without notes, which can still be read.
const WITHOUT_NOTE: u32 = 1;
/// Approximate bytes of states in a block.
pub(super) const BLOCK: usize = 1 << 20;
/// Blocks in flight per thread.
const AHEAD: usize = 3;

impl<A, B> Pool<A, B>
where
    A: Transition + Send + Sync,
    B: Likelihood + Send + Sync,
{
    /// Writes the states of all vehicles to a file, which gets its name once it is complete and on
    /// disk. Returns its length in bytes.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if the file cannot be written, or a state cannot be read back; an existing
    /// file of that name is then unchanged.
    pub fn snapshot(&self, path: &Path) -> Outcome<u64> {
        self.snapshot_with(path, &[])
    }

    /// The same, with a note.
    pub(super) fn snapshot_with(&self, path: &Path, note: &[u8]) -> Outcome<u64> {
        named(path, |partial| self.write(partial, note))
    }

    fn write(&self, path: &Path, note: &[u8]) -> Outcome<u64> {
        let wrong = FleetError::file(path);
        let mut file = File::create(path).map_err(&wrong)?;
        let header = self.header(note);
        file.write_all(&header).map_err(&wrong)?;
        let mut length = header.len() as u64;
        let threads = self.filters.len();
        let ranges = self.shards.iter().flat_map(|shard| {
            let entries = lock(shard).entries();
            // A vehicle takes 8 bytes or more for each state of the model, and about 64 for the id
            // and the rest.
            let each = (BLOCK / (8 * self.model.states() + 64)).max(1);
            (0..entries).step_by(each).map(move |first| (shard, first..entries.min(first + each)))
        });
        let mut blocks = 0;
        // Encoding runs in parallel, writing in order: block numbers are part of the checksums.
        let mut put = |mut block: Block| -> Outcome<()> {
            let bytes = block.seal(blocks);
            blocks += 1;
            file.write_all(bytes).map_err(&wrong)?;
            length += bytes.len() as u64;
            Ok(())
        };
        let encode = |(shard, range): (&std::sync::Mutex<super::Shard>, std::ops::Range<usize>)| {
            let mut block = Block::new();
            let mut shard = lock(shard);
            for at in range {
                shard.write(at, &mut block)?;
            }
            Ok(block)
        };
        in_order(ranges.map(Ok), threads, AHEAD, encode, |block: Outcome<Block>| {
            // A block of free entries only is left out: an empty block would mark the end.
            block.and_then(|block| if block.vehicles == 0 { Ok(()) } else { put(block) })
        })?;
        put(Block::new())?;
        file.sync_all().map_err(&wrong)?;
        Ok(length)
    }

    pub(super) fn header(&self, note: &[u8]) -> Vec<u8> {
        let mut header = MAGIC.to_vec();
        header.extend(VERSION.to_le_bytes());
        header.extend((self.hash.len() as u32).to_le_bytes());
        header.extend((self.model.states() as u64).to_le_bytes());
        header.extend((self.usage().vehicles as u64).to_le_bytes());
        header.extend((note.len() as u64).to_le_bytes());
        header.extend(self.hash.as_bytes());
        header.extend(note);
        header.extend(XxHash3_64::oneshot(&header).to_le_bytes());
        header
    }

    /// Creates a pool with the vehicles of a [snapshot](Self::snapshot). It continues as the
    /// original would have, to the bit.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if the file cannot be read, is damaged, or is not a snapshot of a pool with
    /// this model; and as [`new`](Self::new).
    pub fn restore(
        path: &Path,
        model: Arc<Hmm<A, B>>,
        hash: impl Into<String>,
        options: &PoolOptions,
    ) -> Outcome<Self> {
        let mut pool = Self::new(model, hash, options)?;
        pool.read(path)?;
        // A vehicle that does not fit into memory and cannot be moved to disk is an error here,
        // while the caller can still choose another folder.
        match pool.take_spill_error() {
            Some(error) => Err(error),
            None => Ok(pool),
        }
    }

    fn read(&self, path: &Path) -> Outcome<()> {
        let mut source = Source::open(path)?;
        let expected = self.read_header(&mut source)?;
        let mut number = 0;
        // Also true after an error, which ends the blocks.
        let mut is_last = false;
        let blocks = std::iter::from_fn(|| {
            if is_last {
                return None;
            }
            let block = source.block(number);
            number += 1;
            match block {
                Ok(block) => {
                    is_last = block.vehicles == 0;
                    (!is_last).then_some(Ok(block))
                }
                Err(error) => {
                    is_last = true;
                    Some(Err(error))
                }
            }
        });
        let mut vehicles = 0;
        let take = |block: Block| self.take(path, &block);
        in_order(blocks, self.filters.len(), AHEAD, take, |taken: Outcome<u64>| {
            vehicles += taken?;
            Ok(())
        })?;
        // Each block is intact, but are these all?
        if vehicles != expected {
            let message = format!("damaged: {vehicles} vehicles, expected {expected}");
            return Err(FleetError::format(path, message));
        }
        if source.left > 0 {
            let message = format!("damaged: {} bytes after the end", source.left);
            return Err(FleetError::format(path, message));
        }
        Ok(())
    }

    /// Reads the header, and returns the number of vehicles.
    fn read_header(&self, source: &mut Source<'_>) -> Outcome<u64> {
        let Header { states, vehicles, hash, .. } = Header::read(source)?;
        if hash != self.hash.as_bytes() || states != self.model.states() as u64 {
            let message = format!(
                "a snapshot with another model: {states} states and hash {}, expected {} and {}",
                String::from_utf8_lossy(&hash),
                self.model.states(),
                self.hash
            );
            return Err(FleetError::format(source.path, message));
        }
        Ok(vehicles)
    }

    /// Adds the vehicles of a block to the pool, and returns their number.
    fn take(&self, path: &Path, block: &Block) -> Outcome<u64> {
        let damaged = |message: &dyn std::fmt::Display| {
            FleetError::format(path, format!("damaged: {message}"))
        };
        let mut fields = Fields { bytes: &block.bytes };
        for _ in 0..block.vehicles {
            let (vehicle, time, bytes) =
                fields.vehicle().ok_or_else(|| damaged(&"a vehicle is cut off"))?;
            let state = FilterSnapshot::from_bytes(bytes).map_err(|error| damaged(&error))?;
            let (found, expected) = (state.belief().states(), self.model.states());
            if found != expected {
                let message = format!("vehicle {vehicle} has {found} states, expected {expected}");
                return Err(damaged(&message));
            }
            let (hash, shard) = self.place(&vehicle);
            let mut shard = lock(&self.shards[shard]);
            if shard.find(hash, &vehicle).is_some() {
                return Err(damaged(&format!("vehicle {vehicle} occurs twice")));
            }
            shard.add(hash, vehicle, time, Box::new(state));
            // Evicted at once, so that restoring a pool takes no more memory than the pool is
            // allowed.
            shard.evict();
        }
        if !fields.bytes.is_empty() {
            return Err(damaged(&"a block has more bytes than its vehicles"));
        }
        Ok(u64::from(block.vehicles))
    }
}

/// Returns an error if writing a snapshot would replace a file that is not one.
pub(super) fn check_replaced(path: &Path) -> Outcome<()> {
    let refused =
        |what| Err(FleetError::format(path, format!("{what}: no snapshot is written there")));
    match File::open(path) {
        Ok(file) => {
            if !file.metadata().map_err(FleetError::file(path))?.is_file() {
                return refused("is not a regular file");
            }
            let mut magic = Vec::new();
            let read = file.take(MAGIC.len() as u64).read_to_end(&mut magic);
            read.map_err(FleetError::file(path))?;
            if magic == MAGIC { Ok(()) } else { refused("is not a snapshot") }
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(FleetError::file(path)(error)),
    }
}

/// Header of a snapshot.
pub(super) struct Header {
    states: u64,
    vehicles: u64,
    hash: Vec<u8>,
    pub(super) note: Vec<u8>,
}

impl Header {
    pub(super) fn read(source: &mut Source<'_>) -> Outcome<Self> {
        let path = source.path;
        let other = |message: String| FleetError::format(path, message);
        let mut header = source.bytes(MAGIC.len() as u64)?;
        if header != MAGIC {
            return Err(other("not a snapshot of a pool".to_owned()));
        }
        header.extend(source.bytes(24)?);
        let mut fields = Fields { bytes: &header[MAGIC.len()..] };
        let damaged = || other("damaged: the header is cut off".to_owned());
        let version = fields.u32().ok_or_else(damaged)?;
        if version != VERSION && version != WITHOUT_NOTE {
            let message = format!("version {version} of a snapshot, expected {VERSION}");
            return Err(other(message));
        }
        let length = fields.u32().ok_or_else(damaged)?;
        let states = fields.u64().ok_or_else(damaged)?;
        let vehicles = fields.u64().ok_or_else(damaged)?;
        // Lengths come before the checksum that covers them, so bound them before allocating.
        // `Source::bytes` bounds the note by the size of the file.
        if length as usize > LONGEST_HASH {
            return Err(other(format!("damaged: a hash of {length} bytes")));
        }
        let mut of_note = 0;
        if version == VERSION {
            let bytes = source.bytes(8)?;
            of_note = Fields { bytes: &bytes }.u64().ok_or_else(damaged)?;
            header.extend(bytes);
        }
        let hash = source.bytes(u64::from(length))?;
        header.extend(&hash);
        let note = source.bytes(of_note)?;
        header.extend(&note);
        source.check(XxHash3_64::oneshot(&header), "the header")?;
        Ok(Self { states, vehicles, hash, note })
    }
}

/// Writes a file under a temporary name, and renames it when it is complete.
pub(super) fn named(path: &Path, write: impl FnOnce(&Path) -> Outcome<u64>) -> Outcome<u64> {
    let partial = beside(path, ".partial");
    let written = write(&partial).and_then(|length| {
        fs::rename(&partial, path).map_err(FleetError::file(path))?;
        Ok(length)
    });
    if written.is_err() {
        // It may not exist.
        _ = fs::remove_file(&partial);
        return written;
    }
    sync_folder(path);
    written
}

/// Syncs the folder, and with it the new name of the file, where the system allows it.
fn sync_folder(path: &Path) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Ok(folder) = File::open(folder.unwrap_or(Path::new("."))) {
        _ = folder.sync_all();
    }
}
