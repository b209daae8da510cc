//! The part of a network that searches for the same targets have met.
//!
//! All states of a point search for the states of the next one, over nearly the same edges. Each
//! edge is looked up in the network once: its length, its turns with their costs, and a lower bound
//! of the distance from its end to the targets. Edges have numbers of their own here, in the order
//! in which they are met, so that everything that a search reads lies close together in memory.

use std::ops::Range;

use super::RoadNetwork;
use super::route::{RouteCosts, RouteMeasures, distance};

/// Edges that were met, by their numbers in the neighbourhood.
#[derive(Debug, Clone, Default)]
pub(super) struct Neighbourhood {
    /// For each edge of the network, the neighbourhood in which it was last met, and its number
    /// there.
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
    pub(super) left: f64,
    /// Turns out of it, once a search has left it.
    turns: Option<Range<u32>>,
}

/// A turn onto another edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct MetTurn {
    pub(super) to: u32,
    /// Index of that edge in the network, which breaks ties between routes of equal cost, so that
    /// these do not depend on the order in which edges were met.
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
            // Every target's start is in the ball, so it is at least the distance to the centre
            // less the radius away, and a route to it at least the network's bound for that
            // distance.
            let left = measures.bound.at(distance(measures.nodes[found.to], centre) - radius);
            let (edge, metres) = (edge as u32, found.metres);
            self.edges.push(MetEdge { edge, is_target: false, metres, chord, left, turns: None });
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
