//! What was left out of a map.

use std::fmt;

use super::Road;

/// What [`RoadMap::cleaned`](super::RoadMap::cleaned) left out, in the order in
/// which it was given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CleaningReport {
    pub(super) places: usize,
    pub(super) roads: usize,
    pub(super) repeated: Vec<DroppedPlace>,
    pub(super) parallel: Vec<DroppedRoad>,
    pub(super) loops: Vec<DroppedRoad>,
}

/// A place that was given before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DroppedPlace {
    /// Its number among the places given, from 0.
    pub index: usize,
    /// Its id.
    pub id: u64,
}

/// A road that the map does not have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DroppedRoad {
    /// Its number among the roads given, from 0.
    pub index: usize,
    /// The road.
    pub road: Road,
}

impl CleaningReport {
    /// The number of places given, dropped ones included.
    #[must_use]
    pub fn places_given(&self) -> usize {
        self.places
    }

    /// The number of roads given, dropped ones included.
    #[must_use]
    pub fn roads_given(&self) -> usize {
        self.roads
    }

    /// Places with the id and the position of an earlier one, which the map has.
    #[must_use]
    pub fn repeated_places(&self) -> &[DroppedPlace] {
        &self.repeated
    }

    /// Roads beside a shorter one between the same places in the same direction,
    /// or beside an earlier one that is as long.
    #[must_use]
    pub fn parallel_roads(&self) -> &[DroppedRoad] {
        &self.parallel
    }

    /// Roads from a place to itself.
    #[must_use]
    pub fn loops(&self) -> &[DroppedRoad] {
        &self.loops
    }

    /// True if nothing was dropped.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.repeated.is_empty() && self.parallel.is_empty() && self.loops.is_empty()
    }
}

/// The counts in one line.
impl fmt::Display for CleaningReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "dropped {} of {} places (repeated) and {} of {} roads ({} parallel, {} loops)",
            self.repeated.len(),
            self.places,
            self.parallel.len() + self.loops.len(),
            self.roads,
            self.parallel.len(),
            self.loops.len()
        )
    }
}
