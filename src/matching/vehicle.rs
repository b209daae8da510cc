//! Live matching: the state of a vehicle, point by point.

use super::answer::{CredibleStretches, RoadAnswer, credible, edges};
use super::candidates::{Candidate, deviation, metres_between};
use super::matcher::Before;
use super::{MatchError, MatchMemory, Matcher, TracePoint};
use crate::inference::{LogSum, Trellis};
use crate::map::{Coordinates, Position};

/// A vehicle on the road: its belief after the last point, and the last few points for answers
/// that may come late. Plain data, apart from the [`Matcher`] that moves it; a few kilobytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle<P = Position> {
    pub(super) lag: usize,
    pub(super) points: usize,
    pub(super) point: TracePoint<P>,
    pub(super) speed: f64,
    pub(super) log_likelihood: LogSum,
    pub(super) last: f64,
    /// Steps of the window, the oldest first, whose first has its filtered distribution as prior.
    pub(super) trellis: Trellis,
    pub(super) window: Vec<Vec<Candidate>>,
    pub(super) log_filtered: Vec<f64>,
    /// Fingerprint of the network.
    pub(super) network: u64,
}

impl<P: Coordinates> Matcher<P> {
    /// Starts a vehicle at the first point of its drive. It keeps `lag` points beside the last for
    /// [late answers](Vehicle::late).
    ///
    /// # Errors
    ///
    /// [`MatchError::Point`] for a number out of range.
    pub fn start(
        &self,
        point: &TracePoint<P>,
        lag: usize,
        memory: &mut MatchMemory,
    ) -> Result<Vehicle<P>, MatchError> {
        point.check(0, None)?;
        let mut trellis = Trellis::new();
        let states = self.begin(&self.model, point, memory, &mut trellis)?;
        let mut log_filtered = Vec::new();
        let scale = trellis.forward_step(1, &[0.0], &mut log_filtered);
        let mut log_likelihood = LogSum::default();
        scale.add_to(&mut log_likelihood);
        let (point, window) = (*point, vec![states]);
        let speed = point.speed.unwrap_or(0.0);
        let points = 1;
        Ok(Vehicle {
            lag,
            points,
            point,
            speed,
            log_likelihood,
            last: scale.log(),
            trellis,
            window,
            log_filtered,
            network: self.fingerprint,
        })
    }

    /// Takes the next point of a vehicle. Returns ln p(point | all before). After an error the
    /// vehicle is as it was before the call.
    ///
    /// # Errors
    ///
    /// [`MatchError::Point`] for a number out of range, [`MatchError::Time`] for a point that is not
    /// later than the last, each with the number of points so far as its index, and
    /// [`MatchError::Network`] for a vehicle that a matcher of another network started.
    pub fn step(
        &self,
        vehicle: &mut Vehicle<P>,
        point: &TracePoint<P>,
        memory: &mut MatchMemory,
    ) -> Result<f64, MatchError> {
        self.check_network(vehicle.network)?;
        point.check(vehicle.points, Some(&vehicle.point))?;
        let states = vehicle.window.last().map_or(&[][..], |states| states);
        self.check(states)?;
        let before = Before {
            point: &vehicle.point,
            states,
            log_filtered: &vehicle.log_filtered,
            speed: vehicle.speed,
        };
        let states = self.advance(&self.model, &before, point, memory, &mut vehicle.trellis)?;
        let seconds = point.time - vehicle.point.time;
        let step = vehicle.trellis.steps();
        let mut filtered = Vec::with_capacity(states.len());
        let scale = vehicle.trellis.forward_step(step, &vehicle.log_filtered, &mut filtered);
        vehicle.last = scale.log();
        scale.add_to(&mut vehicle.log_likelihood);
        let before = mode(&vehicle.log_filtered).map(|mode| vehicle.window[step - 2][mode]);
        vehicle.log_filtered = filtered;
        let now = mode(&vehicle.log_filtered).map(|mode| states[mode]);
        vehicle.window.push(states);
        vehicle.window.last_mut().into_iter().for_each(Vec::shrink_to_fit);
        if vehicle.window.len() - 1 > vehicle.lag {
            vehicle.forget();
        }
        vehicle.speed = point.speed.unwrap_or_else(|| {
            before
                .zip(now)
                .map_or(vehicle.speed, |modes| speed_after::<P>(vehicle.speed, modes, seconds))
        });
        vehicle.point = *point;
        vehicle.points = vehicle.points.saturating_add(1);
        Ok(vehicle.last)
    }
}

impl<P> Matcher<P> {
    /// Checks that states are on edges of the network, or off the road.
    pub(super) fn check<'a>(
        &self,
        states: impl IntoIterator<Item = &'a Candidate>,
    ) -> Result<(), MatchError> {
        let edges = self.network.edges().len();
        let unknown = |state: &&Candidate| !state.is_off_road() && state.edge as usize >= edges;
        match states.into_iter().find(unknown) {
            Some(state) => Err(MatchError::Vehicle { edge: state.edge as usize, edges }),
            None => Ok(()),
        }
    }
}

/// Speed by which a vehicle goes on unseen, from the most probable states before and after a step;
/// that of before, if a position says nothing of it.
pub(super) fn speed_after<P: Coordinates>(
    speed: f64,
    (before, now): (Candidate, Candidate),
    seconds: f64,
) -> f64 {
    /// Largest speed in metres per second that two positions may show.
    const LARGEST: f64 = 50.0;
    if before.is_off_road() || now.is_off_road() || now.inlier <= 0.5 {
        return speed;
    }
    let shown = metres_between::<P>(before.point, now.point) / seconds;
    0.5 * (speed + shown.min(LARGEST))
}

