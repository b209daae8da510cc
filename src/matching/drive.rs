//! A whole drive: smoothed answers, and the route.

use super::answer::{CredibleStretches, RoadAnswer, credible, edges};
use super::candidates::{Candidate, deviation};
use super::matcher::Before;
use super::moves::{Interval, Move, Ways};
use super::vehicle::{mode, speed_after};
use super::{MatchError, MatchMemory, MatchModel, Matcher, TracePoint};
use crate::inference::{SmoothedTrellis, Trellis};
use crate::map::{Coordinates, Position};

/// A drive on a road network: the distribution of the roads at each point, and the most probable
/// route.
#[derive(Debug, Clone)]
pub struct MatchedDrive<P = Position> {
    pub(super) points: Vec<TracePoint<P>>,
    pub(super) states: Vec<Vec<Candidate>>,
    /// Moves into the states of all steps, in the order of the trellis; none in the first.
    pub(super) moves: Vec<Move>,
    pub(super) trellis: Trellis,
    pub(super) smoothed: SmoothedTrellis,
    pub(super) route: Vec<Stretch<P>>,
    /// Fingerprint of the network.
    pub(super) network: u64,
}

/// Part of a route: an edge, or a stretch off the road.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch<P = Position> {
    /// The edge; `None` off the road.
    pub edge: Option<usize>,
    /// Metres from the start of the edge where the vehicle comes onto it; 0 off the road.
    pub enter: f64,
    /// Metres from the start of the edge where it leaves it; off the road, the straight distance.
    pub exit: f64,
    /// Both ends.
    pub ends: [P; 2],
}

impl<P> Stretch<P> {
    /// Length in metres; off the road, that of the straight line.
    #[must_use]
    pub fn metres(&self) -> f64 {
        self.exit - self.enter
    }
}

impl<P: Coordinates> Matcher<P> {
    /// Matches a whole drive. Points must be in the order of time, each later than the one before.
    ///
    /// O(points · (candidates² + edges searched)) time; some 44 bytes a pair of candidates.
    ///
    /// # Errors
    ///
    /// [`MatchError::Empty`] without points, [`MatchError::Point`] for a number out of range, and
    /// [`MatchError::Time`] for times that do not ascend, each with the index of the point.
    pub fn match_drive(
        &self,
        points: &[TracePoint<P>],
        memory: &mut MatchMemory,
    ) -> Result<MatchedDrive<P>, MatchError> {
        let Built { states, trellis, moves } = self.trellis(&self.model, points, memory)?;
        let smoothed = trellis.smooth()?;
        let path = trellis.viterbi()?;
        let on_path: Vec<Candidate> =
            path.states().iter().zip(&states).map(|(state, states)| states[*state]).collect();
        let route = self.route(points, &on_path, memory);
        let points = points.to_vec();
        let network = self.fingerprint;
        Ok(MatchedDrive { points, states, moves, trellis, smoothed, route, network })
    }

    /// Line of a stretch of a [route](MatchedDrive::route): its positions with both ends; off the
    /// road, the ends alone. O(points of the edge).
    ///
    /// ```
    /// # use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// # let at = |x, y| PlanePosition { x, y };
    /// # let mut builder = NetworkBuilder::new();
    /// # [at(0.0, 0.0), at(100.0, 0.0), at(100.0, 80.0)].into_iter().zip(1..).try_for_each(|(p, id)| builder.node(id, p).map(|_| ()))?;
    /// # builder.both_ways(1, 2, RoadClass::Street)?;
    /// # builder.both_ways(2, 3, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// # use wayfix::matching::{MatchMemory, Matcher, TracePoint};
    /// // Along a street of 100 m to the east, and on to the north.
    /// let (matcher, mut memory) = (Matcher::new(network), MatchMemory::default());
    /// let drive = [(0.0, 20.0, 1.0), (6.0, 80.0, -1.0), (12.0, 101.0, 40.0)]
    ///     .map(|(time, x, y)| TracePoint::new(time, PlanePosition { x, y }));
    /// let matched = matcher.match_drive(&drive, &mut memory)?;
    /// let lines: Vec<_> = matched.route().iter().map(|stretch| matcher.line(stretch)).collect();
    /// assert_eq!(lines[0], [at(20.0, 0.0), at(100.0, 0.0)]);
    /// assert_eq!(lines[1], [at(100.0, 0.0), at(100.0, 40.0)]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    ///
    /// If the network has no such edge, as for a route of another network.
    #[must_use]
    pub fn line(&self, stretch: &Stretch<P>) -> Vec<P> {
        let Stretch { edge, enter, exit, ends } = *stretch;
        match edge {
            Some(edge) => self.network.line_between(edge, enter, exit),
            None => ends.to_vec(),
        }
    }

