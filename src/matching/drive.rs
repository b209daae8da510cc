//! A whole drive: smoothed answers, and the route.

use super::answer::{CredibleStretches, RoadAnswer, credible, edges};
use super::candidates::{Candidate, deviation};
use super::matcher::Before;
use super::moves::{Interval, Move, Ways};
use super::stretches::{Added, Link, Rules};
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
    pub(super) trellis: Trellis,
    pub(super) smoothed: SmoothedTrellis,
    pub(super) route: Vec<Stretch<P>>,
    /// Fingerprint of the network.
    pub(super) network: u64,
}

/// Part of a route: an edge, or a stretch off the road.
///
/// On a road it is longer than 0 m, with two exceptions: a vehicle that stood all the time, whose
/// route is one edge, and an edge with its reverse where going on without them is forbidden.
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
    /// O(points · (candidates² + edges searched)) time; some 12 bytes a pair of candidates.
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
        let Built { states, trellis, .. } = self.trellis(&self.model, points, memory)?;
        let smoothed = trellis.smooth()?;
        let path = trellis.viterbi()?;
        let on_path: Vec<Candidate> =
            path.states().iter().zip(&states).map(|(state, states)| states[*state]).collect();
        let route = self.route(points, &on_path, memory);
        let points = points.to_vec();
        let network = self.fingerprint;
        Ok(MatchedDrive { points, states, trellis, smoothed, route, network })
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
        let (rules, mut route, mut added) = (Rules(&self.network), Vec::new(), Added::default());
        let mut mode = Rules::<P>::start(&path[0], &mut added);
        rules.extend(&mut route, [&points[0]; 2], &added);
        for (pair, points) in path.windows(2).zip(points.windows(2)) {
            let (from, to) = (&pair[0], &pair[1]);
            let mut link = Link::SameEdge;
            if !from.is_off_road() && !to.is_off_road() {
                let interval = self.search_from(from, std::slice::from_ref(to), points, memory);
                link = rules.link(from, to, interval.jitter, &memory.search);
            }
            added = Added::default();
            mode = rules.go(mode, [from, to], &link, &mut added);
            rules.extend(&mut route, [&points[0], &points[1]], &added);
        }
        added = Added::default();
        Rules::<P>::finish(mode, &path[path.len() - 1], &mut added);
        let last = &points[points.len() - 1];
        rules.extend(&mut route, [last; 2], &added);
        route
    }

    /// Searches for the ways from a state to those of the next point.
    pub(super) fn search_from(
        &self,
        from: &Candidate,
        to: &[Candidate],
        points: &[TracePoint<P>],
        memory: &mut MatchMemory,
    ) -> Interval {
        let (a, b) = (&points[0], &points[1]);
        let jitter = deviation(&self.model, a).hypot(deviation(&self.model, b));
        let metres = a.position.metres_to(b.position);
        let interval = Interval { seconds: b.time - a.time, metres, jitter, speed: None };
        let Self { network, measures, .. } = self;
        let mut ways = Ways { network, measures, search: &mut memory.search };
        ways.from(from, to, &self.model, &interval);
        interval
    }
}

/// Trellis of a drive.
pub(super) struct Built {
    pub(super) states: Vec<Vec<Candidate>>,
    pub(super) trellis: Trellis,
    pub(super) moves: Vec<Move>,
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
    /// [`MatchError::Parameter`] for a mass out of range, and [`MatchError::Network`] for a matcher of
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
        // The sum of nothing would be -0.
        on_road.fold(0.0, |sum, stretch| sum + (stretch.exit - stretch.enter))
    }

    /// Mean number of states on roads at a point, those that go on unseen included.
    #[must_use]
    pub fn candidates(&self) -> f64 {
        let states: usize = self.states.iter().map(|states| states.len() - 1).sum();
        states as f64 / self.states.len() as f64
    }
}
