//! Queries on the graph: neighbours, hops, metres, connectivity.

use std::collections::VecDeque;

use super::map::RoadMap;
use crate::map::Coordinates;

impl<P> RoadMap<P> {
    /// Places that a road from this place leads to, in ascending order; none if the place does not
    /// exist.
    #[must_use]
    pub fn neighbors(&self, place: usize) -> impl ExactSizeIterator<Item = usize> {
        self.outgoing.of(place).iter().map(|&to| to as usize)
    }

    /// Places joined to this one by a road in either direction, in ascending order; none if the
    /// place does not exist.
    #[must_use]
    pub fn joined(&self, place: usize) -> Vec<usize> {
        let ends = self.outgoing.of(place).iter().chain(self.incoming.of(place));
        let mut ends: Vec<usize> = ends.map(|&end| end as usize).collect();
        ends.sort_unstable();
        ends.dedup();
        ends
    }

    /// Least number of roads from a place to each other place, or `None` for places that cannot
    /// be reached (all, if the place does not exist). O(places + roads).
    #[must_use]
    pub fn hops_from(&self, place: usize) -> Vec<Option<u32>> {
        self.hops(place, |i| self.outgoing.of(i).iter())
    }

    /// Least number of roads between a place and each other place, where roads may be taken in
    /// both directions; otherwise as [`hops_from`](Self::hops_from).
    #[must_use]
    pub fn hops_either_way(&self, place: usize) -> Vec<Option<u32>> {
        self.hops(place, |i| self.outgoing.of(i).iter().chain(self.incoming.of(i)))
    }

    /// Length in metres of the shortest path from a place to each other place, or `None` for
    /// places that cannot be reached (all, if the place does not exist). O((places + roads) log
    /// roads), by Dijkstra (1959).
    #[must_use]
    pub fn road_metres_from(&self, place: usize) -> Vec<Option<f64>> {
        let search = self.search_from(place, None);
        let metres = |to| search.settled(to).map(|label| label.cost);
        (0..self.places().len()).map(metres).collect()
    }

    /// True if every place can be reached from every other. O(places + roads).
    #[must_use]
    pub fn is_strongly_connected(&self) -> bool {
        // If the first place reaches all places, and all reach it, then any place reaches any other
        // by way of it. A map has at least one place.
        let forward = self.hops_from(0);
        let backward = self.hops(0, |i| self.incoming.of(i).iter());
        forward.iter().chain(&backward).all(Option::is_some)
    }

    /// Number of hops from a place to each other place, by breadth-first search.
    fn hops<'a, I: Iterator<Item = &'a u32>>(
        &self,
        place: usize,
        neighbors: impl Fn(usize) -> I,
    ) -> Vec<Option<u32>> {
        let mut hops = vec![None; self.places().len()];
        let Some(start) = hops.get_mut(place) else { return hops };
        *start = Some(0);
        // First in, first out: places are met in the order of their hops, so the first number
        // stays.
        let mut queue = VecDeque::from([(place, 0)]);
        while let Some((i, so_far)) = queue.pop_front() {
            for &next in neighbors(i) {
                if hops[next as usize].is_none() {
                    hops[next as usize] = Some(so_far + 1);
                    queue.push_back((next as usize, so_far + 1));
                }
            }
        }
        hops
    }
}

impl<P: Coordinates> RoadMap<P> {
    /// Straight-line distance between two places in metres, or `None` if one of them does not
    /// exist.
    #[must_use]
    pub fn metres_between(&self, place: usize, other: usize) -> Option<f64> {
        let (a, b) = (self.places().get(place)?, self.places().get(other)?);
        Some(a.position.metres_to(b.position))
    }

    /// Place nearest to a position; of equally near ones, the lowest index. `None` if the
    /// position is NaN. O(places).
    #[must_use]
    pub fn nearest(&self, position: P) -> Option<usize> {
        let metres = self.places().iter().map(|place| place.position.metres_to(position));
        // `min_by` returns the first minimum, which is the lowest index.
        let numbers = metres.enumerate().filter(|(_, metres)| !metres.is_nan());
        numbers.min_by(|a, b| a.1.total_cmp(&b.1)).map(|nearest| nearest.0)
    }
}
