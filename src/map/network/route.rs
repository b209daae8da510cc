//! Shortest routes from a position to several edges, up to a length.

use super::length_bound::LengthBound;
use super::road_network::{Edge, RoadNetwork};
use crate::map::Coordinates;
use crate::map::search::Search;

/// Measures that a [`RouteSearch`] adds up along a route: straight lengths of edges, and choices
/// at junctions.
///
/// Memory: 16 bytes an edge, 24 a node, and 4 a turn.
#[derive(Debug, Clone)]
pub struct RouteMeasures {
    /// Straight distance between the ends of each edge, in metres; at most its length.
    chords: Vec<f64>,
    /// −ln p of the turns out of each edge, in the order of [`RoadNetwork::next`].
    choices: Vec<f32>,
    starts: Vec<usize>,
    /// Nodes in space.
    nodes: Vec<[f64; 3]>,
    bound: LengthBound,
}

impl RouteMeasures {
    /// Measures of a network where vehicles take all ways on alike. O(turns + edges log).
    #[must_use]
    pub fn new<P: Coordinates>(network: &RoadNetwork<P>) -> Self {
        Self::with_turns(network, |_, _| 1.0)
    }

    /// Measures of a network where an edge is followed by another in proportion to a weight, at
    /// least 0. U-turns are no choice: their cost is that of the search. O(turns + edges log).
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
                if turns_back || sum == 0.0 { 0.0 } else { (sum / weight(edge, next)).ln() as f32 }
            }));
            starts.push(choices.len());
        }
        let nodes: Vec<_> = network.nodes().iter().map(|node| node.position.in_space()).collect();
        let lengths = |edge: &Edge| [edge.metres, distance(nodes[edge.from], nodes[edge.to])];
        let bound = LengthBound::new(network.edges().iter().map(lengths));
        Self { chords, choices, starts, nodes, bound }
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

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis| a[axis] - b[axis]);
    (x * x + y * y + z * z).sqrt()
}

/// Ball around the starts of the targets of a search.
#[derive(Debug, Clone, Copy)]
struct Targets {
    centre: [f64; 3],
    radius: f64,
}

/// Search for the shortest routes from an edge to others by Dijkstra's algorithm (1959) over
/// edges, so that forbidden turns and costs of U-turns are respected. Keeps its memory, 60 bytes
/// an edge of the network, from one search to the next.
#[derive(Debug, Clone, Default)]
pub struct RouteSearch {
    search: Search<Reached>,
    /// Number of the search in which an edge is wanted.
    wanted: Vec<u32>,
}

/// Costs of a route beside its length, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RouteCosts {
    /// Largest cost of a route, up to which it is looked for; below 0, as 0.
    pub most: f64,
    /// Cost of a U-turn where another way goes on, at least 0.
    pub u_turn: f64,
    /// Cost of a choice of probability 1/e at a junction, at least 0: a turn with the probability
    /// p counts −ln p times as much.
    pub choice: f64,
}

/// Route from the start of a search to the start of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Reached {
    /// Length of the route, from the end of the first edge to the start of this one, in metres.
    pub metres: f64,
    /// Number of U-turns where another way went on.
    pub u_turns: u32,
    /// Choices at junctions: the sum of −ln p(turn), without U-turns.
    pub log_choices: f64,
    /// Sum of the straight distances between the ends of the edges, in metres.
    pub chords: f64,
}

impl RouteSearch {
    /// Finds the routes of least cost from the end of an edge to the starts of the edges in
    /// `targets`: their lengths, and what [`RouteCosts`] adds. Stops when all are found, and does not
    /// go where the straight distance to the targets is too long for the largest cost. Edges may be
    /// shorter than the straight line between their ends: no route is missed. O(edges within that,
    /// log).
    ///
    /// # Panics
    ///
    /// If an edge does not exist, or the measures are those of another network.
    pub fn run<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        from: usize,
        targets: impl IntoIterator<Item = usize>,
        costs: RouteCosts,
    ) {
        let number = self.search.start(network.edges().len());
        self.wanted.resize(network.edges().len(), 0);
        if number == 1 {
            self.wanted.fill(0);
        }
        let (mut left, mut around) = (0_usize, None::<Targets>);
        for target in targets {
            left += usize::from(self.wanted[target] != number);
            self.wanted[target] = number;
            let start = measures.nodes[network.edges()[target].from];
            let around = around.get_or_insert(Targets { centre: start, radius: 0.0 });
            around.radius = around.radius.max(distance(around.centre, start));
        }
        let Some(around) = around else { return };
        let costs = RouteCosts { most: costs.most.max(0.0), ..costs };
        self.extend(network, measures, from, Reached::default(), 0.0, (costs, around));
        while let Some((edge, label)) = self.search.settle() {
            if self.wanted[edge] == number {
                left -= 1;
                if left == 0 {
                    return;
                }
            }
            let (cost, reached) = (label.cost, label.way);
            let metres = network.edges()[edge].metres;
            if cost + metres <= costs.most {
                let chords = reached.chords + measures.chords[edge];
                let after = Reached { metres: reached.metres + metres, chords, ..reached };
                self.extend(network, measures, edge, after, cost + metres, (costs, around));
            }
        }
    }

    /// Offers a way to the edges that may follow one.
    fn extend<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        edge: usize,
        after: Reached,
        cost: f64,
        (costs, around): (RouteCosts, Targets),
    ) {
        let here = measures.nodes[network.edges()[edge].to];
        let left = distance(here, around.centre) - around.radius;
        // A metre and a billionth are more than the rounding of sums.
        if cost + measures.bound.at(left) > costs.most * (1.0 + 1e-9) + 1.0 {
            return;
        }
        let reverse = network.reverse(edge);
        let choices = &measures.choices[measures.starts[edge]..measures.starts[edge + 1]];
        // At a dead end, the way back is no U-turn.
        let goes_on = choices.len() > 1;
        for (next, &choice) in network.next(edge).zip(choices) {
            let turns_back = goes_on && Some(next) == reverse;
            let log_choices = after.log_choices + f64::from(choice);
            let choice_metres = costs.choice * f64::from(choice);
            let cost = cost + choice_metres + if turns_back { costs.u_turn } else { 0.0 };
            if cost > costs.most {
                continue;
            }
            let u_turns = after.u_turns + u32::from(turns_back);
            self.search.offer(next, edge, cost, Reached { u_turns, log_choices, ..after }, false);
        }
    }

    /// Route of the last search to the start of an edge, if it was found.
    #[must_use]
    pub fn reached(&self, edge: usize) -> Option<Reached> {
        self.search.settled(edge).map(|label| label.way)
    }

    /// Edges of the route of the last search from `from` to an edge, with both; empty if it was
    /// not found.
    #[must_use]
    pub fn route(&self, from: usize, edge: usize) -> Vec<usize> {
        let Some(mut label) = self.search.settled(edge) else { return Vec::new() };
        let mut route = vec![edge];
        loop {
            let before = label.before as usize;
            route.push(before);
            // The first edge may itself be reached again, by a loop: the route starts before an
            // edge that follows it directly.
            let follows = label.way.metres == 0.0 && label.way.chords == 0.0;
            match self.search.met(before) {
                Some(met) if !(before == from && follows) => label = met,
                _ => break,
            }
        }
        route.reverse();
        route
    }
}
