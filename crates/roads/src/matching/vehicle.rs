//! Live matching: the state of a vehicle, updated point by point.
//!
//! A vehicle keeps the filtered distribution of its last point and a trellis of the last `lag` + 1
//! points. When the oldest point leaves this window, the filtered distribution of the next becomes
//! the prior of the trellis, so smoothing the window gives the fixed-lag answers (section 5 of the
//! guide's formulas) exactly.
//!
//! What is stored of a vehicle may have been changed, so every number is checked as it is read:
//! ranges of the state, means and covariances, probabilities that sum to one, and a trellis that
//! can be smoothed.

use super::answer::{RoadAnswer, Stretches, credible, edges};
use super::candidates::{Candidate, deviation};
#[cfg(feature = "serde")]
use super::receiver::EdgeEstimate;
use super::step::{ForwardStep, MatchStep, PreviousStep};
use super::{MatchError, Matcher, TracePoint};
use wayfix::inference::Trellis;
use wayfix::internal::LogSum;
use wayfix::map::{Coordinates, Position};

/// A vehicle on the road: its belief after the last point, and the last few points for late
/// answers. Plain data, separate from the [`Matcher`] that moves it; a few kilobytes.
///
/// With the feature `serde` it is stored in any format. One that is read back continues exactly, to
/// the bit, on the network where it was started, whose fingerprint is stored with it.
///
/// ```
/// # #[cfg(feature = "serde")] {
/// use wayfix_roads::NetworkBuilder;
/// use wayfix::map::{PlanePosition, RoadClass};
/// use wayfix_roads::matching::{Matcher, TracePoint, Vehicle};
///
/// let mut builder = NetworkBuilder::new();
/// builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
/// builder.node(2, PlanePosition { x: 500.0, y: 0.0 })?;
/// builder.both_ways(1, 2, RoadClass::Street)?;
/// let matcher = Matcher::new(builder.build()?);
/// let point = |k: f64| TracePoint::new(5.0 * k, PlanePosition { x: 50.0 * k, y: 3.0 });
///
/// let vehicle = matcher.start(&point(0.0), 2)?;
/// let bytes = postcard::to_stdvec(&vehicle)?; // into a file or a database
/// let mut read: Vehicle<PlanePosition> = postcard::from_bytes(&bytes)?;
/// assert_eq!(read, vehicle);
/// read.step(&matcher, &point(1.0))?;
/// # }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle<P = Position> {
    pub(super) progress: Progress<P>,
    pub(super) window: Window,
}

/// Progress of a vehicle: everything but the window.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Progress<P> {
    /// Fingerprint of the network.
    pub(super) network: u64,
    /// Number of points that the window keeps besides the last.
    pub(super) lag: usize,
    pub(super) points: usize,
    /// The last point.
    pub(super) point: TracePoint<P>,
    pub(super) speed: f64,
    pub(super) p_stationary: f64,
    pub(super) log_likelihood: LogSum,
    /// ln p(last point | all before).
    pub(super) last: f64,
}

/// Last steps of a vehicle, oldest first, with the filtered distribution of the last.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Window {
    /// The moves of the first step come from one start and carry its filtered distribution.
    pub(super) trellis: Trellis,
    pub(super) states: Vec<Vec<Candidate>>,
    pub(super) log_filtered: Vec<f64>,
}

impl<P: Coordinates> Matcher<P> {
    /// Starts a vehicle at the first point of its drive. It keeps `lag` points besides the last for
    /// [late answers](Vehicle::late).
    ///
    /// # Errors
    ///
    /// [`MatchError::Point`] for a number out of range.
    pub fn start(&self, point: &TracePoint<P>, lag: usize) -> Result<Vehicle<P>, MatchError> {
        point.check(0, None)?;
        let mut trellis = Trellis::new();
        let taken = MatchStep::new(self, &self.model).first(point, &mut trellis)?;
        let ForwardStep { states, log_filtered, scale, speed, p_stationary } = taken;
        let mut log_likelihood = LogSum::default();
        scale.add_to(&mut log_likelihood);
        let (network, point, last) = (self.fingerprint, *point, scale.log());
        let progress =
            Progress { network, lag, points: 1, point, speed, p_stationary, log_likelihood, last };
        let window = Window { trellis, states: vec![states], log_filtered };
        Ok(Vehicle { progress, window })
    }
}

