//! Compressed adjacency lists, the base of all searches on a map.

use std::ops::Range;

/// For each place, the places at the other ends of its roads.
#[derive(Debug, Clone)]
pub(super) struct Adjacency {
    starts: Vec<usize>,
    ends: Vec<u32>,
}

impl Adjacency {
    /// Creates lists from sorted pairs [place, other end].
    pub(super) fn new(places: usize, pairs: &[[u32; 2]]) -> Self {
        let starts = (0..=places).map(|i| pairs.partition_point(|pair| (pair[0] as usize) < i));
        Self { starts: starts.collect(), ends: pairs.iter().map(|pair| pair[1]).collect() }
    }

    /// Range of the roads of a place; empty if it does not exist.
    pub(super) fn range(&self, place: usize) -> Range<usize> {
        match self.starts.get(place..place.saturating_add(2)) {
            Some(bounds) => bounds[0]..bounds[1],
            None => 0..0,
        }
    }

    pub(super) fn of(&self, place: usize) -> &[u32] {
        &self.ends[self.range(place)]
    }
}
