//! Turns from edge to edge, with their probabilities: those out of an edge sum to one, unless there
//! are none. They are the entries of M between the last cell of an edge and the first of the next.
//!
//! They follow from weights of road classes, or are learned from drives (the mean of a Dirichlet
//! posterior) or from counts of traffic (proportional fitting).

use crate::{NetworkError, RoadNetwork};
use wayfix::TransitionError;
use wayfix::error::OutOfRange;
use wayfix::map::{ByClass, FittedTurn, MapError, TurningRule};
use wayfix::transition::MoveCounts;

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
                return Err(OutOfRange::new(what, value, expected).into());
            }
        }
        if !(self.u_turn >= 0.0 && self.u_turn.is_finite()) {
            let what = "the U-turn factor".to_owned();
            let expected = "a finite value of at least 0";
            return Err(OutOfRange::new(what, self.u_turn, expected).into());
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
            wayfix::transition::kit::check_count("turns", turns.len())?;
            starts.push(turns.len() as u32);
        }
        turns.shrink_to_fit();
        Ok(Self { starts, turns })
    }

    /// Lists the same turns by the edge after.
    pub(super) fn reversed(&self) -> Self {
        // Counting sort by the edge after, which keeps the edges before in ascending order.
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

/// Largest error of a flow on an edge, relative to it.
const TOLERANCE: f64 = 1e-9;
/// Rounds after which fitting gives up.
const ROUNDS: usize = 100_000;

/// Turning probabilities from edge to edge of a network, learned from data, with the data behind
/// each turn. Unlike those of [places](wayfix::map::TurningProbabilities), they depend on where a
/// vehicle comes from.
///
/// For [`CellTransition::with_turns`](super::CellTransition::with_turns). Memory: 20 bytes for each
/// turn with a probability above 0, and 4 bytes an edge.
#[derive(Debug, Clone)]
pub struct EdgeTurns {
    pub(super) turns: Turns,
    counts: Vec<f64>,
}

impl EdgeTurns {
    /// Learns from counted moves from edge to edge, such as those of the routes of matched drives,
    /// with a prior by road class: weights that count as `prior_moves` moves out of each edge.
    ///
    /// The result is the mean of the posterior, (n_j + w φ_j) / (n + w), as in
    /// [`TurningProbabilities::fit`](wayfix::map::TurningProbabilities::fit). Moves from an edge to
    /// itself do not count as turns, unless it is a loop. O(turns log moves).
    ///
    /// ```
    /// use wayfix_roads::NetworkBuilder;
    /// use wayfix::map::{PlanePosition, RoadClass};
    /// use wayfix_roads::cells::{EdgeTurns, TurnWeights};
    /// use wayfix::transition::MoveCounts;
    ///
    /// let mut builder = NetworkBuilder::new();
    /// for (id, x, y) in [(1, 0.0, 0.0), (2, 100.0, 0.0), (3, 200.0, 50.0), (4, 200.0, -50.0)] {
    ///     builder.node(id, PlanePosition { x, y })?;
    /// }
    /// let [out, left, right] = [(1, 2), (2, 3), (2, 4)]
    ///     .map(|(from, to)| builder.one_way(from, to, RoadClass::Street).unwrap());
    /// let network = builder.build()?;
    ///
    /// let moves = MoveCounts::of_path(&[out, right]);
    /// let turns = EdgeTurns::fit(&network, &moves, &TurnWeights::default(), 2.0)?;
    /// assert_eq!((turns.turn(out, left), turns.turn(out, right)), (1.0 / 3.0, 2.0 / 3.0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError::Parameter`] for a weight out of its range,
    /// [`TransitionError::OutOfRange`] for an edge that does not exist, and
    /// [`TransitionError::Forbidden`] for a move to an edge that may not follow.
    pub fn fit<P>(
        network: &RoadNetwork<P>,
        counts: &MoveCounts,
        weights: &TurnWeights,
        prior_moves: f64,
    ) -> Result<Self, TransitionError> {
        if !(prior_moves >= 0.0 && prior_moves.is_finite()) {
            let expected = "a finite value of at least 0";
            let what = "the weight of the prior".to_owned();
            return Err(OutOfRange::new(what, prior_moves, expected).into());
        }
        let states = network.edges().len();
        for moved in counts.moves() {
            let (from, to) = (moved.from, moved.to);
            if from >= states || to >= states {
                return Err(TransitionError::OutOfRange { to, from, states });
            }
            if from != to && moved.weight != 0.0 && !network.next(from).any(|next| next == to) {
                return Err(TransitionError::Forbidden { to, from });
            }
        }
        let prior = Turns::new(network, weights)?;
        let (mut starts, mut turns, mut behind) = (vec![0], Vec::new(), Vec::new());
        for edge in 0..states {
            let start = turns.len();
            for next in network.next(edge) {
                let count = counts.get(edge, next);
                let value = count + prior_moves * prior.probability(edge, next);
                if value > 0.0 {
                    turns.push((next as u32, value));
                    behind.push(count);
                }
            }
            let sum: f64 = turns[start..].iter().map(|turn| turn.1).sum();
            turns[start..].iter_mut().for_each(|turn| turn.1 /= sum);
            // Without counts or a prior, the edge takes its turns from the weights, with counts of
            // 0.
            if turns.len() == start {
                turns.extend_from_slice(prior.of(edge));
                behind.resize(turns.len(), 0.0);
            }
            starts.push(turns.len() as u32);
        }
        Ok(Self { turns: Turns { starts, turns }, counts: behind })
    }

    /// Learns from counts of traffic, one per edge, without observing any turn: takes the
    /// [consistent flow](RoadNetwork::consistent_flow) nearest to the counts and, at each node, the
    /// turns nearest to the weights that turn the flows into the node into the flows out of it, by
    /// iterative proportional fitting (Deming and Stephan, 1940).
    ///
    /// **What counts say, and what they don't**: at a junction of a edges in and b out, they
    /// determine a + b − 1 of the a b numbers that turns have. The weights give the others: fitting
    /// scales the turns of each edge in and of each edge out by a factor, and so keeps all ratios
    /// (p_ij p_kl) / (p_il p_kj) of the weights, U-turns included. Edges without traffic follow the
    /// weights.
    ///
    /// O(rounds × turns).
    ///
    /// # Errors
    ///
    /// [`NetworkError`] for invalid counts, if no flow is consistent with them, or if the turns
    /// with weights above 0 cannot carry it at some node.
    pub fn fit_traffic<P>(
        network: &RoadNetwork<P>,
        counts: &[f64],
        weights: &TurnWeights,
    ) -> Result<Self, NetworkError> {
        let mut turns = Turns::new(network, weights)?;
        let flow = network.consistent_flow(counts)?;
        let mut into = vec![Vec::new(); network.nodes().len()];
        for (edge, road) in network.edges().iter().enumerate() {
            into[road.to].push(edge);
        }
        let mut behind = vec![0.0; turns.turns.len()];
        for (node, into) in into.iter().enumerate() {
            let range = |edge: usize| turns.starts[edge] as usize..turns.starts[edge + 1] as usize;
            let with_traffic: Vec<_> = into
                .iter()
                .filter(|edge| flow[**edge] > 0.0)
                .map(|edge| (flow[*edge], range(*edge)))
                .collect();
            let out = network.edges_from(node);
            let fitted = fit(&mut turns.turns, &with_traffic, out.start, &flow[out]);
            fitted.map_err(|error| MapError::Unbalanced { id: network.nodes()[node].id, error })?;
            for (flow, range) in with_traffic {
                let turns = &turns.turns[range.clone()];
                behind[range]
                    .iter_mut()
                    .zip(turns)
                    .for_each(|(count, turn)| *count = flow * turn.1);
            }
        }
        Ok(Self { turns, counts: behind })
    }

    /// Returns the probability that an edge is followed by another at its end.
    ///
    /// # Panics
    ///
    /// If `edge` does not exist.
    #[must_use]
    pub fn turn(&self, edge: usize, next: usize) -> f64 {
        self.turns.probability(edge, next)
    }

    /// Turns of edges with the data behind them, by the edge that is left. From counts of traffic,
    /// `count` is the expected number of turns.
    pub fn turns(&self) -> impl Iterator<Item = FittedTurn> {
        let edges = self.turns.starts.windows(2).enumerate().flat_map(|(edge, range)| {
            (range[0] as usize..range[1] as usize).map(move |at| (edge, at))
        });
        edges.map(|(edge, at)| {
            let (next, probability) = self.turns.turns[at];
            FittedTurn { from: edge, to: next as usize, probability, count: self.counts[at] }
        })
    }
}

/// Scales the turns of edges into a node, given with their flows, until they yield the flows out of
/// it, whose edges are numbered from `first`; returns the remaining error if they don't.
fn fit(
    turns: &mut [(u32, f64)],
    into: &[(f64, std::ops::Range<usize>)],
    first: usize,
    out: &[f64],
) -> Result<(), f64> {
    let mut error = 0.0;
    // Each round scales the columns (edges out) to their flows, then the rows (edges in) to one.
    // Rows are exact after a round, so the error of the columns alone shows how far the fit has
    // come.
    for _ in 0..ROUNDS {
        let mut sums = vec![0.0; out.len()];
        for (flow, range) in into {
            for turn in &turns[range.clone()] {
                sums[turn.0 as usize - first] += flow * turn.1;
            }
        }
        error = 0.0;
        for (sum, out) in sums.iter().zip(out) {
            // Two zeros agree. Otherwise the larger one is above 0, so the division is safe.
            if sum != out {
                error = f64::max(error, (sum - out).abs() / out.max(*sum));
            }
        }
        if error <= 2.0 * TOLERANCE {
            return Ok(());
        }
        for (_, range) in into {
            let mut whole = 0.0;
            for turn in &mut turns[range.clone()] {
                let at = turn.0 as usize - first;
                turn.1 *= if sums[at] > 0.0 { out[at] / sums[at] } else { 0.0 };
                whole += turn.1;
            }
            if !(whole > 0.0 && whole.is_finite()) {
                return Err(1.0);
            }
            turns[range.clone()].iter_mut().for_each(|turn| turn.1 /= whole);
        }
    }
    Err(error)
}
