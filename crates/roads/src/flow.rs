//! Consistent flows from counts of traffic on the edges of a network.

use wayfix::internal::balance;
use wayfix::map::MapError;

use crate::RoadNetwork;

impl<P> RoadNetwork<P> {
    /// Flow nearest to counts of traffic, one per edge, such that inflow equals outflow at each
    /// node. See [`RoadMap::consistent_flow`](wayfix::map::RoadMap::consistent_flow).
    ///
    /// # Errors
    ///
    /// As [`RoadMap::consistent_flow`](wayfix::map::RoadMap::consistent_flow).
    pub fn consistent_flow(&self, counts: &[f64]) -> Result<Vec<f64>, MapError> {
        let ends: Vec<_> = self.edges().iter().map(|edge| [edge.from, edge.to]).collect();
        balance(self.nodes().len(), &ends, counts, |i| self.nodes()[i].id)
    }
}
