//! The matcher: a network, an index of its edges, and a model of drives.

use super::candidates::{Candidate, deviation, metres_between, on_edge};
use super::fingerprint::fingerprint;
use super::moves::{Interval, Move, Ways, speed_of};
use super::{MatchError, MatchModel, TracePoint};
use crate::inference::Trellis;
use crate::map::{
    Coordinates, EdgeIndex, NearEdge, Position, RoadNetwork, RouteMeasures, RouteSearch,
};
use crate::motion::{EdgeTurns, TurnWeights};

/// Places positions of vehicles on a road network.
///
/// See the [module](super) for the model and an example. A matcher is immutable, and can be shared
/// by threads; each thread has a [`MatchMemory`].
#[derive(Debug, Clone)]
pub struct Matcher<P = Position> {
    pub(super) network: RoadNetwork<P>,
    pub(super) index: EdgeIndex,
    pub(super) measures: RouteMeasures,
    pub(super) model: MatchModel,
    /// Fingerprint of the network.
    pub(super) fingerprint: u64,
}

/// Memory of a thread for the search of roads and routes: some 70 bytes an edge of the network.
#[derive(Debug, Clone, Default)]
pub struct MatchMemory {
    pub(super) search: RouteSearch,
    pub(super) near: Vec<NearEdge>,
    entries: Vec<Vec<(usize, f64, Move)>>,
    /// Moves of the last step, in the order in which they are in the trellis.
    pub(super) moves: Vec<Move>,
}

/// Most edges near a point, the nearest: moves grow with their square.
const MOST_CANDIDATES: usize = 64;
/// Logarithm of the share of the belief below which the way from a state is not looked for.
const NEGLIGIBLE: f64 = -14.0;
/// Logarithm of the weight below which a move is left out.
const LEAST_WEIGHT: f64 = -40.0;
/// Share of the belief from which on a state goes on where its road leads, even if no position
/// is near: e^-3.5.
const CARRIED: f64 = -3.5;
/// Most ways of a state that goes on, and most states that are added for them.
const CARRIED_WAYS: usize = 8;
const MOST_CARRIED: usize = 16;

impl<P: Coordinates> Matcher<P> {
    /// Builds the index of a network, with the default model. O(points log).
    #[must_use]
    pub fn new(network: RoadNetwork<P>) -> Self {
        let index = EdgeIndex::new(&network);
        let prior = TurnWeights::default();
        let measures =
            RouteMeasures::with_turns(&network, |edge, next| prior.weight_of(&network, edge, next));
        let fingerprint = fingerprint(&network);
        Self { network, index, measures, model: MatchModel::default(), fingerprint }
    }

    /// Replaces the model.
    ///
    /// # Errors
    ///
    /// [`MatchError::Parameter`] for a parameter out of range.
    pub fn with_model(self, model: MatchModel) -> Result<Self, MatchError> {
        model.check()?;
        Ok(Self { model, ..self })
    }

    /// Replaces the weights of turns at junctions, by class of road by default, by those learned
    /// from drives or from traffic.
    ///
    /// ```
    /// use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// use wayfix::matching::{MatchMemory, Matcher, TracePoint};
    /// use wayfix::motion::{EdgeTurns, TurnWeights};
    /// use wayfix::transition::MoveCounts;
    ///
    /// // Two ways from west to east, and a point in the middle between them.
    /// let at = |x, y| PlanePosition { x, y };
    /// let mut builder = NetworkBuilder::new();
    /// for (id, x, y) in [(1, 0.0, 0.0), (2, 100.0, 0.0), (3, 150.0, 9.0), (4, 150.0, -9.0), (5, 200.0, 0.0)] {
    ///     builder.node(id, at(x, y))?;
    /// }
    /// let [start, _, south] = [(1, 2), (2, 3), (2, 4)]
    ///     .map(|(from, to)| builder.one_way(from, to, RoadClass::Street).unwrap());
    /// builder.one_way(3, 5, RoadClass::Street)?;
    /// builder.one_way(4, 5, RoadClass::Street)?;
    /// let network = builder.build()?;
    /// let drive = [(0.0, 20.0), (10.0, 130.0)].map(|(time, x)| TracePoint::new(time, at(x, 0.0)));
    ///
    /// // A driver went south, and the prior counts as much as a twentieth of that.
    /// let counts = MoveCounts::of_path(&[start, south]);
    /// let turns = EdgeTurns::fit(&network, &counts, &TurnWeights::default(), 0.05)?;
    /// let mut memory = MatchMemory::default();
    /// let matcher = Matcher::new(network);
    /// let p = |matcher: &Matcher<_>, memory: &mut _| -> Result<f64, wayfix::matching::MatchError> {
    ///     let edges = matcher.match_drive(&drive, memory)?.edges(1);
    ///     Ok(edges.iter().filter(|edge| edge.0 == south).map(|edge| edge.1).sum())
    /// };
    /// let before = p(&matcher, &mut memory)?;
    /// let after = p(&matcher.with_turns(&turns), &mut memory)?;
    /// assert!((before - 0.5).abs() < 0.01 && after > 0.8);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    ///
    /// If the network of the turns has fewer edges: they must be those of this network.
    #[must_use]
    pub fn with_turns(mut self, turns: &EdgeTurns) -> Self {
        let probability = |edge, next| turns.turn(edge, next);
        self.measures = RouteMeasures::with_turns(&self.network, probability);
        self
    }