    /// Builds the trellis of a drive, with its states.
    pub(super) fn trellis(
        &self,
        model: &MatchModel,
        points: &[TracePoint<P>],
        memory: &mut MatchMemory,
    ) -> Result<Built, MatchError> {
        let first = points.first().ok_or(MatchError::Empty)?;
        first.check(0, None)?;
        for (number, pair) in (1..).zip(points.windows(2)) {
            pair[1].check(number, Some(&pair[0]))?;
        }
        let mut trellis = Trellis::new();
        let (mut all, mut moves) = (Vec::with_capacity(points.len()), Vec::new());
        all.push(self.begin(model, first, memory, &mut trellis)?);
        let (mut log_filtered, mut next) = (Vec::new(), Vec::new());
        trellis.forward_step(1, &[0.0], &mut log_filtered);
        let mut speed = first.speed.unwrap_or(0.0);
        for (step, pair) in points.windows(2).enumerate() {
            let before =
                Before { point: &pair[0], states: &all[step], log_filtered: &log_filtered, speed };
            let states = self.advance(model, &before, &pair[1], memory, &mut trellis)?;
            moves.extend_from_slice(&memory.moves);
            trellis.forward_step(step + 2, &log_filtered, &mut next);
            let modes = mode(&log_filtered).zip(mode(&next));
            let modes = modes.map(|(a, b)| (all[step][a], states[b]));
            let seconds = pair[1].time - pair[0].time;
            speed = pair[1].speed.unwrap_or_else(|| {
                modes.map_or(speed, |modes| speed_after::<P>(speed, modes, seconds))
            });
            std::mem::swap(&mut log_filtered, &mut next);
            all.push(states);
        }
        Ok(Built { states: all, trellis, moves })
    }

    /// Connected route through one state a point.
    pub(super) fn route(
        &self,
        points: &[TracePoint<P>],
        path: &[Candidate],
        memory: &mut MatchMemory,
    ) -> Vec<Stretch<P>> {
        let mut route = Route { matcher: self, stretches: Vec::new() };
        let mut start = 0;
        route.enter(&path[0]);
        for (step, pair) in path.windows(2).enumerate() {
            let (from, to) = (&pair[0], &pair[1]);
            match (from.is_off_road(), to.is_off_road()) {
                (true, true) => {}
                (false, true) => start = step,
                (true, false) => {
                    route.off_road(points[start].position, points[step + 1].position);
                    route.enter(to);
                }
                (false, false) => {
                    let (a, b) = (&points[step], &points[step + 1]);
                    let jitter = deviation(&self.model, a).hypot(deviation(&self.model, b));
                    let metres = a.position.metres_to(b.position);
                    let seconds = b.time - a.time;
                    let interval = Interval { seconds, metres, jitter, speed: None };
                    let Self { network, chords, .. } = self;
                    let mut ways = Ways { network, chords, search: &mut memory.search };
                    ways.from(from, std::slice::from_ref(to), &self.model, &interval);
                    route.go_on(from, to, &interval, memory);
                }
            }
        }
        if path.last().is_some_and(Candidate::is_off_road) {
            route.off_road(points[start].position, points[points.len() - 1].position);
        }
        route.stretches
    }
}

/// Trellis of a drive.
pub(super) struct Built {
    pub(super) states: Vec<Vec<Candidate>>,
    pub(super) trellis: Trellis,
    pub(super) moves: Vec<Move>,
}

/// A route that grows.
struct Route<'a, P> {
    matcher: &'a Matcher<P>,
    stretches: Vec<Stretch<P>>,
}

