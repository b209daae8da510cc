//! The part of a network in which searches for the same targets run.
//!
//! All states of a point search for the states of the next one, over nearly the same edges. Each
//! edge is looked up in the network once: its length, its turns with their costs, and how far it is
//! from its end to the targets at least. Here edges have numbers of their own, in the order in
//! which they are met, so that all that a search reads lies side by side.

use std::ops::Range;

use super::RoadNetwork;
use super::route::{RouteCosts, RouteMeasures, distance};

/// Edges that were met, by their numbers here.
#[derive(Debug, Clone, Default)]
pub(super) struct Neighbourhood {
    /// The neighbourhood in which an edge of the network was met last, and its number there.
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
    /// Turns out of it, once it was left.
    turns: Option<Range<u32>>,
}

/// A turn onto another edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct MetTurn {
    pub(super) to: u32,
    /// Index of that edge in the network, which decides between routes of equal cost: they must not
    /// depend on the order in which edges were met.
    pub(super) edge: u32,
    /// True for a U-turn where another way goes on.
    pub(super) is_u_turn: bool,
    /// −ln p of the turn.
    pub(super) log_choice: f64,
    pub(super) cost: f64,
}

/// Ball around the starts of the targets, in space.
#[derive(Debug, Clone, Copy, Default)]
struct Targets {
    centre: [f64; 3],
    radius: f64,
}

impl Neighbourhood {
    /// Begins anew, around targets.
    pub(super) fn begin<P>(
        &mut self,
        network: &RoadNetwork<P>,
        measures: &RouteMeasures,
        targets: impl Iterator<Item = usize> + Clone,
    ) {
        self.met.resize(network.edges().len(), (0, 0));
        self.number = self.number.checked_add(1).unwrap_or_else(|| {
            self.met.fill((0, 0));
            1
        });
        self.edges.clear();
        self.turns.clear();
        let mut starts = targets.clone().map(|target| measures.nodes[network.edges()[target].from]);
        let centre = starts.next().unwrap_or_default();
        let radius = starts.map(|start| distance(centre, start)).fold(0.0, f64::max);
        self.targets = Targets { centre, radius };
        for target in targets {
            let number = self.meet(network, measures, target);
            self.edges[number as usize].is_target = true;
        }
    }

    /// Number of an edge that was met.
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

    /// Number of an edge.
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
            let left = measures.bound.at(distance(measures.nodes[found.to], centre) - radius);
            let (edge, metres) = (edge as u32, found.metres);
            self.edges.push(MetEdge { edge, is_target: false, metres, chord, left, turns: None });
        }
        met.1
    }

    /// Turns out of an edge, which are looked up the first time.
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
        // At a dead end, the way back is no U-turn.
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
