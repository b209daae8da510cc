//! Turns from edge to edge, with their probabilities: those out of an edge sum to one, unless there
//! are none. They are the entries of M between the last cell of an edge and the first of the next.

use crate::RoadNetwork;
use wayfix::TransitionError;
use wayfix::error::Parameter;
use wayfix::map::{ByClass, TurningRule};

/// Relative traffic of the roads out of a junction, by which a vehicle on cells turns.
///
/// Edges out of the end of an edge, except by forbidden turns, are taken in proportion to their
/// weights: that of their class, times `straight_on` from a main road to a main road, times
/// `u_turn` for the way back. If all weights are 0, as at a dead end without U-turns, all allowed
/// turns are equally likely.
///
/// By default, weights are those of a [`TurningRule`], and the way back has 0.02 of its weight.
///
/// ```
/// use wayfix::map::ByClass;
/// use wayfix_roads::cells::TurnWeights;
///
/// // A robot that takes all aisles alike, and turns back as readily.
/// let robot = TurnWeights { weight: ByClass::all(1.0), straight_on: 1.0, u_turn: 1.0 };
/// assert_ne!(robot, TurnWeights::default());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnWeights {
    /// Relative traffic that a road of each class attracts; above 0, of any scale.
    pub weight: ByClass,
    /// Factor of the weight of a main road for vehicles on one; above 0.
    pub straight_on: f64,
    /// Factor of the weight of the way back; at least 0.
    pub u_turn: f64,
}

impl Default for TurnWeights {
    fn default() -> Self {
        let TurningRule { weight, straight_on, .. } = TurningRule::default();
        Self { weight, straight_on, u_turn: 0.02 }
    }
}

impl TurnWeights {
    fn check(&self) -> Result<(), TransitionError> {
        use wayfix::map::RoadClass::{Arterial, Collector, Main, Street};
        let classes = [Main, Arterial, Collector, Street];
        let classes = classes
            .map(|class| (format!("the turn weight of class {class}"), self.weight.of(class)));
        let straight_on = ("the straight-on factor".to_owned(), self.straight_on);
        for (what, value) in classes.into_iter().chain([straight_on]) {
            if !(value > 0.0 && value.is_finite()) {
                let expected = "a finite value above 0";
                return Err(Parameter::new(what, value, expected).into());
            }
        }
        if !(self.u_turn >= 0.0 && self.u_turn.is_finite()) {
            let what = "the U-turn factor".to_owned();
            let expected = "a finite value of at least 0";
            return Err(Parameter::new(what, self.u_turn, expected).into());
        }
        Ok(())
    }

    /// Weight of a turn from an edge to one that follows it.
    pub(crate) fn weight_of<P>(&self, network: &RoadNetwork<P>, edge: usize, next: usize) -> f64 {
        let edges = network.edges();
        let main = |edge: usize| edges[edge].class == wayfix::map::RoadClass::Main;
        let straight_on = if main(edge) && main(next) { self.straight_on } else { 1.0 };
        let u_turn = if network.reverse(edge) == Some(next) { self.u_turn } else { 1.0 };
        self.weight.of(edges[next].class) * straight_on * u_turn
    }

    /// Adds the turns out of an edge, with their probabilities.
    fn turns<P>(&self, network: &RoadNetwork<P>, edge: usize, out: &mut Vec<(u32, f64)>) {
        let start = out.len();
        out.extend(
            network.next(edge).map(|next| (next as u32, self.weight_of(network, edge, next))),
        );
        let turns = &mut out[start..];
        let sum: f64 = turns.iter().map(|turn| turn.1).sum();
        let count = turns.len() as f64;
        let share = |weight: f64| {
            if sum == 0.0 { 1.0 / count } else { weight / sum }
        };
        turns.iter_mut().for_each(|turn| turn.1 = share(turn.1));
        // Turns of probability 0 are not stored: entries of M are above 0.
        let mut kept = start;
        for at in start..out.len() {
            if out[at].1 > 0.0 {
                out[kept] = out[at];
                kept += 1;
            }
        }
        out.truncate(kept);
    }
}

/// Turns of each edge with their probabilities, by the edge before or by the edge after.
#[derive(Debug, Clone)]
pub(super) struct Turns {
    pub(super) starts: Vec<u32>,
    pub(super) turns: Vec<(u32, f64)>,
}

impl Turns {
    /// Lists the turns of a network by the edge before.
    pub(super) fn new<P>(
        network: &RoadNetwork<P>,
        weights: &TurnWeights,
    ) -> Result<Self, TransitionError> {
        weights.check()?;
        let (mut starts, mut turns) = (vec![0], Vec::new());
        for edge in 0..network.edges().len() {
            weights.turns(network, edge, &mut turns);
            wayfix::internal::check_count("turns", turns.len())?;
            starts.push(turns.len() as u32);
        }
        turns.shrink_to_fit();
        Ok(Self { starts, turns })
    }

    /// Lists the same turns by the edge after.
    pub(super) fn reversed(&self) -> Self {
        // Counting sort by the edge after; within one, edges before stay in ascending order.
        let edges = self.starts.len() - 1;
        let mut starts = vec![0; edges + 1];
        self.turns.iter().for_each(|turn| starts[turn.0 as usize + 1] += 1);
        for edge in 0..edges {
            starts[edge + 1] += starts[edge];
        }
        let mut places = starts.clone();
        let mut turns = vec![(0, 0.0); self.turns.len()];
        for (edge, number) in (0..edges).zip(0..) {
            for &(next, p) in self.of(edge) {
                let place = &mut places[next as usize];
                turns[*place as usize] = (number, p);
                *place += 1;
            }
        }
        Self { starts, turns }
    }

    /// Turns of an edge: the other edge and the probability.
    pub(super) fn of(&self, edge: usize) -> &[(u32, f64)] {
        &self.turns[self.starts[edge] as usize..self.starts[edge + 1] as usize]
    }
    /// Probability of a turn; 0 if there is none.
    pub(super) fn probability(&self, edge: usize, other: usize) -> f64 {
        let found = self.of(edge).iter().find(|turn| turn.0 as usize == other);
        found.map_or(0.0, |turn| turn.1)
    }
}
