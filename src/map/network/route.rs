//! Shortest routes from a position to several edges, up to a length.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::RoadNetwork;

/// Costs of turns in a [`RouteSearch`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnCosts {
    /// Metres that a U-turn counts as, beside its own length, where another way goes on; at
    /// least 0.
    pub u_turn: f64,
}

/// Search for the shortest routes from an edge to others by Dijkstra's algorithm (1959) over
/// edges, so that forbidden turns and costs of U-turns are respected. Keeps its memory, 60 bytes
/// an edge of the network, from one search to the next.
#[derive(Debug, Clone, Default)]
pub struct RouteSearch {
    labels: Vec<Label>,
    /// Number of the search in which an edge is wanted.
    wanted: Vec<u32>,
    search: u32,
    queue: BinaryHeap<Reverse<(u64, u32)>>,
}

/// Best route to the start of an edge so far.
#[derive(Debug, Clone, Copy, Default)]
struct Label {
    search: u32,
    /// The edge before.
    before: u32,
    is_settled: bool,
    cost: f64,
    reached: Reached,
}

/// Route from the start of a search to the start of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Reached {
    /// Length of the route, from the end of the first edge to the start of this one, in metres.
    pub metres: f64,
    /// Number of U-turns where another way went on.
    pub u_turns: u32,
    /// Number of choices at junctions, as the logarithm of the number of ways to go on.
    pub log_choices: f64,
    /// Sum of the straight distances between the ends of the edges, in metres.
    pub chords: f64,
}

impl RouteSearch {
    /// Finds the shortest routes from the end of an edge to the starts of the edges in `targets`,
    /// up to `most` metres, in which U-turns count as their costs; below 0, as 0. `chords` has the
    /// straight distance between the ends of each edge. Stops when all are found. O(edges within
    /// `most` metres, log).
    ///
    /// # Panics
    ///
    /// If an edge does not exist, or `chords` has another length than the edges.
    pub fn run<P>(
        &mut self,
        network: &RoadNetwork<P>,
        chords: &[f64],
        from: usize,
        targets: impl IntoIterator<Item = usize>,
        most: f64,
        costs: TurnCosts,
    ) {
        self.labels.resize(network.edges().len(), Label::default());
        self.wanted.resize(network.edges().len(), 0);
        if self.search == u32::MAX {
            self.labels.fill(Label::default());
            self.wanted.fill(0);
            self.search = 0;
        }
        self.search += 1;
        let mut left = 0_usize;
        for target in targets {
            left += usize::from(self.wanted[target] != self.search);
            self.wanted[target] = self.search;
        }
        self.queue.clear();
        if left == 0 {
            return;
        }
        let most = most.max(0.0);
        self.extend(network, from, Reached::default(), [0.0, most], costs);
        while let Some(Reverse((_, edge))) = self.queue.pop() {
            let edge = edge as usize;
            let label = &mut self.labels[edge];
            if label.is_settled {
                continue;
            }
            label.is_settled = true;
            let Label { cost, reached, .. } = *label;
            if self.wanted[edge] == self.search {
                left -= 1;
                if left == 0 {
                    return;
                }
            }
            let metres = network.edges()[edge].metres;
            if cost + metres <= most {
                let chords = reached.chords + chords[edge];
                let after = Reached { metres: reached.metres + metres, chords, ..reached };
                self.extend(network, edge, after, [cost + metres, most], costs);
            }
        }
    }

    /// Labels the edges that may follow one.
    fn extend<P>(
        &mut self,
        network: &RoadNetwork<P>,
        edge: usize,
        after: Reached,
        [cost, most]: [f64; 2],
        costs: TurnCosts,
    ) {
        let reverse = network.reverse(edge);
        let ways = network.next(edge).filter(|next| Some(*next) != reverse).count();
        let log_choices = after.log_choices + if ways > 1 { (ways as f64).ln() } else { 0.0 };
        for next in network.next(edge) {
            let turns_back = ways > 0 && Some(next) == reverse;
            let cost = cost + if turns_back { costs.u_turn } else { 0.0 };
            if cost > most {
                continue;
            }
            let label = &mut self.labels[next];
            if label.search == self.search && (label.is_settled || label.cost <= cost) {
                continue;
            }
            let u_turns = after.u_turns + u32::from(turns_back);
            let reached = Reached { u_turns, log_choices, ..after };
            let before = edge as u32;
            *label = Label { search: self.search, before, is_settled: false, cost, reached };
            self.queue.push(Reverse((cost.to_bits(), next as u32)));
        }
    }

    /// Route of the last search to the start of an edge, if it was found.
    #[must_use]
    pub fn reached(&self, edge: usize) -> Option<Reached> {
        let label = self.labels.get(edge)?;
        (label.search == self.search && label.is_settled).then_some(label.reached)
    }

    /// Edges of the route of the last search from `from` to an edge, with both; empty if it was
    /// not found.
    #[must_use]
    pub fn route(&self, from: usize, edge: usize) -> Vec<usize> {
        let mut route = Vec::new();
        if self.reached(edge).is_none() {
            return route;
        }
        route.push(edge);
        let mut at = edge;
        loop {
            at = self.labels[at].before as usize;
            route.push(at);
            // The first edge may itself be reached again, by a loop.
            let label = &self.labels[at];
            if at == from && self.is_first(route[route.len() - 2]) {
                break;
            }
            if label.search != self.search {
                break;
            }
        }
        route.reverse();
        route
    }

    /// True if an edge follows the first directly.
    fn is_first(&self, edge: usize) -> bool {
        self.labels[edge].reached.metres == 0.0 && self.labels[edge].reached.chords == 0.0
    }
}