impl<P: Coordinates> Route<'_, P> {
    fn length(&self, edge: usize) -> f64 {
        self.matcher.network.edges()[edge].metres
    }

    fn push(&mut self, edge: usize, enter: f64, exit: f64) {
        let network = &self.matcher.network;
        let ends = [network.position_along(edge, enter), network.position_along(edge, exit)];
        self.stretches.push(Stretch { edge: Some(edge), enter, exit, ends });
    }

    fn enter(&mut self, state: &Candidate) {
        if !state.is_off_road() {
            self.push(state.edge as usize, state.along, state.along);
        }
    }

    fn off_road(&mut self, from: P, to: P) {
        let (edge, enter, exit) = (None, 0.0, from.metres_to(to));
        self.stretches.push(Stretch { edge, enter, exit, ends: [from, to] });
    }

    /// Moves the end of the route along its last edge.
    fn extend_to(&mut self, along: f64) {
        let Some(last) = self.stretches.last_mut() else { return };
        if let Some(edge) = last.edge
            && along > last.exit
        {
            last.exit = along;
            last.ends[1] = self.matcher.network.position_along(edge, along);
        }
    }

    /// Goes on to the next state, by the route of the last search.
    fn go_on(
        &mut self,
        from: &Candidate,
        to: &Candidate,
        interval: &Interval,
        memory: &MatchMemory,
    ) {
        let [edge, next] = [from.edge as usize, to.edge as usize];
        if edge == next && to.along - from.along >= -6.0 * interval.jitter {
            return self.extend_to(to.along);
        }
        let reached = memory.search.reached(next);
        let turns_on_the_way = self.matcher.network.reverse(edge) == Some(next)
            && reached.is_none_or(|reached| reached.u_turns > 0);
        if turns_on_the_way {
            let here = self.stretches.last().map_or(from.along, |last| last.exit);
            let enter = (self.length(next) - here).max(0.0).min(to.along);
            return self.push(next, enter, to.along);
        }
        let route = memory.search.route(edge, next);
        self.extend_to(self.length(edge));
        for &edge in route.iter().skip(1) {
            let exit = if edge == next { to.along } else { self.length(edge) };
            self.push(edge, 0.0, exit);
        }
    }
}

impl<P: Coordinates> MatchedDrive<P> {
    /// Points of the drive.
    #[must_use]
    pub fn points(&self) -> &[TracePoint<P>] {
        &self.points
    }

    /// Answer for a point, from 0, by the points up to it.
    ///
    /// # Panics
    ///
    /// If there is no such point; this holds for all methods that take one.
    #[must_use]
    pub fn live(&self, point: usize) -> RoadAnswer {
        RoadAnswer::new(&self.states[point], self.smoothed.filtered(point + 1))
    }

    /// Answer for a point by the points up to it and `lag` more; equal to
    /// [`Vehicle::late`](super::Vehicle::late) up to rounding.
    #[must_use]
    pub fn late(&self, point: usize, lag: usize) -> RoadAnswer {
        let probabilities = self.smoothed.lagged(&self.trellis, point + 1, lag);
        RoadAnswer::new(&self.states[point], &probabilities)
    }

    /// Answer for a point by all points of the drive.
    #[must_use]
    pub fn smoothed(&self, point: usize) -> RoadAnswer {
        RoadAnswer::new(&self.states[point], self.smoothed.smoothed(point + 1))
    }

    /// Edges with their probabilities at a point, by all points of the drive, the most probable
    /// first; those off the road are missing.
    #[must_use]
    pub fn edges(&self, point: usize) -> Vec<(usize, f64)> {
        edges(&self.states[point], self.smoothed.smoothed(point + 1))
    }

    /// Stretches of roads that held the vehicle at a point with a probability of at least `mass`,
    /// by all points of the drive, as [`Vehicle::credible`](super::Vehicle::credible) gives them.
    ///
    /// # Errors
    ///
    /// [`MatchError::Mass`] for a mass out of range, and [`MatchError::Network`] for a matcher of
    /// another network.
    pub fn credible(
        &self,
        matcher: &Matcher<P>,
        point: usize,
        mass: f64,
    ) -> Result<CredibleStretches, MatchError> {
        matcher.check_network(self.network)?;
        let sigma = deviation(&matcher.model, &self.points[point]);
        let probabilities = self.smoothed.smoothed(point + 1);
        credible(&matcher.network, &self.states[point], probabilities, sigma, mass)
    }

    /// ln p(point | all before), as a density in metres.
    #[must_use]
    pub fn log_normalizer(&self, point: usize) -> f64 {
        self.smoothed.log_normalizer(point + 1)
    }

    /// ln p(all points).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.smoothed.log_likelihood()
    }

    /// Most probable route: edges that follow each other, and stretches off the road.
    #[must_use]
    pub fn route(&self) -> &[Stretch<P>] {
        &self.route
    }

    /// Length of the route on roads in metres.
    #[must_use]
    pub fn metres(&self) -> f64 {
        let on_road = self.route.iter().filter(|stretch| stretch.edge.is_some());
        on_road.map(Stretch::metres).sum()
    }

    /// Mean number of states on roads at a point, those that go on unseen included.
    #[must_use]
    pub fn candidates(&self) -> f64 {
        let states: usize = self.states.iter().map(|states| states.len() - 1).sum();
        states as f64 / self.states.len() as f64
    }
}
