//! Largest strongly connected part of a network.

use super::cleaning_step::{Cleaning, CleaningStep};
use super::road_network::RoadNetwork;
use wayfix::internal::components;
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Largest part in which each node can be reached from each other one, with its edges and
    /// their forbidden turns; of equally large ones, that with the first node.
    ///
    /// Forbidden turns don't count here: with them, some nodes may be out of reach still.
    /// O(nodes + edges), by Tarjan (1972), without recursion.
    #[must_use]
    pub fn largest_component(&self) -> (Self, CleaningStep<P>) {
        let component =
            components(self.nodes().len(), |n| self.edges_from(n).map(|e| self.edges[e].to));
        let mut sizes = vec![0_usize; self.nodes().len()];
        component.iter().for_each(|&c| sizes[c as usize] += 1);
        let mut largest = component[0];
        for &c in &component {
            if sizes[c as usize] > sizes[largest as usize] {
                largest = c;
            }
        }
        let (nodes, target) = self.selected(|n| component[n] == largest);
        let network = self.mapped(nodes, &target, |_| true);
        let step = CleaningStep::of(Cleaning::LargestComponent, self, &network);
        (network, step)
    }
}