    /// The network.
    #[must_use]
    pub fn network(&self) -> &RoadNetwork<P> {
        &self.network
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &MatchModel {
        &self.model
    }

    /// Straight distance between two points in metres.
    fn interval(model: &MatchModel, before: &TracePoint<P>, point: &TracePoint<P>) -> Interval {
        let jitter = deviation(model, before).hypot(deviation(model, point));
        let speed = before.speed.zip(point.speed).map(|(a, b)| 0.5 * (a + b));
        let metres = before.position.metres_to(point.position);
        Interval { seconds: point.time - before.time, metres, jitter, speed }
    }

    /// Adds the first step of a drive to a trellis. Returns its states.
    pub(super) fn begin(
        &self,
        model: &MatchModel,
        point: &TracePoint<P>,
        memory: &mut MatchMemory,
        trellis: &mut Trellis,
    ) -> Result<Vec<Candidate>, MatchError> {
        let mut states = self.candidates(model, point, memory);
        states.push(Candidate::off_road(point, model));
        trellis.begin_step();
        let [leaves, returns] = [model.leaves(1.0), model.returns(1.0)];
        let off_road = (leaves / (leaves + returns)).ln();
        for state in &states {
            let prior = if state.is_off_road() { off_road } else { 0.0 };
            trellis.state(state.log_likelihood, [(0, prior)])?;
        }
        Ok(states)
    }

    /// States on roads near a point.
    fn candidates(
        &self,
        model: &MatchModel,
        point: &TracePoint<P>,
        memory: &mut MatchMemory,
    ) -> Vec<Candidate> {
        let reach = 4.0 * deviation(model, point) + 10.0;
        self.index.near(&self.network, point.position, reach, &mut memory.near);
        if memory.near.len() > MOST_CANDIDATES {
            let nearer = |a: &NearEdge, b: &NearEdge| {
                a.metres_off.total_cmp(&b.metres_off).then(a.edge.cmp(&b.edge))
            };
            memory.near.sort_unstable_by(nearer);
            memory.near.truncate(MOST_CANDIDATES);
            memory.near.sort_unstable_by_key(|near| near.edge);
        }
        let state =
            |near: &NearEdge| on_edge(near, self.network.edges()[near.edge].metres, model, point);
        memory.near.iter().map(state).collect()
    }

    /// Adds a step to a trellis, with the moves from the states of the step before, whose
    /// probabilities are given. Returns its states. On an error the trellis is as before.
    pub(super) fn advance(
        &self,
        model: &MatchModel,
        before: &Before<'_, P>,
        point: &TracePoint<P>,
        memory: &mut MatchMemory,
        trellis: &mut Trellis,
    ) -> Result<Vec<Candidate>, MatchError> {
        let interval = Self::interval(model, before.point, point);
        let mut states = self.candidates(model, point, memory);
        self.carry(model, before, &interval, point, &mut states);
        states.push(Candidate::off_road(point, model));

        let [leaves, returns] = [model.leaves(interval.seconds), model.returns(interval.seconds)];
        memory.entries.resize_with(memory.entries.len().max(states.len()), Vec::new);
        memory.entries.iter_mut().for_each(Vec::clear);
        let (off_road, by_speed) = (states.len() - 1, interval.off_road().ln());
        for (number, (from, log)) in before.states.iter().zip(before.log_filtered).enumerate() {
            if from.is_off_road() {
                let on_road = returns.ln() + by_speed;
                memory.entries[..off_road]
                    .iter_mut()
                    .for_each(|list| list.push((number, on_road, Move::OffRoad)));
                memory.entries[off_road].push((
                    number,
                    (-returns).ln_1p() + by_speed,
                    Move::OffRoad,
                ));
                continue;
            }
            if *log < NEGLIGIBLE {
                continue;
            }
            memory.entries[off_road].push((number, leaves.ln() + by_speed, Move::OffRoad));
            let Self { network, measures, .. } = self;
            let mut ways = Ways { network, measures, search: &mut memory.search };
            ways.from(from, &states, model, &interval);
            let stays = (-leaves).ln_1p();
            for (to, list) in states[..off_road].iter().zip(&mut memory.entries) {
                let Some(way) = ways.way(from, to, interval.jitter) else { continue };
                let fastest = self.speed(from).max(self.speed(to));
                let (log, moved) = interval.weight(model, &way, fastest, to.inlier);
                if log > LEAST_WEIGHT {
                    list.push((number, stays + log, moved));
                }
            }
        }
        trellis.begin_step();
        memory.moves.clear();
        for (state, entries) in states.iter().zip(&memory.entries) {
            trellis.state(state.log_likelihood, entries.iter().map(|entry| (entry.0, entry.1)))?;
            memory.moves.extend(entries.iter().map(|entry| entry.2));
        }
        Ok(states)
    }

    fn speed(&self, state: &Candidate) -> f64 {
        let edge = &self.network.edges()[state.edge as usize];
        edge.speed.unwrap_or(0.0).max(speed_of(edge.class))
    }

    /// Adds the places where vehicles would be that went on at their speed, where no state is near:
    /// a position may be far off.
    fn carry(
        &self,
        model: &MatchModel,
        before: &Before<'_, P>,
        interval: &Interval,
        point: &TracePoint<P>,
        states: &mut Vec<Candidate>,
    ) {
        let metres = before.speed * interval.seconds;
        let near_by = states.len();
        for (from, log) in before.states.iter().zip(before.log_filtered) {
            if from.is_off_road() || *log < CARRIED {
                continue;
            }
            let mut ends = [(0, 0.0); CARRIED_WAYS];
            let count = self.ends_of_ways(from.edge as usize, from.along + metres, &mut ends);
            for &(edge, along) in &ends[..count] {
                let is_near = |state: &Candidate| {
                    state.edge as usize == edge
                        && (state.along - along).abs() < 3.0 * interval.jitter
                };
                if !states.iter().any(is_near) && states.len() < near_by + MOST_CARRIED {
                    states.push(self.carried(model, edge, along, point));
                }
            }
        }
    }

    /// State at a place of an edge, whatever the position.
    fn carried(
        &self,
        model: &MatchModel,
        edge: usize,
        along: f64,
        point: &TracePoint<P>,
    ) -> Candidate {
        let place = self.network.position_along(edge, along).to_plane();
        let off = metres_between::<P>(place, point.position.to_plane());
        let near = NearEdge {
            edge,
            metres_along: along,
            metres_off: off,
            across: off,
            beyond: 0.0,
            point: place,
            direction: [0.0; 2],
        };
        let length = self.network.edges()[edge].metres;
        on_edge(&near, length, model, &TracePoint { heading: None, ..*point })
    }

    /// Finds the places so many metres from the start of an edge, along all ways without U-turns,
    /// as long as there is room. Returns their number.
    fn ends_of_ways(&self, edge: usize, metres: f64, ends: &mut [(usize, f64)]) -> usize {
        let mut open = [(0, 0.0); CARRIED_WAYS];
        (open[0], ends[0]) = ((edge, metres), (edge, 0.0));
        let (mut waiting, mut found, mut visited) = (1, 0, 0);
        while waiting > 0 {
            waiting -= 1;
            let (edge, metres) = open[waiting];
            let left = metres - self.network.edges()[edge].metres;
            visited += 1;
            let reverse = self.network.reverse(edge);
            let mut next = self.network.next(edge).filter(|next| Some(*next) != reverse).peekable();
            if left <= 0.0 || next.peek().is_none() || visited > 200 {
                if found < ends.len() {
                    ends[found] = (edge, metres.min(self.network.edges()[edge].metres));
                    found += 1;
                }
                continue;
            }
            for next in next {
                if found + waiting < open.len() {
                    open[waiting] = (next, left);
                    waiting += 1;
                }
            }
        }
        found
    }
}

/// The step before, with the filtered distribution of its states.
pub(super) struct Before<'a, P> {
    pub(super) point: &'a TracePoint<P>,
    pub(super) states: &'a [Candidate],
    pub(super) log_filtered: &'a [f64],
    /// Speed in metres per second by which vehicles go on unseen.
    pub(super) speed: f64,
}
