//! Places by index and by id, shared by maps and networks.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::{Coordinates, MapError, Position};

/// A place on Earth or in a plane (see [`Coordinates`]): a state of the model on a
/// [`RoadMap`](super::RoadMap), and a node of a `RoadNetwork` of wayfix-roads, which is a
/// junction, a dead end, or a point of a road.
#[derive(Debug, Clone, PartialEq)]
pub struct Place<P = Position> {
    /// Identifier that roads refer to. Ids need not be consecutive; places are numbered from 0 in
    /// the order given.
    pub id: u64,
    /// Position of the place.
    pub position: P,
    /// Name for display; may be empty.
    pub name: String,
}

/// Places with checked positions, and their indices by id.
#[derive(Debug, Clone)]
pub struct Places<P> {
    pub list: Vec<Place<P>>,
    indices: HashMap<u64, u32>,
}

impl<P> Default for Places<P> {
    fn default() -> Self {
        Self { list: Vec::new(), indices: HashMap::new() }
    }
}

impl<P> Places<P> {
    /// Lists places whose ids and positions the caller has checked.
    #[must_use]
    pub fn of_checked(list: Vec<Place<P>>) -> Self {
        let indices = list.iter().zip(0..).map(|(place, index)| (place.id, index)).collect();
        Self { list, indices }
    }

    #[must_use]
    pub fn index_of(&self, id: u64) -> Option<usize> {
        self.indices.get(&id).map(|&index| index as usize)
    }

    /// Indices of the ends of a road.
    pub fn ends(&self, from: u64, to: u64) -> Result<[usize; 2], MapError> {
        let index = |id| self.index_of(id).ok_or(MapError::UnknownPlace { from, to, missing: id });
        Ok([index(from)?, index(to)?])
    }
}

impl<P: Coordinates> Places<P> {
    /// Adds a place. Returns its index.
    pub fn add(&mut self, place: Place<P>) -> Result<usize, MapError> {
        let (id, index) = (place.id, self.list.len());
        check_position(id, place.position)?;
        match self.indices.entry(id) {
            Entry::Occupied(_) => return Err(MapError::DuplicatePlace { id }),
            Entry::Vacant(vacant) => vacant.insert(index as u32),
        };
        self.list.push(place);
        Ok(index)
    }

    /// Straight distance between two places.
    #[cfg(feature = "csv")]
    #[must_use]
    pub fn straight(&self, [from, to]: [usize; 2]) -> f64 {
        self.list[from].position.metres_to(self.list[to].position)
    }
}

/// Checks that a position is on Earth, or in the plane.
pub fn check_position<P: Coordinates>(id: u64, position: P) -> Result<(), MapError> {
    for ((coordinate, limit), value) in P::AXES.into_iter().zip(position.values()) {
        // NaN is in no range.
        if !(-limit..=limit).contains(&value) {
            return Err(MapError::Coordinate { id, coordinate, value, limit, unit: P::UNIT });
        }
    }
    Ok(())
}
