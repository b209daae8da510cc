//! Cheapest routes from one edge to several others, up to a largest cost.
//!
//! This is Dijkstra's algorithm with edges as vertices, so that turns have costs or are forbidden.
//! It stops at the last target, and prunes, as A* does, where the cost so far plus a lower bound of
//! the rest exceeds the largest cost.

use super::length_bound::LengthBound;
use super::neighbourhood::Neighbourhood;
use super::road_network::{Edge, RoadNetwork};
use wayfix::internal::{Label, Search};
use wayfix::map::Coordinates;

/// Measures that a [`RouteSearch`] adds up along a route: straight lengths of edges, and choices
/// at junctions.
///
/// Memory: 16 bytes per edge, 24 per node, and 4 per turn.
#[derive(Debug, Clone)]
pub struct RouteMeasures {
    /// Straight distance between the ends of each edge, in metres; at most its length.
    chords: Vec<f64>,
    /// −ln p of the turns out of each edge, in the order of [`RoadNetwork::next`].
    choices: Vec<f32>,
    starts: Vec<usize>,
    /// Nodes in space.
    pub(super) nodes: Vec<[f64; 3]>,
    pub(super) bound: LengthBound,
}

impl RouteMeasures {
    /// Measures of a network where all ways to continue are equally likely. O(turns + edges log).
    #[must_use]
    pub fn new<P: Coordinates>(network: &RoadNetwork<P>) -> Self {
        Self::with_turns(network, |_, _| 1.0)
    }

    /// Measures of a network where the edge that follows another is chosen in proportion to a
    /// weight, at least 0. U-turns are not among the choices: the search has a cost for them.
    /// O(turns + edges log).
    #[must_use]
    pub fn with_turns<P: Coordinates>(
        network: &RoadNetwork<P>,
        weight: impl Fn(usize, usize) -> f64,
    ) -> Self {
        let straight = |edge: &Edge| {
            let [a, b] = [edge.from, edge.to].map(|node| network.nodes()[node].position);
            a.metres_to(b).min(edge.metres)
        };
        let chords = network.edges().iter().map(straight).collect();
        let (mut choices, mut starts) = (Vec::new(), vec![0]);
        for edge in 0..network.edges().len() {
            let reverse = network.reverse(edge);
            let ways = network.next(edge).filter(|next| Some(*next) != reverse);
            let sum: f64 = ways.map(|next| weight(edge, next)).sum();
            choices.extend(network.next(edge).map(|next| {
                let turns_back = Some(next) == reverse;
                // −ln (w / Σ w), infinite for a weight of 0: that turn is never taken.
                if turns_back || sum == 0.0 { 0.0 } else { (sum / weight(edge, next)).ln() as f32 }
            }));
            starts.push(choices.len());
        }
        let nodes: Vec<_> = network.nodes().iter().map(|node| node.position.in_space()).collect();
        // Distances in space obey the triangle inequality exactly, which the bound needs; chords of
        // the sphere are at most the distances on the ground.
        let lengths = |edge: &Edge| [edge.metres, distance(nodes[edge.from], nodes[edge.to])];
        let bound = LengthBound::new(network.edges().iter().map(lengths));
        Self { chords, choices, starts, nodes, bound }
    }

    /// −ln p of the turns out of an edge.
    pub(super) fn choices_after(&self, edge: usize) -> &[f32] {
        &self.choices[self.starts[edge]..self.starts[edge + 1]]
    }

    /// Straight distance between the ends of an edge in metres; at most its length.
    ///
    /// # Panics
    ///
    /// If there is no such edge.
    #[must_use]
    pub fn straight_metres(&self, edge: usize) -> f64 {
        self.chords[edge]
    }
}

pub(super) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis| a[axis] - b[axis]);
    (x * x + y * y + z * z).sqrt()
}

/// Search for the cheapest routes from edges to others, by Dijkstra's algorithm (1959) over edges,
/// so that forbidden turns and costs of U-turns are respected. It reuses its memory from one search
/// to the next: 8 bytes per edge of the network, and some 150 per edge that was met.
#[derive(Debug, Clone, Default)]
pub struct RouteSearch {
    neighbourhood: Neighbourhood,
    search: Search<Reached>,
    costs: RouteCosts,
    /// Number of distinct targets.
    targets: usize,
}

/// Costs of a route besides its length, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RouteCosts {
    /// Cost of a U-turn where there is another way to continue, at least 0.
    pub u_turn: f64,
    /// Cost of a choice of probability 1/e at a junction, at least 0: a turn of probability p costs
    /// −ln p times as much.
    pub choice: f64,
}