impl<P> Matcher<P> {
    /// Checks that states are on edges of the network or off the road.
    fn check(&self, states: &[Candidate]) -> Result<(), MatchError> {
        let edges = self.network.edges().len();
        let unknown = |state: &&Candidate| !state.is_off_road() && state.edge as usize >= edges;
        match states.iter().find(unknown) {
            Some(state) => Err(MatchError::Vehicle { edge: state.edge as usize, edges }),
            None => Ok(()),
        }
    }
}

impl Window {
    /// States of the last step.
    fn last(&self) -> &[Candidate] {
        self.states.last().map_or(&[], |states| states)
    }

    /// Filtered distribution of the last step.
    fn filtered(&self) -> Vec<f64> {
        self.log_filtered.iter().map(|log| log.exp()).collect()
    }

    /// Removes the oldest step. The filtered distribution of the next becomes the prior.
    fn forget(&mut self) {
        let (mut before, mut filtered) = (Vec::new(), Vec::new());
        // Two steps of the filter from the prior of the window, whose only start has the logarithm
        // 0. They take O(moves), but save storing the filtered distribution of every step.
        self.trellis.forward_step(1, &[0.0], &mut before);
        self.trellis.forward_step(2, &before, &mut filtered);
        self.trellis.remove_first(&filtered);
        self.trellis.shrink();
        self.states.remove(0);
        self.states.shrink_to_fit();
    }
}

impl<P: Coordinates> Vehicle<P> {
    /// Takes the next point. Returns ln p(point | all before). After an error the
    /// vehicle is as it was before the call.
    ///
    /// # Errors
    ///
    /// [`MatchError::Point`] for a number out of range and [`MatchError::Time`] for a point that is
    /// not later than the last, both with the number of points so far as the index, and
    /// [`MatchError::Network`] for a vehicle started by a matcher of another network.
    pub fn step(&mut self, matcher: &Matcher<P>, point: &TracePoint<P>) -> Result<f64, MatchError> {
        let Self { progress, window } = self;
        matcher.check_network(progress.network)?;
        point.check(progress.points, Some(&progress.point))?;
        // A stored vehicle that was changed may have the right fingerprint and edges that do not
        // exist, which would panic in the search.
        matcher.check(window.last())?;
        let states = window.states.last().map_or(&[][..], |states| states);
        let (log_filtered, speed, p_stationary) =
            (&window.log_filtered[..], progress.speed, progress.p_stationary);
        let before =
            PreviousStep { point: &progress.point, states, log_filtered, speed, p_stationary };
        let mut step = MatchStep::new(matcher, &matcher.model);
        let ForwardStep { mut states, log_filtered, scale, speed, p_stationary } =
            step.next(&before, point, &mut window.trellis)?;
        states.shrink_to_fit();
        // Nothing below can fail. Above, the vehicle was only read, and on an error `next` restored
        // the trellis.
        window.states.push(states);
        window.log_filtered = log_filtered;
        if window.states.len() - 1 > progress.lag {
            window.forget();
        }
        scale.add_to(&mut progress.log_likelihood);
        progress.last = scale.log();
        (progress.point, progress.speed, progress.p_stationary) = (*point, speed, p_stationary);
        progress.points = progress.points.saturating_add(1);
        Ok(progress.last)
    }

    /// Number of points so far.
    #[must_use]
    pub fn points(&self) -> usize {
        self.progress.points
    }

    /// The last point.
    #[must_use]
    pub fn last_point(&self) -> &TracePoint<P> {
        &self.progress.point
    }

    /// Answer for the last point, from all points so far.
    #[must_use]
    pub fn live(&self) -> RoadAnswer {
        RoadAnswer::new(self.window.last(), &self.window.filtered())
    }

    /// Answer for the point `lag` points ago, from all points so far; for the first point until
    /// that many have followed. Equal to [`MatchedDrive::late`](super::MatchedDrive::late) up to
    /// rounding.
    #[must_use]
    pub fn late(&self) -> RoadAnswer {
        self.ago(self.points_late()).unwrap_or_else(|| self.live())
    }

