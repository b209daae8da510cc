//! A part of the vehicles of a pool, which one thread works on at a time.
//!
//! Vehicles are entries of one vector, found by a hash table of indices. Entries whose state is in
//! memory form a doubly linked list by their last update, so the state to move to disk next is
//! found in O(1). Invariants: an entry is free exactly if its place is `Free`, and then its index
//! is in `free` and not in the table; it is in the list exactly if its place is `Memory`.

mod cut;
mod states;
mod step;

use std::hash::{BuildHasher, RandomState};
use std::hint::black_box;

use hashbrown::HashTable;
use wayfix::inference::FilterSnapshot;

use super::block::Block;
use super::spill::{Disk, Slot};
use super::vehicle::VehicleId;
use crate::error::{FleetError, Outcome};
use cut::Cut;

/// Numbers in a cache line.
const LINE: usize = 8;
/// End of the list.
const NONE: u32 = u32::MAX;
/// Approximate overhead of an allocation.
const ALLOCATION: usize = 16;

/// A vehicle, or a free entry.
#[derive(Debug)]
pub(super) struct Entry {
    pub(super) vehicle: VehicleId,
    pub(super) time: i64,
    /// Neighbours in the list of entries in memory, by last update.
    newer: u32,
    older: u32,
    place: Place,
}

/// Place of the state of a vehicle.
#[derive(Debug)]
enum Place {
    Memory(Box<FilterSnapshot>),
    Disk(Slot),
    /// The entry is free.
    Free,
}

/// A part of the vehicles of a pool.
#[derive(Debug)]
pub(super) struct Shard {
    hasher: RandomState,
    /// Entries by the hash of the id.
    index: HashTable<u32>,
    entries: Vec<Entry>,
    free: Vec<u32>,
    newest: u32,
    oldest: u32,
    in_memory: usize,
    /// Bytes of states and texts on the heap.
    heap: usize,
    limit: usize,
    disk: Option<Disk>,
    /// Progress of a snapshot being taken.
    cut: Option<Box<Cut>>,
    /// First failure to move a state to disk.
    pub(super) failure: Option<FleetError>,
}

/// Bytes of a state.
fn bytes_of(state: &FilterSnapshot) -> usize {
    size_of::<FilterSnapshot>() + state.heap_bytes() + 2 * ALLOCATION
}

impl Shard {
    /// Creates an empty shard. With a disk, its memory is limited to about `limit` bytes.
    pub(super) fn new(hasher: RandomState, limit: usize, disk: Option<Disk>) -> Self {
        Self {
            hasher,
            index: HashTable::new(),
            entries: Vec::new(),
            free: Vec::new(),
            newest: NONE,
            oldest: NONE,
            in_memory: 0,
            heap: 0,
            limit,
            disk,
            cut: None,
            failure: None,
        }
    }

    /// Number of vehicles.
    pub(super) fn vehicles(&self) -> usize {
        self.index.len()
    }

    /// Number of entries, free ones included.
    pub(super) fn entries(&self) -> usize {
        self.entries.len()
    }

    /// Time of the last update of a vehicle.
    pub(super) fn time(&self, at: u32) -> i64 {
        self.entries[at as usize].time
    }

    /// Copy of the state of a vehicle.
    pub(super) fn state(&mut self, at: u32) -> Outcome<FilterSnapshot> {
        match (&self.entries[at as usize].place, &mut self.disk) {
            (Place::Memory(state), _) => Ok((**state).clone()),
            (Place::Disk(slot), Some(disk)) => disk.get(*slot),
            _ => Err(FleetError::Settings("the vehicle has no state".to_owned())),
        }
    }

    /// Writes an entry, unless it is free.
    pub(super) fn write(&mut self, at: usize, block: &mut Block) -> Outcome<()> {
        let Entry { vehicle, time, place, .. } = &self.entries[at];
        match (place, &mut self.disk) {
            (Place::Memory(state), _) => block.push(vehicle, *time, state),
            (Place::Disk(slot), Some(disk)) => block.push(vehicle, *time, &disk.get(*slot)?),
            _ => {}
        }
        Ok(())
    }

    /// Number of vehicles whose state is in memory.
    pub(super) fn in_memory(&self) -> usize {
        self.in_memory
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.entries.capacity() * size_of::<Entry>()
            + self.free.capacity() * size_of::<u32>()
            + self.index.allocation_size()
            + self.heap
            + self.disk.as_ref().map_or(0, Disk::bytes)
    }

    /// Bytes on the disk.
    pub(super) fn file_bytes(&self) -> u64 {
        self.disk.as_ref().map_or(0, Disk::file_bytes)
    }

    /// Touches the states that the next updates need, so that the cache misses overlap. Otherwise
    /// an update of one vehicle in millions spends most of its time waiting for memory.
    pub(super) fn warm<'a>(&self, next: impl Iterator<Item = (u64, &'a VehicleId)>) {
        let states = next.filter_map(|(hash, vehicle)| {
            match &self.entries[self.find(hash, vehicle)? as usize].place {
                Place::Memory(state) => Some(state),
                _ => None,
            }
        });
        // One number per cache line; `black_box` keeps the reads from being optimised away.
        let read = states.map(|state| {
            let lines = state.belief().as_slice().iter().step_by(LINE);
            lines.fold(0, |bits, p| bits ^ p.to_bits())
        });
        black_box(read.fold(0, |all, bits| all ^ bits));
    }

    pub(super) fn find(&self, hash: u64, vehicle: &VehicleId) -> Option<u32> {
        self.index.find(hash, |&at| self.entries[at as usize].vehicle == *vehicle).copied()
    }

    /// Adds a vehicle that is not there yet.
    pub(super) fn add(
        &mut self,
        hash: u64,
        vehicle: VehicleId,
        time: i64,
        state: Box<FilterSnapshot>,
    ) {
        self.heap += bytes_of(&state) + text_bytes(&vehicle);
        let place = Place::Memory(state);
        let entry = Entry { vehicle, time, newer: NONE, older: NONE, place };
        let at = if let Some(at) = self.free.pop() {
            // A snapshot under way must not write the new vehicle as if it had been there all
            // along: this marks the entry as done.
            self.keep(at);
            self.entries[at as usize] = entry;
            at
        } else {
            if self.entries.len() == self.entries.capacity() {
                // Grows by an eighth: doubling would leave up to half of the memory unused.
                self.entries.reserve_exact(self.entries.len() / 8 + 16);
            }
            self.entries.push(entry);
            (self.entries.len() - 1) as u32
        };
        let Self { index, entries, hasher, .. } = self;
        index.insert_unique(hash, at, |&at| hasher.hash_one(&entries[at as usize].vehicle));
        self.in_memory += 1;
        self.link(at);
    }

    /// Removes a vehicle. Returns false if it is not there.
    pub(super) fn remove(&mut self, hash: u64, vehicle: &VehicleId) -> bool {
        let Some(at) = self.find(hash, vehicle) else { return false };
        // Before anything changes: the snapshot needs the vehicle as it was.
        self.keep(at);
        let Self { index, entries, .. } = self;
        let same = |at: &u32| entries[*at as usize].vehicle == *vehicle;
        let Ok(found) = index.find_entry(hash, same) else { return false };
        let (at, _) = found.remove();
        self.heap -= text_bytes(vehicle);
        self.clear(at);
        self.entries[at as usize].vehicle = VehicleId::Number(0);
        self.free.push(at);
        true
    }
}

fn text_bytes(vehicle: &VehicleId) -> usize {
    match vehicle {
        VehicleId::Number(_) => 0,
        VehicleId::Text(text) => text.len() + ALLOCATION,
    }
}