/// Route from the start of a search to the start of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Reached {
    /// Length of the route, from the end of the first edge to the start of this one, in metres.
    pub metres: f64,
    /// Number of U-turns where there was another way to continue.
    pub u_turns: u32,
    /// Choices at junctions: the sum of −ln p(turn), without U-turns.
    pub log_choices: f64,
    /// Sum of the straight distances between the ends of the edges, in metres.
    pub chords: f64,
}

impl RouteSearch {
    /// Sets the targets of the searches that follow: routes to the starts of these edges. The
    /// searches share what they look up in the network. O(targets).
    ///
    /// # Panics
    ///
    /// If an edge does not exist, or the measures belong to another network.
    pub fn set_targets<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        targets: impl Iterator<Item = usize> + Clone,
        costs: RouteCosts,
    ) {
        self.neighbourhood.begin(network, measures, targets);
        (self.targets, self.costs) = (self.neighbourhood.len(), costs);
        self.search.start(self.targets);
    }

    /// Finds the routes of least cost from the end of an edge to the targets, where the cost is the
    /// length plus the [`RouteCosts`], up to `most` (negative counts as 0). Stops when all are
    /// found, and does not go where the straight distance to the targets is too long for `most`. No
    /// route is missed, even if edges are shorter than the straight line between their ends.
    /// O(edges within reach, log).
    ///
    /// # Panics
    ///
    /// As [`set_targets`](Self::set_targets).
    pub fn run<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        from: usize,
        most: f64,
    ) {
        let Self { neighbourhood, search, costs, targets } = self;
        search.start(neighbourhood.len());
        let (most, mut left) = (most.max(0.0), *targets);
        // A metre and a billionth exceed the rounding of the sums and of the bound: pruning never
        // costs a route.
        let farthest = most * (1.0 + 1e-9) + 1.0;
        if left == 0 {
            return;
        }
        let start = neighbourhood.meet(network, measures, from) as usize;
        // The start has no label: it is not reached by a turn, and may be settled later like any
        // other edge.
        let mut next = Some((start, None::<Label<Reached>>));
        while let Some((number, label)) = next {
            // A route begins at the end of its first edge, so the first edge adds nothing.
            let (mut cost, mut after) = (0.0, Reached::default());
            let edge = neighbourhood.edge(number);
            if let Some(Label { cost: up_to, way: reached, .. }) = label {
                // Each vertex is settled once, so each target is counted once. The first edge may
                // be a target, too: it counts when a loop comes back to it.
                left -= usize::from(edge.is_target);
                if left == 0 {
                    return;
                }
                let (metres, chords) = (reached.metres + edge.metres, reached.chords + edge.chord);
                (cost, after) = (up_to + edge.metres, Reached { metres, chords, ..reached });
            }
            // All costs are at least the length, so what is left in metres is a lower bound of what
            // is left in costs.
            if cost <= most && cost + edge.left <= farthest {
                let turns = neighbourhood.turns(network, measures, number, *costs);
                for turn in turns {
                    let cost = cost + turn.cost;
                    if cost <= most {
                        let log_choices = after.log_choices + turn.log_choice;
                        let u_turns = after.u_turns + u32::from(turn.is_u_turn);
                        let way = Reached { u_turns, log_choices, ..after };
                        let to = (turn.to as usize, turn.edge);
                        // Among equal costs the rank, the index of the edge in the network,
                        // decides, whatever the order in which edges were met.
                        search.offer(to, number, cost, way, false);
                    }
                }
            }
            next = search.settle().map(|(number, label)| (number, Some(label)));
        }
    }

    /// Route of the last search to the start of an edge, if it was found.
    #[must_use]
    pub fn reached(&self, edge: usize) -> Option<Reached> {
        let number = self.neighbourhood.find(edge)?;
        self.search.settled(number).map(|label| label.way)
    }

    /// Edges of the last search's route from `from` to an edge, including both; empty if none was
    /// found.
    #[must_use]
    pub fn route(&self, from: usize, edge: usize) -> Vec<usize> {
        let number = self.neighbourhood.find(edge);
        let Some(mut label) = number.and_then(|number| self.search.settled(number)) else {
            return Vec::new();
        };
        let mut route = vec![edge];
        loop {
            let before = label.before as usize;
            let edge = self.neighbourhood.edge(before).edge as usize;
            route.push(edge);
            // The first edge may itself be reached again by a loop, so the route starts not at its
            // first occurrence but before an edge that follows it directly, at 0 metres.
            let follows = label.way.metres == 0.0 && label.way.chords == 0.0;
            match self.search.met(before) {
                Some(met) if !(edge == from && follows) => label = met,
                _ => break,
            }
        }
        route.reverse();
        route
    }
}
