//! Largest strongly connected part of a network.

use super::cleaning::{CleaningOperation, CleaningStep};
use super::{NONE, RoadNetwork};
use crate::map::Coordinates;

impl<P: Coordinates> RoadNetwork<P> {
    /// Largest part in which each node can be reached from each other one, with its edges and
    /// their forbidden turns; of equally large ones, that with the first node.
    ///
    /// Forbidden turns don't count here: with them, some nodes may be out of reach still.
    /// O(nodes + edges), by Tarjan (1972), without recursion.
    #[must_use]
    pub fn largest_component(&self) -> (Self, CleaningStep) {
        let component = self.components();
        let mut sizes = vec![0_usize; self.nodes.len()];
        component.iter().for_each(|&c| sizes[c as usize] += 1);
        let mut largest = component[0];
        for &c in &component {
            if sizes[c as usize] > sizes[largest as usize] {
                largest = c;
            }
        }
        let (nodes, target) = self.selected(|n| component[n] == largest);
        let network = self.mapped(&nodes, &target, |_| true);
        let step = CleaningStep::of(CleaningOperation::LargestComponent, self, &network);
        (network, step)
    }

    /// Number of the strongly connected component of each node.
    fn components(&self) -> Vec<u32> {
        let n = self.nodes.len();
        let (mut component, mut found) = (vec![NONE; n], 0);
        // Order in which nodes were met, and the first met one that is known to be reached.
        let (mut met, mut lowest, mut count) = (vec![NONE; n], vec![0; n], 0);
        let (mut open, mut path) = (Vec::new(), Vec::new());
        for root in 0..n {
            if met[root] != NONE {
                continue;
            }
            path.push((root, self.edges_from(root)));
            while let Some((node, edges)) = path.last_mut() {
                let node = *node;
                if met[node] == NONE {
                    (met[node], lowest[node]) = (count, count);
                    count += 1;
                    open.push(node);
                }
                if let Some(e) = edges.next() {
                    let to = self.edges[e].to;
                    if met[to] == NONE {
                        path.push((to, self.edges_from(to)));
                    } else if component[to] == NONE {
                        lowest[node] = lowest[node].min(met[to]);
                    }
                    continue;
                }
                path.pop();
                if let Some(&(before, _)) = path.last() {
                    lowest[before] = lowest[before].min(lowest[node]);
                }
                if lowest[node] == met[node] {
                    while let Some(member) = open.pop() {
                        component[member] = found;
                        if member == node {
                            break;
                        }
                    }
                    found += 1;
                }
            }
        }
        component
    }
}