/// Most probable state.
pub(super) fn mode(logs: &[f64]) -> Option<usize> {
    (0..logs.len()).rev().max_by(|&a, &b| logs[a].total_cmp(&logs[b]))
}

impl<P: Coordinates> Vehicle<P> {
    /// Removes the oldest step of the window.
    fn forget(&mut self) {
        let (mut before, mut filtered) = (Vec::new(), Vec::new());
        self.trellis.forward_step(1, &[0.0], &mut before);
        self.trellis.forward_step(2, &before, &mut filtered);
        self.trellis.remove_first(&filtered);
        self.trellis.shrink();
        self.window.remove(0);
        self.window.shrink_to_fit();
    }

    /// Number of points so far.
    #[must_use]
    pub fn points(&self) -> usize {
        self.points
    }

    /// The last point.
    #[must_use]
    pub fn last_point(&self) -> &TracePoint<P> {
        &self.point
    }

    /// Answer for the last point, from all points so far.
    #[must_use]
    pub fn live(&self) -> RoadAnswer {
        let probabilities: Vec<f64> = self.log_filtered.iter().map(|log| log.exp()).collect();
        let states = self.window.last().map_or(&[][..], |states| states);
        RoadAnswer::new(states, &probabilities)
    }

    /// Answer for the point `lag` points ago, from all points so far; for the first point until
    /// there are more. Equal to [`MatchedDrive::late`](super::MatchedDrive::late) up to rounding.
    #[must_use]
    pub fn late(&self) -> RoadAnswer {
        self.ago(self.points_late()).unwrap_or_else(|| self.live())
    }

    /// Answer for a point of the window, so many points ago, from all points so far: to be given
    /// out when its probability is high enough. `None` if it has left the window.
    #[must_use]
    pub fn ago(&self, points: usize) -> Option<RoadAnswer> {
        let index = self.points_late().checked_sub(points)?;
        if points == 0 {
            return Some(self.live());
        }
        let smoothed = self.trellis.smooth().ok()?;
        Some(RoadAnswer::new(&self.window[index], smoothed.smoothed(index + 1)))
    }

    /// Stretches of roads that hold the vehicle now with a probability of at least `mass`, above 0
    /// and at most 1. If the roads hold less in all, since the vehicle may be off the road, they are
    /// all the edges that are possible, and [`probability`](CredibleStretches::probability) says
    /// what they hold.
    ///
    /// ```
    /// # use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass};
    /// # let mut builder = NetworkBuilder::new();
    /// # builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// # builder.node(2, PlanePosition { x: 500.0, y: 0.0 })?;
    /// # builder.one_way(1, 2, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// use wayfix::matching::{MatchMemory, Matcher, TracePoint};
    ///
    /// // A street of 500 m.
    /// let (matcher, mut memory) = (Matcher::new(network), MatchMemory::default());
    /// let point = TracePoint::new(0.0, PlanePosition { x: 200.0, y: 3.0 });
    /// let vehicle = matcher.start(&point, 0, &mut memory)?;
    ///
    /// let around = vehicle.credible(&matcher, 0.9)?;
    /// assert!(around.probability() >= 0.9);
    /// let [start, end] = around.stretches()[0].metres;
    /// assert!(150.0 < start && start < 200.0 && 200.0 < end && end < 250.0);
    ///
    /// // It may be off the road: nothing holds it for sure.
    /// let all = vehicle.credible(&matcher, 1.0)?;
    /// assert_eq!(all.stretches()[0].metres, [0.0, 500.0]);
    /// assert!(all.probability() < 1.0);
    /// assert!(vehicle.credible(&matcher, 1.5).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MatchError::Parameter`] for a mass out of range, and [`MatchError::Network`] for a matcher of
    /// another network.
    pub fn credible(
        &self,
        matcher: &Matcher<P>,
        mass: f64,
    ) -> Result<CredibleStretches, MatchError> {
        let probabilities: Vec<f64> = self.log_filtered.iter().map(|log| log.exp()).collect();
        let states = self.window.last().map_or(&[][..], |states| states);
        matcher.check_network(self.network)?;
        matcher.check(states)?;
        let sigma = deviation(&matcher.model, &self.point);
        credible(&matcher.network, states, &probabilities, sigma, mass)
    }

    /// Number of points that the late answer is behind the last point.
    #[must_use]
    pub fn points_late(&self) -> usize {
        self.window.len() - 1
    }

    /// ln p(last point | all before).
    #[must_use]
    pub fn log_normalizer(&self) -> f64 {
        self.last
    }

    /// ln p(all points so far), as densities in metres.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.log_likelihood.value()
    }

    /// Edges with their probabilities, the most probable first; those off the road are missing.
    #[must_use]
    pub fn edges(&self) -> Vec<(usize, f64)> {
        let probabilities: Vec<f64> = self.log_filtered.iter().map(|log| log.exp()).collect();
        let states = self.window.last().map_or(&[][..], |states| states);
        edges(states, &probabilities)
    }

    /// Bytes of memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let states: usize = self.window.iter().map(Vec::capacity).sum();
        size_of::<Self>()
            + self.trellis.bytes()
            + states * size_of::<Candidate>()
            + self.window.capacity() * size_of::<Vec<Candidate>>()
            + self.log_filtered.capacity() * size_of::<f64>()
    }
}
