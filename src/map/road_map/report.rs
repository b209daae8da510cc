//! Report of the places and roads dropped from a map.

use std::fmt;

use super::map::Road;

/// Places and roads that [`RoadMap::cleaned`](super::RoadMap::cleaned) dropped, in the order given,
/// each with its index among those given, from 0.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct CleaningReport {
    /// Number of places given, including dropped ones.
    pub places_given: usize,
    /// Number of roads given, including dropped ones.
    pub roads_given: usize,
    /// Indices and ids of places dropped because an earlier place has the same id and position.
    pub repeated_places: Vec<(usize, u64)>,
    /// Roads dropped because another one between the same places in the same direction is shorter,
    /// or equally long and earlier.
    pub parallel_roads: Vec<(usize, Road)>,
    /// Roads dropped because they lead from a place to itself.
    pub loops: Vec<(usize, Road)>,
}

impl CleaningReport {
    /// True if nothing was dropped.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        let Self { repeated_places, parallel_roads, loops, .. } = self;
        repeated_places.is_empty() && parallel_roads.is_empty() && loops.is_empty()
    }
}

/// Prints the counts in one line.
impl fmt::Display for CleaningReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [repeated, parallel, loops] =
            [self.repeated_places.len(), self.parallel_roads.len(), self.loops.len()];
        write!(
            f,
            "dropped {repeated} of {} places (repeated) and {} of {} roads (parallel: {parallel}, loops: {loops})",
            self.places_given,
            parallel + loops,
            self.roads_given,
        )
    }
}
