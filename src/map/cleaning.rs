//! Report of the places and roads dropped from a map.

use std::fmt;

use super::Road;

/// Places and roads that [`RoadMap::cleaned`](super::RoadMap::cleaned) dropped, in the order in
/// which they were given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CleaningReport {
    pub(super) places: usize,
    pub(super) roads: usize,
    pub(super) repeated: Vec<DroppedPlace>,
    pub(super) parallel: Vec<DroppedRoad>,
    pub(super) loops: Vec<DroppedRoad>,
}

/// A place dropped because an earlier one has the same id and position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DroppedPlace {
    /// Index among the places given, from 0.
    pub index: usize,
    /// Id of the place.
    pub id: u64,
}

/// A road dropped as parallel to another one or as a loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DroppedRoad {
    /// Index among the roads given, from 0.
    pub index: usize,
    /// The road as given.
    pub road: Road,
}

impl CleaningReport {
    /// Number of places given, including dropped ones.
    #[must_use]
    pub fn places_given(&self) -> usize {
        self.places
    }

    /// Number of roads given, including dropped ones.
    #[must_use]
    pub fn roads_given(&self) -> usize {
        self.roads
    }

    /// Places dropped because an earlier place has the same id and position.
    #[must_use]
    pub fn repeated_places(&self) -> &[DroppedPlace] {
        &self.repeated
    }

    /// Roads dropped because one between the same places in the same direction is shorter, or as
    /// long and earlier.
    #[must_use]
    pub fn parallel_roads(&self) -> &[DroppedRoad] {
        &self.parallel
    }

    /// Roads dropped because they lead from a place to itself.
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

/// Prints the counts in one line.
impl fmt::Display for CleaningReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "dropped {} of {} places (repeated) and {} of {} roads (parallel: {}, loops: {})",
            self.repeated.len(),
            self.places,
            self.parallel.len() + self.loops.len(),
            self.roads,
            self.parallel.len(),
            self.loops.len()
        )
    }
}
