//! Posterior of a drive as a Markov chain over states whose moves spell out the route.
//!
//! Given all points, the states of a drive are a Markov chain with p(j → i) = ξ(j, i) / γ(j), the
//! pairwise posteriors of section 4 of the guide's formulas over their sums. The probability of a
//! route is the sum over all paths that spell it, which needs no likelihoods any more.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::RoadNetwork;
use crate::matching::MatchedDrive;
use crate::matching::candidates::{Candidate, OFF_ROAD};
use crate::matching::route::{Link, RouteEnd, RouteExtension, RouteRules, links};
use crate::matching::step::MatchStep;
use wayfix::map::Coordinates;

/// Probability up to which a move is left out.
const LEAST_MOVE: f64 = 1e-30;
/// Word after the last edge of a route.
pub(super) const END: u32 = OFF_ROAD - 1;

/// Lattice of a drive: nodes are states, one for each [`RouteEnd`] that a state is reached with,
/// between a start and an end. Arcs carry p(state | previous state, all points) and the words that
/// they add to the route: edges, off the road, and the end. All paths with the same words are one
/// route.
#[derive(Debug, Default)]
pub(super) struct Lattice {
    /// State of each node in its step; 0 for the start and the end.
    pub(super) states: Vec<u32>,
    /// Arcs out of each node; arcs lead to nodes with higher numbers.
    arcs_of: Vec<Range<u32>>,
    arcs: Vec<Arc>,
    pub(super) words: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Arc {
    pub(super) to: u32,
    pub(super) words: [u32; 2],
    pub(super) probability: f64,
}

/// Part of a route's probability that is under way along an arc, after some of its words.
#[derive(Debug, Clone, Copy)]
pub(super) struct Share {
    pub(super) to: u32,
    /// Range of the words to come.
    pub(super) words: [u32; 2],
    pub(super) probability: f64,
}

impl Share {
    pub(super) fn has_arrived(&self) -> bool {
        self.words[0] == self.words[1]
    }
}

impl Arc {
    /// Share under way along the arc, of a probability that was at its node.
    pub(super) fn share(&self, probability: f64) -> Share {
        let Self { to, words, .. } = *self;
        Share { to, words, probability: probability * self.probability }
    }
}

/// Nodes of a step by state and mode.
type Nodes = Vec<BTreeMap<RouteEnd, u32>>;

impl Lattice {
    /// Builds the lattice of a drive. O(moves) time, and that of the searches for their ways.
    pub(super) fn new<P: Coordinates>(
        network: &RoadNetwork<P>,
        drive: &MatchedDrive<P>,
        search: &mut MatchStep<'_, P>,
    ) -> Self {
        let mut lattice = Self::default();
        let start = lattice.node(0);
        let mut nodes: Nodes = vec![BTreeMap::new(); drive.states[0].len()];
        for (state, probability) in drive.smoothed.smoothed(1).iter().enumerate() {
            let mut added = RouteExtension::default();
            let mode = RouteRules::<P>::start(&drive.states[0][state], &mut added);
            if *probability > LEAST_MOVE {
                let to = lattice.node_of(&mut nodes, state, mode);
                lattice.arc(to, *probability, &added);
            }
        }
        lattice.close(start, 0);
        for step in 1..drive.states.len() {
            nodes = lattice.step(network, drive, step, &nodes, search);
        }
        let end = lattice.node(0);
        let last = &drive.states[drive.states.len() - 1];
        for (state, ends) in last.iter().zip(&nodes) {
            for (mode, node) in ends {
                let (mut added, first) = (RouteExtension::default(), lattice.arcs.len());
                RouteRules::<P>::finish(*mode, state, &mut added);
                lattice.arc(end, 1.0, &added);
                // END is a word of its own on every arc to the end, so that no route is a prefix of
                // another.
                lattice.words.push(END);
                lattice.arcs[first].words[1] += 1;
                lattice.close(*node, first);
            }
        }
        lattice
    }

