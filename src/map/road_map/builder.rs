//! Step-by-step construction of a map, strict or cleaning.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::adjacency::Adjacency;
use super::map::{Road, RoadMap};
use super::report::CleaningReport;
#[cfg(feature = "csv")]
use crate::map::RoadClass;
use crate::map::places::{Place, Places};
use crate::map::{Coordinates, MapError};

/// Builder of a map from places, then roads. Each is checked as it is added, so that a file reader
/// can name its line.
#[derive(Debug)]
pub(super) struct Builder<P> {
    places: Places<P>,
    /// Road kept between two places, with its index in the order given.
    roads: HashMap<[u32; 2], (usize, Road)>,
    report: CleaningReport,
    /// True if repeated places, parallel roads and loops are dropped and reported rather than
    /// errors.
    cleans: bool,
}

impl<P: Coordinates> Builder<P> {
    /// Returns a builder that treats all defects as errors.
    pub(super) fn strict() -> Self {
        let (places, roads) = (Places::default(), HashMap::new());
        Self { places, roads, report: CleaningReport::default(), cleans: false }
    }

    /// Returns a builder that drops repeated places, parallel roads and loops.
    pub(super) fn cleaning() -> Self {
        Self { cleans: true, ..Self::strict() }
    }

    pub(super) fn place(&mut self, place: Place<P>) -> Result<(), MapError> {
        let index = self.report.places_given;
        self.report.places_given += 1;
        let known = self.places.index_of(place.id).map(|known| &self.places.list[known]);
        // The same id at another position is a contradiction, and an error in any case.
        if self.cleans && known.is_some_and(|known| known.position == place.position) {
            self.report.repeated_places.push((index, place.id));
            return Ok(());
        }
        self.places.add(place).map(|_| ())
    }

    /// Adds a road as long as the straight line between its ends.
    #[cfg(feature = "csv")]
    pub(super) fn straight(
        &mut self,
        from: u64,
        to: u64,
        class: RoadClass,
    ) -> Result<(), MapError> {
        let metres = self.places.straight(self.places.ends(from, to)?);
        self.road(Road { from, to, class, metres })
    }

    pub(super) fn road(&mut self, road: Road) -> Result<(), MapError> {
        let Road { from, to, metres, .. } = road;
        let ends = self.places.ends(from, to)?.map(|end| end as u32);
        let given = (self.report.roads_given, road);
        self.report.roads_given += 1;
        // Before the length is checked: a loop is dropped whatever its length.
        if from == to {
            if !self.cleans {
                return Err(MapError::Loop { id: from });
            }
            self.report.loops.push(given);
            return Ok(());
        }
        if !(metres > 0.0 && metres.is_finite()) {
            return Err(MapError::Length { from, to, length: metres });
        }
        match self.roads.entry(ends) {
            Entry::Vacant(vacant) => {
                vacant.insert(given);
            }
            Entry::Occupied(_) if !self.cleans => {
                return Err(MapError::DuplicateRoad { from, to });
            }
            Entry::Occupied(mut kept) => {
                // Strictly: of equally short roads, the first stays.
                let is_shorter = metres < kept.get().1.metres;
                let longer = if is_shorter { kept.insert(given) } else { given };
                self.report.parallel_roads.push(longer);
            }
        }
        Ok(())
    }

    pub(super) fn build(self) -> Result<(RoadMap<P>, CleaningReport), MapError> {
        let Self { places, roads, mut report, .. } = self;
        if places.list.is_empty() {
            return Err(MapError::Empty);
        }
        let mut sorted: Vec<_> = roads.into_iter().map(|(ends, (_, road))| (ends, road)).collect();
        sorted.sort_unstable_by_key(|road| road.0);
        let mut pairs: Vec<[u32; 2]> = sorted.iter().map(|road| road.0).collect();
        // In the order of the roads themselves, so that a road has the same index in both.
        let outgoing = Adjacency::new(places.list.len(), &pairs);
        pairs.iter_mut().for_each(|ends| ends.reverse());
        pairs.sort_unstable();
        let incoming = Adjacency::new(places.list.len(), &pairs);
        let roads = sorted.into_iter().map(|road| road.1).collect();
        // Parallel roads are recorded out of order where a later, shorter one replaced the kept
        // road.
        report.parallel_roads.sort_unstable_by_key(|dropped| dropped.0);
        Ok((RoadMap { places, roads, outgoing, incoming }, report))
    }
}

impl<P: Coordinates> RoadMap<P> {
    /// Creates a map from places and the roads between them, in any order. O((places + roads)
    /// log).
    ///
    /// # Errors
    ///
    /// [`MapError`] for no places, an id given twice, a position that is not on Earth or in the
    /// plane, a road given twice or from a place to itself, a road from or to a place that does not
    /// exist, or a length that is not above 0.
    pub fn new(
        places: impl IntoIterator<Item = Place<P>>,
        roads: impl IntoIterator<Item = Road>,
    ) -> Result<Self, MapError> {
        Self::built(Builder::strict(), places, roads).map(|built| built.0)
    }

    /// Creates a map from raw data, as [`new`](Self::new) does, but drops and reports duplicates
    /// and loops.
    ///
    /// - Of parallel roads, which lead from the same place to the same other place, the shortest is
    ///   kept; of equally short ones, the first.
    /// - Roads from a place to itself are dropped, whatever their length.
    /// - Places with the id and the position of an earlier one are dropped.
    ///
    /// ```
    /// use wayfix::map::{Place, Position, Road, RoadClass, RoadMap};
    ///
    /// let place = |id, latitude| Place {
    ///     id,
    ///     position: Position { latitude, longitude: 149.13 },
    ///     name: String::new(),
    /// };
    /// let road = |from, to, metres| Road { from, to, class: RoadClass::Street, metres };
    /// let (map, report) = RoadMap::cleaned(
    ///     [place(1, -35.280), place(2, -35.281)],
    ///     [road(1, 2, 130.0), road(2, 2, 40.0), road(1, 2, 112.0), road(2, 1, 112.0)],
    /// )?;
    /// assert_eq!(map.roads(), [road(1, 2, 112.0), road(2, 1, 112.0)]);
    /// assert_eq!(report.parallel_roads, [(0, road(1, 2, 130.0))]);
    /// assert_eq!(report.loops, [(1, road(2, 2, 40.0))]);
    /// assert_eq!(
    ///     report.to_string(),
    ///     "dropped 0 of 2 places (repeated) and 2 of 4 roads (parallel: 1, loops: 1)"
    /// );
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MapError`] for defects that dropping cannot repair: no places, an id given to two
    /// positions, a position that is not on Earth or in the plane, a road from or to a place that
    /// does not exist, or a length that is not above 0.
    pub fn cleaned(
        places: impl IntoIterator<Item = Place<P>>,
        roads: impl IntoIterator<Item = Road>,
    ) -> Result<(Self, CleaningReport), MapError> {
        Self::built(Builder::cleaning(), places, roads)
    }

    fn built(
        mut builder: Builder<P>,
        places: impl IntoIterator<Item = Place<P>>,
        roads: impl IntoIterator<Item = Road>,
    ) -> Result<(Self, CleaningReport), MapError> {
        places.into_iter().try_for_each(|place| builder.place(place))?;
        roads.into_iter().try_for_each(|road| builder.road(road))?;
        builder.build()
    }
}