    /// Answer for the point that is `points` points ago, from all points so far: for callers who
    /// wait until an answer is probable enough. `None` if that point has left the window.
    #[must_use]
    pub fn ago(&self, points: usize) -> Option<RoadAnswer> {
        let index = self.points_late().checked_sub(points)?;
        // The filtered distribution of the last point is its smoothed one.
        if points == 0 {
            return Some(self.live());
        }
        let smoothed = self.window.trellis.smooth().ok()?;
        Some(RoadAnswer::new(&self.window.states[index], smoothed.smoothed(index + 1)))
    }

    /// Stretches of roads that hold the vehicle with a probability of at least `mass`, above 0 and
    /// at most 1. If all roads together hold less, since the vehicle may be off the road, these are
    /// all possible edges, and [`probability`](Stretches::probability) is what they hold.
    ///
    /// ```
    /// # use wayfix_roads::NetworkBuilder;
    /// # use wayfix::map::{PlanePosition, RoadClass};
    /// # let mut builder = NetworkBuilder::new();
    /// # builder.node(1, PlanePosition { x: 0.0, y: 0.0 })?;
    /// # builder.node(2, PlanePosition { x: 500.0, y: 0.0 })?;
    /// # builder.one_way(1, 2, RoadClass::Street)?;
    /// # let network = builder.build()?;
    /// use wayfix_roads::matching::{Matcher, TracePoint};
    ///
    /// // A street of 500 m.
    /// let matcher = Matcher::new(network);
    /// let point = TracePoint::new(0.0, PlanePosition { x: 200.0, y: 3.0 });
    /// let vehicle = matcher.start(&point, 0)?;
    ///
    /// let around = vehicle.credible(&matcher, 0.9)?;
    /// assert!(around.probability >= 0.9);
    /// let part = &around.stretches[0];
    /// assert!(150.0 < part.enter && part.enter < 200.0 && 200.0 < part.exit && part.exit < 250.0);
    ///
    /// // It may be off the road, so no stretch holds it for certain.
    /// let all = vehicle.credible(&matcher, 1.0)?;
    /// assert_eq!([all.stretches[0].enter, all.stretches[0].exit], [0.0, 500.0]);
    /// assert!(all.probability < 1.0);
    /// assert!(vehicle.credible(&matcher, 1.5).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`MatchError::Parameter`] for a mass out of range, and [`MatchError::Network`] for a matcher
    /// of another network.
    pub fn credible(&self, matcher: &Matcher<P>, mass: f64) -> Result<Stretches<P>, MatchError> {
        let states = self.window.last();
        matcher.check_network(self.progress.network)?;
        matcher.check(states)?;
        let sigma = deviation(&matcher.model, &self.progress.point);
        credible(&matcher.network, states, &self.window.filtered(), sigma, mass)
    }

    /// Number of points by which the late answer is behind the last point.
    #[must_use]
    pub fn points_late(&self) -> usize {
        self.window.states.len() - 1
    }

    /// ln p(last point | all before).
    #[must_use]
    pub fn log_normalizer(&self) -> f64 {
        self.progress.last
    }

    /// ln p(all points so far), as densities in metres.
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        self.progress.log_likelihood.value()
    }

    /// Edges with their probabilities, most probable first, without the state off the road.
    #[must_use]
    pub fn edges(&self) -> Vec<(usize, f64)> {
        edges(self.window.last(), &self.window.filtered())
    }

    /// Bytes of memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let Window { trellis, states, log_filtered } = &self.window;
        size_of::<Self>()
            + trellis.bytes()
            + states.iter().map(Vec::capacity).sum::<usize>() * size_of::<Candidate>()
            + states.capacity() * size_of::<Vec<Candidate>>()
            + log_filtered.capacity() * size_of::<f64>()
    }
}

