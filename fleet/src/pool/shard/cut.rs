//! A snapshot of a shard as it was at one moment, written while updates go on.
//!
//! Copy on write, entry by entry. Entries are written in order; one that is about to change before
//! its turn is written first and marked in `early`. So each entry below `end` is written exactly
//! once, in the state it had at the beginning, and an update waits for the encoding of at most one
//! vehicle.

use std::hash::BuildHasher;

use wayfix::inference::FilterSnapshot;

use super::{Entry, Place, Shard};
use crate::error::{FleetError, Outcome};
use crate::pool::VehicleId;
use crate::pool::block::Block;

/// Progress of the snapshot of a shard.
#[derive(Debug)]
pub(super) struct Cut {
    /// Entries before this one have been written.
    next: usize,
    /// Number of entries at the beginning; later ones are not part of the snapshot.
    end: usize,
    /// One bit per entry, set if it was written before its turn.
    early: Vec<u64>,
    block: Block,
    failure: Option<FleetError>,
}

/// Some entries of a snapshot.
#[derive(Debug)]
pub(crate) struct Part {
    /// Entries that changed before their turn, encoded.
    pub(crate) early: Block,
    /// The next entries in order: id, time and a copy of the state. They are encoded without the
    /// lock, since that takes several times as long as copying.
    pub(crate) next: Vec<(VehicleId, i64, FilterSnapshot)>,
    pub(crate) is_last: bool,
}

impl Cut {
    fn is_early(&self, at: usize) -> bool {
        self.early[at / 64] & 1 << (at % 64) != 0
    }
}

impl Shard {
    /// Begins a snapshot of the shard as it is.
    pub(crate) fn begin_cut(&mut self) {
        let end = self.entries.len();
        let early = vec![0; end.div_ceil(64)];
        self.cut = Some(Box::new(Cut { next: 0, end, early, block: Block::new(), failure: None }));
    }

    /// Abandons the snapshot.
    pub(crate) fn end_cut(&mut self) {
        self.cut = None;
    }

    /// Takes the next `count` entries of the snapshot.
    pub(crate) fn next_of_cut(&mut self, count: usize) -> Outcome<Part> {
        // Taken out, so that `self.state` can be called; put back below unless this was the last
        // part.
        let Some(mut cut) = self.cut.take() else {
            return Ok(Part { early: Block::new(), next: Vec::new(), is_last: true });
        };
        if let Some(error) = cut.failure.take() {
            return Err(error);
        }
        let end = cut.end.min(cut.next + count);
        let mut next = Vec::with_capacity(end - cut.next);
        for at in cut.next..end {
            let Entry { vehicle, time, place, .. } = &self.entries[at];
            if !cut.is_early(at) && !matches!(place, Place::Free) {
                let (vehicle, time) = (vehicle.clone(), *time);
                next.push((vehicle, time, self.state(at as u32)?));
            }
        }
        cut.next = end;
        let early = std::mem::replace(&mut cut.block, Block::new());
        let is_last = end == cut.end;
        if !is_last {
            self.cut = Some(cut);
        }
        Ok(Part { early, next, is_last })
    }

    /// Saves an entry that is about to change, if a snapshot still needs it.
    #[inline]
    pub(super) fn keep(&mut self, at: u32) {
        if self.cut.is_some() {
            self.keep_now(at as usize);
        }
    }

    #[cold]
    fn keep_now(&mut self, at: usize) {
        let Some(mut cut) = self.cut.take() else { return };
        // A free entry is also marked, though nothing is written for it: whatever takes its place
        // is newer than the snapshot.
        if at >= cut.next && at < cut.end && !cut.is_early(at) {
            cut.early[at / 64] |= 1 << (at % 64);
            // The update must not fail because of the snapshot; the next part of the snapshot
            // reports it.
            if let Err(error) = self.write(at, &mut cut.block) {
                cut.failure.get_or_insert(error);
            }
        }
        self.cut = Some(cut);
    }

    /// Removes the vehicles last updated before a time.
    pub(crate) fn forget_before(&mut self, time: i64) {
        for at in 0..self.entries.len() {
            let entry = &self.entries[at];
            if entry.time < time && !matches!(entry.place, Place::Free) {
                let vehicle = entry.vehicle.clone();
                self.remove(self.hasher.hash_one(&vehicle), &vehicle);
            }
        }
    }
}
