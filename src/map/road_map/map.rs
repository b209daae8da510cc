//! Maps: places, which are the states of a model, and the directed roads between them.

use super::adjacency::Adjacency;
use crate::map::places::{Place, Places};
use crate::map::{Coordinates, Position, RoadClass};

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
/// name says id. See the [module](crate::map) for an example.
#[derive(Debug, Clone)]
pub struct RoadMap<P = Position> {
    pub(super) places: Places<P>,
    /// Roads, sorted by the indices of their ends.
    pub(super) roads: Vec<Road>,
    pub(super) outgoing: Adjacency,
    pub(super) incoming: Adjacency,
}

impl<P> RoadMap<P> {
    /// Places, in the order of their indices.
    #[must_use]
    pub fn places(&self) -> &[Place<P>] {
        &self.places.list
    }

    /// Roads, sorted by the indices of their ends.
    #[must_use]
    pub fn roads(&self) -> &[Road] {
        &self.roads
    }

    /// Index of the place with this id, or `None`.
    #[must_use]
    pub fn index_of_id(&self, id: u64) -> Option<usize> {
        self.places.index_of(id)
    }

    /// Roads out of a place, each with the index of the place where it ends, in ascending order
    /// of that index; none if the place does not exist.
    #[must_use]
    pub fn roads_from(&self, place: usize) -> impl ExactSizeIterator<Item = (usize, &Road)> {
        let ends = self.outgoing.of(place).iter().map(|&end| end as usize);
        ends.zip(&self.roads[self.outgoing.range(place)])
    }

    /// True if a road leads from one place to another.
    pub(in crate::map) fn has_road(&self, from: usize, to: usize) -> bool {
        self.outgoing.of(from).binary_search(&(to as u32)).is_ok()
    }
}
