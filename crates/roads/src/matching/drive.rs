//! Whole drives: smoothed answers, and the most probable route.
//!
//! A drive is filtered once (see [`step`](super::step)). Smoothing (section 3 of the guide's
//! formulas) and the Viterbi path (section 7) then run on the stored trellis; the route joins the
//! states of that path by the same ways that the moves were weighted with.

use std::ops::ControlFlow;

use super::answer::{RoadAnswer, Stretch, Stretches, credible, edges};
use super::candidates::{Candidate, deviation};
use super::matcher::DRIVES_AHEAD;
use super::route::route;
use super::step::{MatchStep, SmoothedDrive};
use super::{MatchError, Matcher, TracePoint};
use wayfix::inference::{SmoothedTrellis, Trellis};
use wayfix::internal::parallel;
use wayfix::map::{Coordinates, Position};

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

impl<P: Coordinates> Matcher<P> {
    /// Matches a whole drive. Each point must be later than the one before.
    ///
    /// O(points · (candidates² + edges searched)) time; some 12 bytes of memory for each pair of
    /// candidates.
    ///
    /// # Errors
    ///
    /// [`MatchError::Empty`] without points, [`MatchError::Point`] for a number out of range, and
    /// [`MatchError::Time`] for times that do not ascend, each with the index of the point.
    pub fn match_drive(&self, points: &[TracePoint<P>]) -> Result<MatchedDrive<P>, MatchError> {
        let mut step = MatchStep::new(self, &self.model);
        let SmoothedDrive { states, trellis, smoothed } = step.smooth(points, |_, _, _| ())?;
        let path = trellis.viterbi()?;
        let on_path: Vec<Candidate> =
            path.states().iter().zip(&states).map(|(state, states)| states[*state]).collect();
        let route = route(&self.network, points, &on_path, &mut step);
        let points = points.to_vec();
        Ok(MatchedDrive { points, states, trellis, smoothed, route, network: self.fingerprint })
    }

    /// Matches any number of drives and passes each to a visitor, in order and with its index from
    /// 0, until the visitor breaks. An error in one drive does not affect the others.
    ///
    /// With the feature `rayon`, drives run in parallel, with the same results; the iterator and
    /// the visitor run on the caller's thread. Memory: four drives per thread, with their results.
    ///
    /// ```
    /// # use wayfix_roads::NetworkBuilder;
    /// # use wayfix::map::{PlanePosition, RoadClass};
    /// # let mut builder = NetworkBuilder::new();
    /// # builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// # builder.node(2, PlanePosition { x: 2000.0, y: 0.0 })?;
    /// # builder.both_ways(1, 2, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// use std::ops::ControlFlow;
    ///
    /// use wayfix_roads::matching::{Matcher, TracePoint};
    ///
    /// let matcher = Matcher::new(network);
    /// let point = |k: u32| {
    ///     TracePoint::new(f64::from(k), PlanePosition { x: 10.0 * f64::from(k), y: 3.0 })
    /// };
    /// // The second has no points.
    /// let drives: Vec<Vec<_>> = vec![(0..100).map(point).collect(), Vec::new()];
    /// let (mut metres, mut failed) = (0.0, Vec::new());
    /// let _ = matcher.match_map_all(&drives, |index, drive| {
    ///     match drive {
    ///         Ok(drive) => metres += drive.metres(),
    ///         Err(_) => failed.push(index),
    ///     }
    ///     ControlFlow::<()>::Continue(())
    /// });
    /// assert!((metres - 990.0).abs() < 1.0);
    /// assert_eq!(failed, [1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn match_map_all<D: AsRef<[TracePoint<P>]> + Send, T>(
        &self,
        drives: impl IntoIterator<Item = D>,
        mut visit: impl FnMut(usize, Result<MatchedDrive<P>, MatchError>) -> ControlFlow<T>,
    ) -> ControlFlow<T> {
        let matched = |drive: D| self.match_drive(drive.as_ref());
        // Results come in the order of the drives, so counting them gives their indices. An open
        // range always has a next number.
        let mut indices = 0..;
        parallel::in_order(drives.into_iter(), DRIVES_AHEAD, matched, |drive| {
            indices.next().map_or(ControlFlow::Continue(()), |index| visit(index, drive))
        })
    }

    /// Line of a stretch of a [route](MatchedDrive::route): its positions including both ends, or
    /// the ends alone off the road. O(points of the edge).
    ///
    /// ```
    /// # use wayfix_roads::NetworkBuilder;
    /// # use wayfix::map::{PlanePosition, RoadClass};
    /// # let at = |x, y| PlanePosition { x, y };
    /// # let mut builder = NetworkBuilder::new();
    /// # [at(0.0, 0.0), at(100.0, 0.0), at(100.0, 80.0)].into_iter().zip(1..).try_for_each(|(p, id)| builder.node(id, p).map(|_| ()))?;
    /// # builder.both_ways(1, 2, RoadClass::Street)?;
    /// # builder.both_ways(2, 3, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// # use wayfix_roads::matching::{Matcher, TracePoint};
    /// // Along a street of 100 m to the east, then to the north.
    /// let matcher = Matcher::new(network);
    /// let drive = [(0.0, 20.0, 1.0), (6.0, 80.0, -1.0), (12.0, 101.0, 40.0)]
    ///     .map(|(time, x, y)| TracePoint::new(time, PlanePosition { x, y }));
    /// let matched = matcher.match_drive(&drive)?;
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
}

