//! Largest strongly connected component of a network.

use super::cleaning_step::{Cleaning, CleaningStep};
use super::road_network::RoadNetwork;
use wayfix::internal::components;
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Largest part in which every node can be reached from every other, with its edges and their
    /// forbidden turns; among equally large ones, the one with the lowest node.
    ///
    /// Forbidden turns don't count here; because of them, some nodes may still be out of reach.
    /// O(nodes + edges), by Tarjan (1972), without recursion.
    #[must_use]
    pub fn largest_component(&self) -> (Self, CleaningStep<P>) {
        let component =
            components(self.nodes().len(), |n| self.edges_from(n).map(|e| self.edges[e].to));
        let mut sizes = vec![0_usize; self.nodes().len()];
        component.iter().for_each(|&c| sizes[c as usize] += 1);
        let mut largest = component[0];
        // Strictly larger, in the order of the nodes: a tie goes to the part met first.
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
