//! Shortest paths, by Dijkstra (1959).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::RoadMap;

/// A path along roads, as [`RoadMap::shortest_path`] returns it.
#[derive(Debug, Clone, PartialEq)]
pub struct RoadPath {
    places: Vec<usize>,
    metres: f64,
}

impl RoadPath {
    /// Indices of the places in the order of the path, including both ends.
    #[must_use]
    pub fn places(&self) -> &[usize] {
        &self.places
    }

    /// Length in metres, the sum of the lengths of the roads.
    #[must_use]
    pub fn metres(&self) -> f64 {
        self.metres
    }
}

impl<P> RoadMap<P> {
    /// Shortest path from one place to another, by the lengths of the roads; `None` if there is
    /// none, or if a place does not exist. The path from a place to itself is that place alone.
    ///
    /// Ties go to the path whose last place but one has the lowest index, then the place before
    /// it, and so on, as in Viterbi.
    ///
    /// O((places + roads) log roads), and less if the end is near, since no place farther away is
    /// visited. For the lengths of the shortest paths to all places use
    /// [`road_metres_from`](Self::road_metres_from).
    ///
    /// ```
    /// use wayfix::map::{Place, PlanePosition, Road, RoadClass, RoadMap};
    ///
    /// let place = |id, x| Place { id, position: PlanePosition { x, y: 0.0 }, name: String::new() };
    /// let road = |from, to, metres| Road { from, to, class: RoadClass::Street, metres };
    /// let aisle = RoadMap::new(
    ///     [place(1, 0.0), place(2, 3.0), place(3, 6.0)],
    ///     [road(1, 2, 3.0), road(2, 3, 3.0), road(1, 3, 8.0)],
    /// )?;
    /// let drive = aisle.shortest_path(0, 2).unwrap();
    /// assert_eq!((drive.places(), drive.metres()), (&[0, 1, 2][..], 6.0));
    /// assert_eq!(aisle.shortest_path(2, 0), None); // one way only
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    #[must_use]
    pub fn shortest_path(&self, from: usize, to: usize) -> Option<RoadPath> {
        let reached = self.reach(from, Some(to));
        let metres = reached.get(to)?.as_ref()?.metres;
        let mut places = vec![to];
        let mut at = to;
        while at != from {
            at = reached[at].as_ref()?.before as usize;
            places.push(at);
        }
        places.reverse();
        Some(RoadPath { places, metres })
    }

    /// Shortest paths from a place to all others. With `end`, the search stops there: places
    /// farther away are missing, or may have a path that is not the shortest.
    pub(super) fn reach(&self, from: usize, end: Option<usize>) -> Vec<Option<Reached>> {
        let mut reached: Vec<Option<Reached>> = vec![None; self.places().len()];
        let Some(start) = reached.get_mut(from) else { return reached };
        *start = Some(Reached { metres: 0.0, before: from as u32, is_settled: false });
        // The bits of non-negative doubles are in the order of the values.
        let mut queue = BinaryHeap::from([Reverse((0.0_f64.to_bits(), from))]);
        while let Some(Reverse((_, i))) = queue.pop() {
            let Some(here @ Reached { is_settled: false, .. }) = &mut reached[i] else { continue };
            here.is_settled = true;
            if end == Some(i) {
                break;
            }
            let so_far = here.metres;
            for (to, road) in self.roads_from(i) {
                let metres = so_far + road.metres;
                let is_better = match &reached[to] {
                    Some(known) if known.is_settled => false,
                    Some(known) => (metres, i as u32) < (known.metres, known.before),
                    None => true,
                };
                if is_better {
                    reached[to] = Some(Reached { metres, before: i as u32, is_settled: false });
                    queue.push(Reverse((metres.to_bits(), to)));
                }
            }
        }
        reached
    }
}

/// A place reached by the search, with the length of the path to it.
#[derive(Debug, Clone)]
pub(super) struct Reached {
    pub(super) metres: f64,
    /// Previous place on the path; the start for the start itself.
    before: u32,
    /// True once the path is known to be shortest.
    is_settled: bool,
}