impl<P: Coordinates> MatchedDrive<P> {
    /// Points of the drive.
    #[must_use]
    pub fn points(&self) -> &[TracePoint<P>] {
        &self.points
    }

    /// Answer for a point, by its index from 0, given the points up to it.
    ///
    /// # Panics
    ///
    /// If the point does not exist, as in all methods that take one.
    #[must_use]
    pub fn live(&self, point: usize) -> RoadAnswer {
        RoadAnswer::new(&self.states[point], self.smoothed.filtered(point + 1))
    }

    /// Answer for a point, given the points up to it and `lag` more; equal to
    /// [`Vehicle::late`](super::Vehicle::late) up to rounding.
    #[must_use]
    pub fn late(&self, point: usize, lag: usize) -> RoadAnswer {
        let probabilities = self.smoothed.lagged(&self.trellis, point + 1, lag);
        RoadAnswer::new(&self.states[point], &probabilities)
    }

    /// Answer for a point, given all points of the drive.
    #[must_use]
    pub fn smoothed(&self, point: usize) -> RoadAnswer {
        RoadAnswer::new(&self.states[point], self.smoothed.smoothed(point + 1))
    }

    /// Edges with their probabilities at a point, given all points of the drive, most probable
    /// first; without the state off the road.
    #[must_use]
    pub fn edges(&self, point: usize) -> Vec<(usize, f64)> {
        edges(&self.states[point], self.smoothed.smoothed(point + 1))
    }

    /// Stretches of roads that held the vehicle at a point with a probability of at least `mass`,
    /// given all points of the drive, as [`Vehicle::credible`](super::Vehicle::credible) does live.
    ///
    /// # Errors
    ///
    /// [`MatchError::Parameter`] for a mass out of range, and [`MatchError::Network`] for a matcher
    /// of another network.
    pub fn credible(
        &self,
        matcher: &Matcher<P>,
        point: usize,
        mass: f64,
    ) -> Result<Stretches<P>, MatchError> {
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

    /// ln p(all points), as a density in metres.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.smoothed.log_likelihood()
    }

    /// Most probable route: consecutive edges, and stretches off the road.
    #[must_use]
    pub fn route(&self) -> &[Stretch<P>] {
        &self.route
    }

    /// Length of the route on roads in metres.
    #[must_use]
    pub fn metres(&self) -> f64 {
        let on_road = self.route.iter().filter(|stretch| stretch.edge.is_some());
        // A fold, because `sum` of an empty iterator is -0.0.
        on_road.fold(0.0, |sum, stretch| sum + (stretch.exit - stretch.enter))
    }

    /// Mean number of states on roads at a point, including those that continue unseen.
    #[must_use]
    pub fn candidates(&self) -> f64 {
        let states: usize = self.states.iter().map(|states| states.len() - 1).sum();
        states as f64 / self.states.len() as f64
    }
}

#[cfg(feature = "geojson")]
impl Matcher {
    /// Returns a route as GeoJSON text: a collection with one line per stretch, in order. The
    /// properties of a line are the ids of its nodes as `from` and `to`, `enter_m`, `exit_m` and
    /// `off_road`.
    #[must_use]
    pub fn route_to_geojson(&self, route: &[Stretch]) -> String {
        use crate::line_string;
        use std::fmt::Write;

        let mut text = String::from(r#"{"type":"FeatureCollection","features":["#);
        for (number, stretch) in route.iter().enumerate() {
            let Stretch { edge, enter, exit, .. } = *stretch;
            let separator = if number == 0 { "\n" } else { ",\n" };
            let nodes = edge.map_or(String::new(), |edge| {
                let edge = &self.network.edges()[edge];
                let [from, to] = [edge.from, edge.to].map(|node| self.network.nodes()[node].id);
                format!(r#""from":{from},"to":{to},"#)
            });
            let (line, off_road) = (line_string(self.line(stretch)), edge.is_none());
            // Writing to a string cannot fail.
            let _ = write!(
                text,
                r#"{separator}{{"type":"Feature","properties":{{{nodes}"enter_m":{enter:.1},"exit_m":{exit:.1},"off_road":{off_road}}},"geometry":{line}}}"#
            );
        }
        text + "\n]}\n"
    }
}