    /// Adds the arcs from the given nodes to those of `step`, an index from 1. Returns its nodes.
    fn step<P: Coordinates>(
        &mut self,
        network: &RoadNetwork<P>,
        drive: &MatchedDrive<P>,
        step: usize,
        nodes: &Nodes,
        search: &mut MatchStep<'_, P>,
    ) -> Nodes {
        let [before, states] = [&drive.states[step - 1], &drive.states[step]];
        // The trellis lists moves by the state they lead to; arcs are stored by the state they
        // leave.
        let mut moves: Vec<Vec<(usize, f64)>> = vec![Vec::new(); before.len()];
        for to in 0..states.len() {
            for (from, probability) in drive.smoothed.moves(&drive.trellis, step + 1, to) {
                if probability > LEAST_MOVE {
                    moves[from].push((to, probability));
                }
            }
        }
        let rules = RouteRules(network);
        let points = [&drive.points[step - 1], &drive.points[step]];
        let mut next: Nodes = vec![BTreeMap::new(); states.len()];
        let mut targets: Vec<Candidate> = Vec::new();
        for (number, (from, moves)) in before.iter().zip(&moves).enumerate() {
            // Only the moves that are kept are summed, so that the arcs of a node sum to one.
            let sum: f64 = moves.iter().map(|to| to.1).sum();
            targets.clear();
            targets.extend(moves.iter().map(|to| states[to.0]).filter(|to| !to.is_off_road()));
            let ways = links(from, &targets, points, search);
            // The next state depends on the state alone, so all nodes of a state share its moves
            // and ways.
            for (mode, node) in &nodes[number] {
                let first = self.arcs.len();
                let mut links = ways.iter();
                for &(state, probability) in moves {
                    let (to, mut added) = (&states[state], RouteExtension::default());
                    // `ways` has one link for each target on a road, in the order of the moves, or
                    // none at all if the vehicle is off the road; then no link is looked at.
                    let link = if to.is_off_road() { None } else { links.next() };
                    let link = link.unwrap_or(&Link::SameEdge);
                    let mode = rules.advance(*mode, [from, to], link, &mut added);
                    let to = self.node_of(&mut next, state, mode);
                    self.arc(to, probability / sum, &added);
                }
                self.close(*node, first);
            }
        }
        next
    }

    fn node(&mut self, state: usize) -> u32 {
        self.states.push(state as u32);
        self.arcs_of.push(0..0);
        (self.states.len() - 1) as u32
    }

    fn node_of(&mut self, nodes: &mut Nodes, state: usize, mode: RouteEnd) -> u32 {
        *nodes[state].entry(mode).or_insert_with(|| self.node(state))
    }

    fn arc(&mut self, to: u32, probability: f64, added: &RouteExtension) {
        let first = self.words.len() as u32;
        self.words.extend(added.parts.iter().map(|part| part.edge));
        self.arcs.push(Arc { to, words: [first, self.words.len() as u32], probability });
    }

    /// Closes the arcs of a node, given the number of the first.
    fn close(&mut self, node: u32, first: usize) {
        self.arcs_of[node as usize] = first as u32..self.arcs.len() as u32;
    }

    /// Arcs out of a node.
    pub(super) fn arcs(&self, node: u32) -> &[Arc] {
        let arcs = &self.arcs_of[node as usize];
        &self.arcs[arcs.start as usize..arcs.end as usize]
    }

    /// Most probable states of a route, one per step, given its words. Ties go to the lowest node.
    pub(super) fn best_states(&self, route: &[u32]) -> Vec<u32> {
        let mut words = route.to_vec();
        words.push(END);
        // Viterbi over pairs of a node and the number of words spelled so far: for each pair of a
        // step, the probability of the best way and the previous pair.
        let mut steps = vec![BTreeMap::from([((0_u32, 0_usize), (1.0_f64, (0_u32, 0_usize)))])];
        let end = ((self.states.len() - 1) as u32, words.len());
        while steps.last().is_some_and(|step| !step.is_empty() && !step.contains_key(&end)) {
            let mut next = BTreeMap::new();
            let before = &steps[steps.len() - 1];
            // Divided by the largest of the step: products over a long drive would underflow, and
            // only ratios matter.
            let scale = before.values().map(|way| way.0).fold(0.0, f64::max);
            for (&(node, done), way) in before {
                for arc in self.arcs(node) {
                    let said = &self.words[arc.words[0] as usize..arc.words[1] as usize];
                    // Only arcs that spell the next words of this route.
                    if !words[done..].starts_with(said) {
                        continue;
                    }
                    let probability = way.0 / scale * arc.probability;
                    let best =
                        next.entry((arc.to, done + said.len())).or_insert((0.0, (node, done)));
                    // Strictly larger: pairs ascend by node, so a tie keeps the lowest.
                    if probability > best.0 {
                        *best = (probability, (node, done));
                    }
                }
            }
            // A pair whose ratio to the best underflowed could only lead to 0 / 0.
            next.retain(|_, way| way.0 > 0.0);
            steps.push(next);
        }
        let (mut states, mut at) = (Vec::new(), end);
        for step in steps.iter().skip(1).rev() {
            let Some(way) = step.get(&at) else { break };
            at = way.1;
            states.push(self.states[at.0 as usize]);
        }
        // The last state pushed is that of the start node, which stands for no point.
        states.pop();
        states.reverse();
        states
    }
}
