//! Cheapest routes from one edge to several others, up to a largest cost.
//!
//! This is Dijkstra's algorithm with edges as vertices, so that turns have costs or are forbidden.
//! It stops at the last target, and prunes, as A* does, where the cost so far plus a lower bound of
//! the rest exceeds the largest cost.
//!
//! **Neighbourhood.** All states of a point search for the states of the next one, over nearly the
//! same edges. Each edge is looked up in the network once: its length, its turns with their costs,
//! and a lower bound of the distance from its end to the targets. Edges are numbered in the order
//! they are met, so that everything a search reads lies close together in memory.
//!
//! **Lower bounds from straight distances.** An edge may be shorter than the straight line between
//! its ends: lengths in files are rounded, and some are wrong. For any share r, call
//! max(0, r s − l) the deficit of an edge of l metres between ends s metres apart: the edge has at
//! least r s metres less its deficit. A shortest route uses each edge at most once, so the deficits
//! of its edges sum to at most D(r), that of the whole network; and the sum of their s is at least
//! the distance d between its ends. So it has at least r d − D(r) metres.
//!
//! The best r for a distance d is the largest l / s among the worst edges that add up to d straight
//! metres: the bound is then the length of a route made of the worst edges. Rounding affects mostly
//! edges of centimetres, which have few metres in all, so r is near 1 even for short distances. For
//! d = 0, r is the least l / s, and D(r) is 0.

use std::ops::Range;

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
    /// If the edge does not exist.
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
        let (most, mut targets_left) = (most.max(0.0), *targets);
        // A metre and a billionth exceed the rounding of the sums and of the bound, so pruning
        // never costs a route.
        let farthest = most * (1.0 + 1e-9) + 1.0;
        if targets_left == 0 {
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
                // also be a target: it counts when a loop comes back to it.
                targets_left -= usize::from(edge.is_target);
                if targets_left == 0 {
                    return;
                }
                let (metres, chords) = (reached.metres + edge.metres, reached.chords + edge.chord);
                (cost, after) = (up_to + edge.metres, Reached { metres, chords, ..reached });
            }
            // A cost is at least the length, so the least length left to a target is a lower bound
            // of the cost left.
            if cost <= most && cost + edge.least_to_target <= farthest {
                let turns = neighbourhood.turns(network, measures, number, *costs);
                for turn in turns {
                    let cost = cost + turn.cost;
                    if cost <= most {
                        let log_choices = after.log_choices + turn.log_choice;
                        let u_turns = after.u_turns + u32::from(turn.is_u_turn);
                        let way = Reached { u_turns, log_choices, ..after };
                        let to = (turn.to as usize, turn.edge);
                        // Among equal costs the rank, the index of the edge in the network,
                        // decides, whatever order the edges were met in.
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
            // A loop may come back to the first edge. So the route does not start wherever that
            // edge occurs, but where the next edge follows it at 0 metres.
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

/// Edges that were met, by their numbers in the neighbourhood.
#[derive(Debug, Clone, Default)]
pub(super) struct Neighbourhood {
    /// For each edge of the network, the last neighbourhood that met it, and its number there.
    met: Vec<(u32, u32)>,
    number: u32,
    edges: Vec<MetEdge>,
    turns: Vec<MetTurn>,
    targets: Targets,
}

#[derive(Debug, Clone)]
pub(super) struct MetEdge {
    /// Index in the network.
    pub(super) edge: u32,
    pub(super) is_target: bool,
    pub(super) metres: f64,
    /// Straight distance between its ends.
    pub(super) chord: f64,
    /// Least metres from its end to a target.
    pub(super) least_to_target: f64,
    /// Turns out of it, once a search has left it.
    turns: Option<Range<u32>>,
}

/// A turn onto another edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct MetTurn {
    pub(super) to: u32,
    /// Index of that edge in the network, which breaks ties between routes of equal cost, so that
    /// these do not depend on the order the edges were met in.
    pub(super) edge: u32,
    /// True for a U-turn where there is another way to continue.
    pub(super) is_u_turn: bool,
    /// −ln p of the turn.
    pub(super) log_choice: f64,
    pub(super) cost: f64,
}

/// Ball in space that contains the starts of all targets.
#[derive(Debug, Clone, Copy, Default)]
struct Targets {
    centre: [f64; 3],
    radius: f64,
}

impl Neighbourhood {
    /// Starts a new neighbourhood around targets.
    pub(super) fn begin<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        targets: impl Iterator<Item = usize> + Clone,
    ) {
        self.met.resize(network.edges().len(), (0, 0));
        // A new number invalidates all edges at once; before numbers repeat, the table is erased.
        self.number = self.number.checked_add(1).unwrap_or_else(|| {
            self.met.fill((0, 0));
            1
        });
        self.edges.clear();
        self.turns.clear();
        let mut starts = targets.clone().map(|target| measures.nodes[network.edges()[target].from]);
        // Any centre gives a valid ball; the start of the first target is as good as another.
        let centre = starts.next().unwrap_or_default();
        let radius = starts.map(|start| distance(centre, start)).fold(0.0, f64::max);
        self.targets = Targets { centre, radius };
        for target in targets {
            let number = self.meet(network, measures, target);
            self.edges[number as usize].is_target = true;
        }
    }

    /// Number of an edge, if it was met.
    pub(super) fn find(&self, edge: usize) -> Option<usize> {
        let &(number, found) = self.met.get(edge)?;
        (number == self.number).then_some(found as usize)
    }

    /// Number of edges that were met.
    pub(super) fn len(&self) -> usize {
        self.edges.len()
    }

    pub(super) fn edge(&self, number: usize) -> &MetEdge {
        &self.edges[number]
    }

    /// Number of an edge, which is met now if it was not before.
    pub(super) fn meet<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        edge: usize,
    ) -> u32 {
        let Targets { centre, radius } = self.targets;
        let met = &mut self.met[edge];
        if met.0 != self.number {
            *met = (self.number, self.edges.len() as u32);
            let (found, chord) = (&network.edges()[edge], measures.straight_metres(edge));
            // Every target starts in the ball, so it is at least the distance to the centre less
            // the radius away. A route to it is at least as long as the network's bound for that
            // distance.
            let least_to_target =
                measures.bound.at(distance(measures.nodes[found.to], centre) - radius);
            let (edge, metres) = (edge as u32, found.metres);
            self.edges.push(MetEdge {
                edge,
                is_target: false,
                metres,
                chord,
                least_to_target,
                turns: None,
            });
        }
        met.1
    }

    /// Turns out of an edge, looked up the first time.
    pub(super) fn turns<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        number: usize,
        costs: RouteCosts,
    ) -> &[MetTurn] {
        let turns = match &self.edges[number].turns {
            Some(turns) => turns.clone(),
            None => self.look_up(network, measures, number, costs),
        };
        &self.turns[turns.start as usize..turns.end as usize]
    }

    fn look_up<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        number: usize,
        costs: RouteCosts,
    ) -> Range<u32> {
        let (edge, first) = (self.edges[number].edge as usize, self.turns.len() as u32);
        let (reverse, choices) = (network.reverse(edge), measures.choices_after(edge));
        // At a dead end, going back is the only choice and does not count as a U-turn.
        let goes_on = choices.len() > 1;
        for (next, &choice) in network.next(edge).zip(choices) {
            let is_u_turn = goes_on && Some(next) == reverse;
            let (to, log_choice) = (self.meet(network, measures, next), f64::from(choice));
            let cost = costs.choice * log_choice + if is_u_turn { costs.u_turn } else { 0.0 };
            self.turns.push(MetTurn { to, edge: next as u32, is_u_turn, log_choice, cost });
        }
        let turns = first..self.turns.len() as u32;
        self.edges[number].turns = Some(turns.clone());
        turns
    }
}

