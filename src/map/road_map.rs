//! Places and the directed roads between them.

use std::collections::HashMap;
use std::fmt;
use std::str::FromStr;

use super::{Coordinates, Position};

/// A place: a state of the model that has a position, on Earth or in a plane (see
/// [`Coordinates`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Place<P = Position> {
    /// Identifier that roads refer to. Ids need not be consecutive; states are numbered from 0 in
    /// the order of the places.
    pub id: u64,
    /// Position of the place.
    pub position: P,
    /// Name for people; may be empty.
    pub name: String,
}

/// Class of a road by the traffic it is built for, from least to most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RoadClass {
    /// A local street.
    Street,
    /// A road that collects the traffic of streets.
    Collector,
    /// A road that connects districts.
    Arterial,
    /// A main road.
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
    /// Id of the place where the road starts.
    pub from: u64,
    /// Id of the place where the road ends.
    pub to: u64,
    /// Class of the road.
    pub class: RoadClass,
    /// Length in metres, above 0.
    pub metres: f64,
}

impl Road {
    /// Creates a road as long as the straight line between its ends.
    #[must_use]
    pub fn straight<P: Coordinates>(from: &Place<P>, to: &Place<P>, class: RoadClass) -> Self {
        let metres = from.position.metres_to(to.position);
        Self { from: from.id, to: to.id, class, metres }
    }
}

/// Validated places and directed roads. Places are on Earth by default, or in a plane for a
/// `RoadMap<PlanePosition>`.
///
/// Methods identify a place by its **index** (from 0, the state of the model), except where the
/// name says id. See the [module](super) for an example.
#[derive(Debug, Clone)]
pub struct RoadMap<P = Position> {
    pub(super) places: Vec<Place<P>>,
    pub(super) indices: HashMap<u64, u32>,
    /// Roads in the order of the indices of their ends.
    pub(super) roads: Vec<Road>,
    pub(super) outgoing: Adjacency,
    pub(super) incoming: Adjacency,
}

/// Compressed adjacency lists: for each place, the places at the other ends of its roads.
#[derive(Debug, Clone, Default)]
pub(super) struct Adjacency {
    starts: Vec<usize>,
    ends: Vec<u32>,
}

impl Adjacency {
    /// Creates lists from sorted pairs (place, other end).
    pub(super) fn new(places: usize, pairs: &[(u32, u32)]) -> Self {
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

impl<P> RoadMap<P> {
    /// Places, in the order of their indices.
    #[must_use]
    pub fn places(&self) -> &[Place<P>] {
        &self.places
    }

    /// Roads, in the order of the indices of their ends.
    #[must_use]
    pub fn roads(&self) -> &[Road] {
        &self.roads
    }

    /// Index of the place with this id, or `None`.
    #[must_use]
    pub fn index_of_id(&self, id: u64) -> Option<usize> {
        self.indices.get(&id).map(|&index| index as usize)
    }

    /// Roads out of a place, each with the index of the place where it ends, in ascending order
    /// of that index; none if the place does not exist.
    #[must_use]
    pub fn roads_from(&self, place: usize) -> impl ExactSizeIterator<Item = (usize, &Road)> {
        let range = self.outgoing.range(place);
        let ends = self.outgoing.ends[range.clone()].iter().map(|&end| end as usize);
        ends.zip(&self.roads[range])
    }
}
