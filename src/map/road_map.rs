//! Places and the directed roads between them.

use std::collections::HashMap;
use std::fmt;
use std::str::FromStr;

use super::MapError;
use super::Position;

/// A place: a state of the model that can be pointed at.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// What roads call it. Ids need not be consecutive; states are numbered
    /// from 0 in the order of the places.
    pub id: u64,
    /// Where it is.
    pub position: Position,
    /// What people call it; may be empty.
    pub name: String,
}

/// How much traffic a road is made for, from least to most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RoadClass {
    /// A local street.
    Street,
    /// It collects the traffic of streets.
    Collector,
    /// It connects districts.
    Arterial,
    /// The main road.
    Main,
}

impl FromStr for RoadClass {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "street" => Ok(Self::Street),
            "collector" => Ok(Self::Collector),
            "arterial" => Ok(Self::Arterial),
            "main" => Ok(Self::Main),
            _ => Err(format!("class {text:?}, expected main, arterial, collector or street")),
        }
    }
}

impl fmt::Display for RoadClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Street => "street",
            Self::Collector => "collector",
            Self::Arterial => "arterial",
            Self::Main => "main",
        })
    }
}

/// A road from one place to another, in this direction only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Road {
    /// The id of the place where it starts.
    pub from: u64,
    /// The id of the place where it ends.
    pub to: u64,
    /// Its class.
    pub class: RoadClass,
    /// Its length in metres, above 0.
    pub metres: f64,
}

/// Places and directed roads, checked.
///
/// Places are named by their **index** (from 0, the state of the model) in all
/// methods, except where the name says id. See the [module](super) for an
/// example.
#[derive(Debug, Clone)]
pub struct RoadMap {
    places: Vec<Place>,
    indices: HashMap<u64, u32>,
    /// In order of their ends, as indices.
    roads: Vec<Road>,
    pub(super) outgoing: Adjacency,
    pub(super) incoming: Adjacency,
}

/// For each place the places at the other end of its roads.
#[derive(Debug, Clone, Default)]
pub(super) struct Adjacency {
    starts: Vec<usize>,
    ends: Vec<u32>,
}

impl Adjacency {
    /// From pairs (place, other end), sorted.
    fn new(places: usize, pairs: &[(u32, u32)]) -> Self {
        let starts = (0..=places).map(|i| pairs.partition_point(|pair| (pair.0 as usize) < i));
        Self { starts: starts.collect(), ends: pairs.iter().map(|pair| pair.1).collect() }
    }

    fn range(&self, place: usize) -> std::ops::Range<usize> {
        match self.starts.get(place..place.saturating_add(2)) {
            Some(bounds) => bounds[0]..bounds[1],
            None => 0..0,
        }
    }

    pub(super) fn of(&self, place: usize) -> &[u32] {
        &self.ends[self.range(place)]
    }
}

impl RoadMap {
    /// A map of places and the roads between them, in any order.
    /// O((places + roads) log).
    ///
    /// # Errors
    ///
    /// [`MapError`] for no places, an id given twice, a position that is not
    /// on Earth, a road given twice or to itself, a road from or to a place
    /// that does not exist, or a length that is not above 0.
    pub fn new(
        places: impl IntoIterator<Item = Place>,
        roads: impl IntoIterator<Item = Road>,
    ) -> Result<Self, MapError> {
        let mut builder = Builder::default();
        places.into_iter().try_for_each(|place| builder.place(place))?;
        roads.into_iter().try_for_each(|road| builder.road(road))?;
        builder.build()
    }

    /// All places, in the order of their indices.
    #[must_use]
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// All roads, in the order of the indices of their ends.
    #[must_use]
    pub fn roads(&self) -> &[Road] {
        &self.roads
    }

    /// The index of the place with this id, or `None`.
    #[must_use]
    pub fn index_of_id(&self, id: u64) -> Option<usize> {
        self.indices.get(&id).map(|&index| index as usize)
    }

    /// The roads out of a place and the index of the place where each ends, in
    /// ascending order of it; none if there is no such place.
    #[must_use]
    pub fn roads_from(&self, place: usize) -> impl ExactSizeIterator<Item = (usize, &Road)> {
        let range = self.outgoing.range(place);
        let ends = self.outgoing.ends[range.clone()].iter().map(|&end| end as usize);
        ends.zip(&self.roads[range])
    }
}

/// Takes places, then roads, and checks each as it comes, so that a reader of
/// files can tell the line.
#[derive(Debug, Default)]
pub(super) struct Builder {
    places: Vec<Place>,
    indices: HashMap<u64, u32>,
    roads: HashMap<(u32, u32), Road>,
}

impl Builder {
    pub(super) fn place(&mut self, place: Place) -> Result<(), MapError> {
        let Position { latitude, longitude } = place.position;
        for (coordinate, value, limit) in
            [("latitude", latitude, 90.0), ("longitude", longitude, 180.0)]
        {
            if !(-limit..=limit).contains(&value) {
                return Err(MapError::Coordinate { id: place.id, coordinate, value, limit });
            }
        }
        if self.indices.insert(place.id, self.places.len() as u32).is_some() {
            return Err(MapError::DuplicatePlace { id: place.id });
        }
        self.places.push(place);
        Ok(())
    }

    pub(super) fn road(&mut self, road: Road) -> Result<(), MapError> {
        let Road { from, to, metres, .. } = road;
        let index = |id: u64| {
            let index = self.indices.get(&id).copied();
            index.ok_or(MapError::UnknownPlace { from, to, missing: id })
        };
        let ends = (index(from)?, index(to)?);
        if from == to {
            return Err(MapError::Loop { id: from });
        }
        if !(metres > 0.0 && metres.is_finite()) {
            return Err(MapError::Length { from, to, length: metres });
        }
        if self.roads.insert(ends, road).is_some() {
            return Err(MapError::DuplicateRoad { from, to });
        }
        Ok(())
    }

    pub(super) fn build(self) -> Result<RoadMap, MapError> {
        let Self { places, indices, roads } = self;
        if places.is_empty() {
            return Err(MapError::Empty);
        }
        let mut sorted: Vec<_> = roads.into_iter().collect();
        sorted.sort_unstable_by_key(|road| road.0);
        let mut pairs: Vec<_> = sorted.iter().map(|road| road.0).collect();
        let outgoing = Adjacency::new(places.len(), &pairs);
        pairs.iter_mut().for_each(|(from, to)| std::mem::swap(from, to));
        pairs.sort_unstable();
        let incoming = Adjacency::new(places.len(), &pairs);
        let roads = sorted.into_iter().map(|road| road.1).collect();
        Ok(RoadMap { places, indices, roads, outgoing, incoming })
    }
}
