//! Consistent flows from counts of traffic on the edges of a network.

use wayfix::internal::balance;

use crate::{NetworkError, RoadNetwork};

impl<P> RoadNetwork<P> {
    /// Flow nearest to counts of traffic, one per edge, such that inflow equals outflow at each
    /// node. See [`RoadMap::consistent_flow`](wayfix::map::RoadMap::consistent_flow).
    ///
    /// # Errors
    ///
    /// [`NetworkError::Map`] with the errors of
    /// [`RoadMap::consistent_flow`](wayfix::map::RoadMap::consistent_flow).
    pub fn consistent_flow(&self, counts: &[f64]) -> Result<Vec<f64>, NetworkError> {
        let ends: Vec<_> = self.edges().iter().map(|edge| [edge.from, edge.to]).collect();
        Ok(balance(self.nodes().len(), &ends, counts, |i| self.nodes()[i].id)?)
    }
}
