//! States of the vehicles of a shard: the most recently updated in memory, the others on disk.

use std::sync::Arc;

use wayfix::inference::FilterSnapshot;
use wayfix::{Filter, Hmm, Likelihood, Transition};

use super::{Entry, NONE, Place, Shard, bytes_of};
use crate::error::{FleetError, Outcome};

impl Shard {
    /// Stores the state of a filter as that of a vehicle.
    pub(super) fn store<A, B>(&mut self, at: u32, time: i64, filter: &Filter<Arc<Hmm<A, B>>>)
    where
        A: Transition,
        B: Likelihood,
    {
        self.keep(at);
        // Reuses the allocation. Its size may change, if logarithms come or go.
        if let Place::Memory(state) = &mut self.entries[at as usize].place {
            self.heap -= bytes_of(state);
            filter.snapshot_to(state);
            self.heap += bytes_of(state);
            self.unlink(at);
        } else {
            self.clear(at);
            let state = Box::new(filter.snapshot());
            self.heap += bytes_of(&state);
            self.in_memory += 1;
            self.entries[at as usize].place = Place::Memory(state);
        }
        self.entries[at as usize].time = time;
        self.link(at);
    }

    /// Drops the state of a vehicle.
    pub(super) fn clear(&mut self, at: u32) {
        if let Place::Memory(_) = &self.entries[at as usize].place {
            self.unlink(at);
        }
        match std::mem::replace(&mut self.entries[at as usize].place, Place::Free) {
            Place::Memory(state) => {
                self.heap -= bytes_of(&state);
                self.in_memory -= 1;
            }
            Place::Disk(slot) => {
                if let Some(disk) = &mut self.disk {
                    disk.release(slot);
                }
            }
            Place::Free => {}
        }
    }

    /// Brings the state of a vehicle into memory.
    pub(super) fn load(&mut self, at: u32) -> Outcome<&FilterSnapshot> {
        if let Place::Disk(slot) = self.entries[at as usize].place
            && let Some(disk) = &mut self.disk
        {
            let state = Box::new(disk.get(slot)?);
            disk.release(slot);
            self.heap += bytes_of(&state);
            self.in_memory += 1;
            self.entries[at as usize].place = Place::Memory(state);
            // Linked as the newest: the state is about to be updated, and must not be the next to
            // be evicted.
            self.link(at);
        }
        match &self.entries[at as usize].place {
            Place::Memory(state) => Ok(state),
            _ => Err(FleetError::Settings("the vehicle has no state".to_owned())),
        }
    }

    /// Moves the least recently updated states to disk until the rest is within the limit, or only
    /// one is left.
    pub(crate) fn evict(&mut self) {
        let Some(disk) = &mut self.disk else { return };
        while self.in_memory > 1 {
            // The same as `self.bytes()`, whose borrow of all of `self` would conflict with that of
            // `disk`.
            let bytes = self.entries.capacity() * size_of::<Entry>()
                + self.free.capacity() * size_of::<u32>()
                + self.index.allocation_size()
                + self.heap
                + disk.bytes();
            if bytes <= self.limit {
                return;
            }
            let at = self.oldest;
            let Place::Memory(state) = &self.entries[at as usize].place else { return };
            match disk.put(state) {
                Ok(slot) => {
                    self.heap -= bytes_of(state);
                    self.in_memory -= 1;
                    self.entries[at as usize].place = Place::Disk(slot);
                    // `in_memory` was above 1, so the oldest has a newer neighbour.
                    let newer = self.entries[at as usize].newer;
                    self.oldest = newer;
                    self.entries[newer as usize].older = NONE;
                }
                Err(error) => {
                    // The state stays in memory. Trying others would most likely fail the same way.
                    self.failure.get_or_insert(error);
                    return;
                }
            }
        }
    }

    /// Appends a vehicle to the list, as the newest.
    pub(super) fn link(&mut self, at: u32) {
        let newest = self.newest;
        let entry = &mut self.entries[at as usize];
        (entry.newer, entry.older) = (NONE, newest);
        if newest == NONE {
            self.oldest = at;
        } else {
            self.entries[newest as usize].newer = at;
        }
        self.newest = at;
    }

    /// Takes a vehicle out of the list.
    fn unlink(&mut self, at: u32) {
        let Entry { newer, older, .. } = self.entries[at as usize];
        match newer {
            NONE => self.newest = older,
            _ => self.entries[newer as usize].older = older,
        }
        match older {
            NONE => self.oldest = newer,
            _ => self.entries[older as usize].newer = newer,
        }
    }
}
