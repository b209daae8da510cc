//! Removal of dead ends: the 2-core of the undirected network.

use super::cleaning_step::{Cleaning, CleaningStep};
use super::road_network::RoadNetwork;
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Network without dead ends: nodes with at most one neighbour are dropped, then those that are
    /// left with at most one, and so on. If the network has no ring of three or more nodes, its
    /// first node stays. O(nodes + edges).
    #[must_use]
    pub fn without_dead_ends(&self) -> (Self, CleaningStep<P>) {
        let mut neighbors = vec![Vec::new(); self.nodes().len()];
        for edge in self.edges.iter().filter(|edge| edge.from != edge.to) {
            neighbors[edge.from].push(edge.to);
            neighbors[edge.to].push(edge.from);
        }
        for list in &mut neighbors {
            list.sort_unstable();
            // Neighbours, not edges: a two-way road or two carriageways to one node are still a
            // dead end.
            list.dedup();
        }
        let mut degree: Vec<usize> = neighbors.iter().map(Vec::len).collect();
        let mut kept = vec![true; self.nodes().len()];
        let mut ends: Vec<usize> = (0..self.nodes().len()).filter(|&n| degree[n] <= 1).collect();
        while let Some(n) = ends.pop() {
            // A node whose degree falls from 1 to 0 comes up twice.
            if !std::mem::take(&mut kept[n]) {
                continue;
            }
            for &other in neighbors[n].iter().filter(|&&other| kept[other]) {
                degree[other] -= 1;
                if degree[other] <= 1 {
                    ends.push(other);
                }
            }
        }
        // A network needs a node.
        let none = !kept.contains(&true);
        let (nodes, target) = self.selected(|n| kept[n] || (none && n == 0));
        let network = self.mapped(nodes, &target, |_| true);
        let step = CleaningStep::of(Cleaning::DeadEnds, self, &network);
        (network, step)
    }
}
