//! Roads without dead ends.

use super::cleaning_step::{Cleaning, CleaningStep};
use super::road_network::RoadNetwork;
use wayfix::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// The roads that lead on: nodes with at most one neighbour are dropped, then those that have
    /// at most one now, and so on. Of a network without rings of three nodes or more, the first
    /// node stays. O(nodes + edges).
    #[must_use]
    pub fn without_dead_ends(&self) -> (Self, CleaningStep<P>) {
        let mut neighbors = vec![Vec::new(); self.nodes().len()];
        for edge in self.edges.iter().filter(|edge| edge.from != edge.to) {
            neighbors[edge.from].push(edge.to);
            neighbors[edge.to].push(edge.from);
        }
        for list in &mut neighbors {
            list.sort_unstable();
            list.dedup();
        }
        let mut degree: Vec<usize> = neighbors.iter().map(Vec::len).collect();
        let mut kept = vec![true; self.nodes().len()];
        let mut ends: Vec<usize> = (0..self.nodes().len()).filter(|&n| degree[n] <= 1).collect();
        while let Some(n) = ends.pop() {
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
        let none = !kept.contains(&true);
        let (nodes, target) = self.selected(|n| kept[n] || (none && n == 0));
        let network = self.mapped(nodes, &target, |_| true);
        let step = CleaningStep::of(Cleaning::DeadEnds, self, &network);
        (network, step)
    }
}
