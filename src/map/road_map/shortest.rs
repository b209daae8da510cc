//! Shortest paths, by Dijkstra (1959).

use super::map::RoadMap;
use crate::map::search::Search;

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
    /// Ties go to the path whose second-to-last place has the lowest index, then the place before
    /// it, and so on, as in Viterbi.
    ///
    /// O((places + roads) log roads), and less if the end is near, since no place farther away is
    /// settled. For the lengths of the shortest paths to all places use
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
        let search = self.search_from(from, Some(to));
        let mut label = search.settled(to)?;
        let metres = label.cost;
        let mut places = vec![to];
        while places[places.len() - 1] != from {
            places.push(label.before as usize);
            // Every place on the way was settled before the end was.
            label = search.settled(label.before as usize)?;
        }
        places.reverse();
        Some(RoadPath { places, metres })
    }

    /// Searches for the shortest paths from a place to all others, or to those no farther away than
    /// `end`; to none if the place does not exist.
    pub(super) fn search_from(&self, from: usize, end: Option<usize>) -> Search<()> {
        let mut search = Search::default();
        search.start(self.places().len());
        if from < self.places().len() {
            search.offer((from, from as u32), from, 0.0, (), true);
        }
        while let Some((place, label)) = search.settle()
            && end != Some(place)
        {
            for (to, road) in self.roads_from(place) {
                search.offer((to, to as u32), place, label.cost + road.metres, (), true);
            }
        }
        search
    }
}