/// Straight distances in metres for which the bound is tightest.
const BEST_AT: [f64; 3] = [0.0, 100.0, 1000.0];

/// Lower bounds on the lengths of the shortest routes in a network.
#[derive(Debug, Clone, Copy)]
pub(super) struct LengthBound {
    /// Least length per straight metre, r, and the deficit of all edges, D(r).
    lines: [[f64; 2]; BEST_AT.len()],
}

impl LengthBound {
    /// Bounds of a network, given the length and straight distance of each edge. O(n log n) for the
    /// n edges that are shorter than straight.
    pub(super) fn new(edges: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut short: Vec<_> = edges.filter(|[metres, straight]| metres < straight).collect();
        short.sort_unstable_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
        let line = |distance: f64| {
            let (mut lengths, mut straights) = (0.0, 0.0);
            for [metres, straight] in &short {
                // With r = `share`, the ratio of this edge, exactly the edges before it, whose
                // ratios are lower, lack length: r Σ s − Σ l in all.
                if straights + straight > distance {
                    let share = metres / straight;
                    return [share, f64::max(share * straights - lengths, 0.0)];
                }
                lengths += metres;
                straights += straight;
            }
            // All short edges together are shorter than the distance, so r = 1.
            [1.0, straights - lengths]
        };
        Self { lines: BEST_AT.map(line) }
    }

    /// Least length in metres of a route between places `distance` metres apart.
    #[inline]
    pub(super) fn at(&self, distance: f64) -> f64 {
        let bounds = self.lines.map(|[share, lacking]| share * distance - lacking);
        // Each line is a bound for every distance, so the largest is also one.
        bounds.into_iter().fold(f64::NEG_INFINITY, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_the_worst_edges() {
        let exact = LengthBound::new([[120.0, 120.0], [90.0, 70.0]].into_iter());
        assert_eq!([0.0, 1.0, 5000.0].map(|metres| exact.at(metres)), [0.0, 1.0, 5000.0]);
        // A thousand edges of 3 cm that were rounded down to 2 cm, and one of half its distance.
        let rounded = std::iter::repeat_n([0.02, 0.03], 1000);
        let edges = rounded.chain([[40.0, 80.0], [1e4, 1e4]]);
        let bound = LengthBound::new(edges);
        for (distance, expected) in [(40.0, 20.0), (95.0, 50.0), (110.0, 60.0), (5000.0, 4950.0)] {
            assert!((bound.at(distance) - expected).abs() < 1e-9, "{distance}");
        }
    }
}