#[cfg(feature = "serde")]
wayfix::stored! {
    [P: Coordinates] Vehicle<P>: [], |vehicle| {
        unit: String = P::UNIT,
        network: u64 = vehicle.progress.network,
        lag: usize = vehicle.progress.lag,
        points: usize = vehicle.progress.points,
        point: StoredPoint = StoredPoint::new(&vehicle.progress.point),
        speed: f64 = vehicle.progress.speed,
        p_stationary: f64 = vehicle.progress.p_stationary,
        log_likelihood: LogSum = vehicle.progress.log_likelihood,
        last: f64 = vehicle.progress.last,
        window: Vec<Vec<StoredState>> = vehicle.window.stored(),
        log_filtered: Vec<Option<f64>> =
            vehicle.window.log_filtered.iter().map(|log| above_zero(*log)).collect::<Vec<_>>(),
    } => point.read(&unit).and_then(|point: TracePoint<P>| {
        let progress =
            Progress { network, lag, points, point, speed, p_stationary, log_likelihood, last };
        self::Vehicle::read(progress, Window::read(window, log_filtered)?)
    });
}

/// A point as it is stored: both coordinates in the order of the axes.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredPoint {
    time: f64,
    position: [f64; 2],
    accuracy: Option<f64>,
    heading: Option<f64>,
    speed: Option<f64>,
}

#[cfg(feature = "serde")]
impl StoredPoint {
    fn new<P: Coordinates>(point: &TracePoint<P>) -> Self {
        let TracePoint { time, position, accuracy, heading, speed } = *point;
        Self { time, position: position.values(), accuracy, heading, speed }
    }

    fn read<P: Coordinates>(self, unit: &str) -> Result<TracePoint<P>, String> {
        // The unit is checked before the numbers, whose ranges depend on it.
        if unit != P::UNIT {
            return Err(format!("a vehicle with coordinates in {unit}, expected {}", P::UNIT));
        }
        let Self { time, position, accuracy, heading, speed } = self;
        let point =
            TracePoint { time, position: P::from_values(position), accuracy, heading, speed };
        point.numbers().map_err(|error| error.to_string())?;
        Ok(point)
    }
}

/// A state of the window as it is stored, with the moves into it and their log weights.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredState {
    state: Candidate,
    log_likelihood: Option<f64>,
    moves: Vec<(usize, Option<f64>)>,
}

/// A logarithm as it is stored: `None` for −∞, which text formats such as JSON do not have.
#[cfg(feature = "serde")]
fn above_zero(log: f64) -> Option<f64> {
    (log > f64::NEG_INFINITY).then_some(log)
}

#[cfg(feature = "serde")]
fn log_of(stored: Option<f64>) -> f64 {
    stored.unwrap_or(f64::NEG_INFINITY)
}

#[cfg(feature = "serde")]
impl Window {
    fn stored(&self) -> Vec<Vec<StoredState>> {
        let state = |step: usize, number: usize, state: &Candidate| StoredState {
            state: *state,
            log_likelihood: above_zero(self.trellis.log_likelihood(step, number)),
            moves: self
                .trellis
                .moves(step, number)
                .map(|(from, log)| (from, above_zero(log)))
                .collect(),
        };
        let step = |(step, states): (usize, &Vec<Candidate>)| {
            states.iter().enumerate().map(|(number, of)| state(step, number, of)).collect()
        };
        (1..).zip(&self.states).map(step).collect()
    }

    fn read(steps: Vec<Vec<StoredState>>, log_filtered: Vec<Option<f64>>) -> Result<Self, String> {
        let (mut trellis, mut window) = (Trellis::new(), Vec::new());
        for stored in steps {
            trellis.begin_step();
            let count = stored.len();
            if count == 0 {
                return Err(String::from("a point without states"));
            }
            let mut states = Vec::with_capacity(count);
            for StoredState { state, log_likelihood, moves } in stored {
                check_state(&state)?;
                states.push(state);
                // Every step ends with the state off the road, and has no other.
                if state.is_off_road() != (states.len() == count) {
                    return Err(String::from("the last state must be off the road"));
                }
                let moves = moves.into_iter().map(|(from, log)| (from, log_of(log)));
                let added = trellis.state(log_of(log_likelihood), moves);
                added.map_err(|error| error.to_string())?;
            }
            window.push(states);
        }
        let (found, expected) = (log_filtered.len(), window.last().map_or(0, Vec::len));
        if found != expected {
            return Err(format!("{found} probabilities for {expected} states"));
        }
        // The next step takes this for a distribution and does not normalise it.
        let log_filtered: Vec<f64> = log_filtered.into_iter().map(log_of).collect();
        let sum: f64 = log_filtered.iter().map(|log| log.exp()).sum();
        if !(1.0 - 1e-9..=1.0 + 1e-9).contains(&sum) {
            return Err(format!("probabilities sum to {sum}, expected 1"));
        }
        // Late answers smooth the window, and must not fail later on what was accepted here.
        trellis.smooth().map_err(|error| error.to_string())?;
        Ok(Self { trellis, states: window, log_filtered })
    }
}

