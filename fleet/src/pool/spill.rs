//! States of vehicles on disk: an extension of memory, not a record. Files are truncated when a
//! pool begins, and removed when it ends.
//!
//! Each shard has two files of fixed-size slots, for beliefs without and with logarithms, so a free
//! slot fits any state of its file and space is never fragmented.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use wayfix::inference::FilterSnapshot;

use crate::error::{FleetError, Outcome};

/// A folder of such files, locked while a pool uses it.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    /// The lock ends when this is closed.
    _lock: File,
}

impl Folder {
    /// Opens a folder, creating it if needed.
    pub(super) fn open(path: &Path) -> Outcome<Arc<Self>> {
        fs::create_dir_all(path).map_err(FleetError::file(path))?;
        let name = path.join("pool.lock");
        let wrong = FleetError::file(&name);
        let mut options = OpenOptions::new();
        let lock = options.write(true).create(true).truncate(false).open(&name).map_err(&wrong)?;
        lock.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => {
                FleetError::Settings(format!("another pool uses the folder {}", path.display()))
            }
            TryLockError::Error(error) => wrong(error),
        })?;
        Ok(Arc::new(Self { path: path.to_owned(), _lock: lock }))
    }
}

/// Place of a state on disk.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slot {
    number: u32,
    length: u32,
    /// True for a state with logarithms.
    large: bool,
}

/// States of a shard on disk.
#[derive(Debug)]
pub(super) struct Disk {
    /// For states without and with logarithms.
    slots: [Slots; 2],
    /// Keeps the lock.
    _folder: Arc<Folder>,
}

/// A file of slots of one size.
#[derive(Debug)]
struct Slots {
    path: PathBuf,
    /// Opened when the first state is written.
    file: Option<File>,
    size: usize,
    /// Number of slots in the file.
    count: u32,
    free: Vec<u32>,
}

impl Disk {
    pub(super) fn new(folder: &Arc<Folder>, shard: usize, states: usize) -> Self {
        // Upper bounds by the documentation of `FilterSnapshot::to_bytes`, with some room.
        let vector = 8 * (states + states.div_ceil(64));
        let slots = |size: usize, ending: &str| Slots {
            path: folder.path.join(format!("shard-{shard}.{ending}")),
            file: None,
            size,
            count: 0,
            free: Vec::new(),
        };
        let slots = [slots(128 + vector, "spill"), slots(128 + 2 * vector, "large")];
        Self { slots, _folder: Arc::clone(folder) }
    }

    /// Bytes of memory for the lists of free slots.
    pub(super) fn bytes(&self) -> usize {
        self.slots.iter().map(|slots| slots.free.capacity() * size_of::<u32>()).sum()
    }

    /// Bytes of the files.
    pub(super) fn file_bytes(&self) -> u64 {
        self.slots.iter().map(|slots| u64::from(slots.count) * slots.size as u64).sum()
    }

    /// Writes a state.
    pub(super) fn put(&mut self, state: &FilterSnapshot) -> Outcome<Slot> {
        let bytes = state.to_bytes();
        let large = bytes.len() > self.slots[0].size;
        let slots = &mut self.slots[usize::from(large)];
        let too_long = || FleetError::format(&slots.path, "a state is too long for the file");
        let length = u32::try_from(bytes.len()).map_err(|_| too_long())?;
        if bytes.len() > slots.size || (slots.free.is_empty() && slots.count == u32::MAX) {
            return Err(too_long());
        }
        let number = slots.free.last().copied().unwrap_or(slots.count);
        slots.at(number)?.write_all(&bytes).map_err(FleetError::file(&slots.path))?;
        // The slot is taken only now, so an error leaves all slots as they were.
        if slots.free.pop().is_none() {
            slots.count += 1;
        }
        Ok(Slot { number, length, large })
    }

    /// Reads a state; its slot stays taken.
    pub(super) fn get(&mut self, slot: Slot) -> Outcome<FilterSnapshot> {
        let slots = &mut self.slots[usize::from(slot.large)];
        let mut bytes = vec![0; slot.length as usize];
        slots.at(slot.number)?.read_exact(&mut bytes).map_err(FleetError::file(&slots.path))?;
        FilterSnapshot::from_bytes(&bytes).map_err(|error| FleetError::format(&slots.path, error))
    }

    /// Frees a slot.
    pub(super) fn release(&mut self, slot: Slot) {
        self.slots[usize::from(slot.large)].free.push(slot.number);
    }
}

impl Slots {
    /// Returns the file, positioned at a slot.
    fn at(&mut self, number: u32) -> Outcome<&File> {
        let wrong = FleetError::file(&self.path);
        if self.file.is_none() {
            let mut options = OpenOptions::new();
            let options = options.read(true).write(true).create(true).truncate(true);
            self.file = Some(options.open(&self.path).map_err(&wrong)?);
        }
        let Some(mut file) = self.file.as_ref() else {
            return Err(FleetError::format(&self.path, "is not open"));
        };
        let offset = u64::from(number) * self.size as u64;
        file.seek(SeekFrom::Start(offset)).map_err(&wrong)?;
        Ok(file)
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        for slots in &mut self.slots {
            if slots.file.take().is_some() {
                // If this fails, the next pool in this folder truncates it.
                _ = fs::remove_file(&slots.path);
            }
        }
    }
}
