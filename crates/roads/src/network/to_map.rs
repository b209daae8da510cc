//! Maps whose places are the nodes of a network.

use crate::{Edge, NetworkError, RoadNetwork};
use wayfix::map::{Coordinates, Road, RoadMap};

impl<P: Coordinates> RoadNetwork<P> {
    /// Map with the nodes as places, with the shortest of parallel edges and without loops.
    /// O((nodes + edges) log).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Map`] if there are no nodes.
    pub fn to_map(&self) -> Result<RoadMap<P>, NetworkError> {
        let road = |edge: &Edge| {
            let [from, to] = [edge.from, edge.to].map(|node| self.nodes()[node].id);
            Road { from, to, class: edge.class, metres: edge.metres }
        };
        let cleaned = RoadMap::cleaned(self.nodes().iter().cloned(), self.edges().iter().map(road));
        Ok(cleaned?.0)
    }
}