#[cfg(feature = "serde")]
impl<P: Coordinates> Vehicle<P> {
    /// Checks what was stored, which may have been changed: every number is in its range before a
    /// vehicle exists. Whether its edges exist is left to the matcher, which knows the network.
    fn read(progress: Progress<P>, window: Window) -> Result<Self, String> {
        let Progress { lag, points, speed, p_stationary, log_likelihood, last, .. } = progress;
        if !(0.0..=1.0).contains(&p_stationary) {
            return Err(format!("the probability of a stop is {p_stationary}, expected 0 to 1"));
        }
        if !(0.0..=1e9).contains(&speed) {
            return Err(format!("the speed is {speed}, expected 0 to 1e9"));
        }
        if let Some(value) = [log_likelihood.value(), last].iter().find(|v| !v.is_finite()) {
            return Err(format!("a log-likelihood is {value}, expected a finite number"));
        }
        let steps = window.states.len();
        if steps == 0 || lag.checked_add(1).is_some_and(|most| steps > most) {
            return Err(format!("{steps} points in the window, expected up to {lag} + 1"));
        }
        if points < steps {
            return Err(format!("{points} points, but {steps} in the window"));
        }
        Ok(Self { progress, window })
    }
}

/// Checks the numbers of a state. Whether its edge exists is up to the network.
#[cfg(feature = "serde")]
fn check_state(state: &Candidate) -> Result<(), String> {
    /// Bound on all coordinates of the plane and lengths of edges.
    const LARGEST: f64 = 1e12;
    /// Tolerance for rounding in sums and products.
    const ROUNDING: f64 = 1e-9;
    let Candidate {
        edge: _,
        along,
        point,
        place: EdgeEstimate { mean, covariance, shares },
        inlier,
    } = *state;
    let range = |most: f64| -most..=most;
    let mut numbers = vec![
        ("metres along", along, 0.0..=LARGEST),
        ("probability of the road", inlier, 0.0..=1.0),
    ];
    numbers.extend(point.map(|value| ("coordinate", value, range(LARGEST))));
    let [xx, xy, xz, yy, yz, zz] = covariance;
    for value in mean.as_flattened() {
        numbers.push(("mean", *value, range(LARGEST)));
    }
    for value in [xx, yy, zz].as_flattened() {
        numbers.push(("variance", *value, 0.0..=LARGEST * LARGEST));
    }
    for (covariances, a, b) in [(xy, xx, yy), (xz, xx, zz), (yz, yy, zz)] {
        for ((covariance, a), b) in covariances.into_iter().zip(a).zip(b) {
            // |cov(a, b)| ≤ √(var a · var b), as `EdgeEstimate::rounded` left it.
            let most = (a * b).max(0.0).sqrt() * (1.0 + ROUNDING);
            numbers.push(("covariance", covariance, range(most)));
        }
    }
    numbers.extend(shares.map(|share| ("probability", share, 0.0..=1.0 + ROUNDING)));
    // The state off the road has no place.
    let total = if state.is_off_road() { 0.0 } else { 1.0 };
    let sum = shares.iter().sum();
    numbers.push(("sum of probabilities", sum, total - ROUNDING..=total + ROUNDING));
    for (what, value, range) in numbers {
        if !range.contains(&value) {
            return Err(format!("a state has the {what} {value}, expected {range:?}"));
        }
    }
    Ok(())
}
