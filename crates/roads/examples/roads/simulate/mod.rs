//! Simulated drives: fastest routes between random roads, with stops before junctions, U-turns and
//! car parks, and the positions that a receiver with lasting errors would report.
//!
//! Examples simulate them on the Earth, tests in the plane.

mod plan;
pub(crate) mod receiver;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use wayfix::map::{Coordinates, PlanePosition, Position};
use wayfix_roads::RoadNetwork;
use wayfix_roads::matching::{Stretch, TracePoint};

/// Receiver and driver of simulated drives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scenario {
    /// Standard deviation of a position in each direction in metres.
    pub(crate) noise: f64,
    /// Seconds between two points.
    pub(crate) every: f64,
    /// Share of points up to 150 m off in each direction.
    pub(crate) outliers: f64,
    /// Share of drives with a gap of 20 to 120 s of lost or poor reception.
    pub(crate) gaps: f64,
    /// Share of drives that wait in a car park, if there is room for one.
    pub(crate) car_parks: f64,
    /// Share of drives with a U-turn, in the middle of a road or at a junction.
    pub(crate) u_turns: f64,
}

impl Default for Scenario {
    fn default() -> Self {
        Self { noise: 8.0, every: 5.0, outliers: 0.03, gaps: 0.25, car_parks: 0.1, u_turns: 0.1 }
    }
}

/// A drive with its truth.
#[derive(Debug, Clone)]
pub(crate) struct Simulated<P = Position> {
    pub(crate) points: Vec<TracePoint<P>>,
    /// Edge at each point and metres along it; `None` off the road, starting with the first metre
    /// beside it.
    pub(crate) truth: Vec<Option<(usize, f64)>>,
    /// Route from the first point to the last, with its stretches off the road.
    pub(crate) route: Vec<Stretch<P>>,
}

/// Coordinates that can be moved by metres.
pub(crate) trait Movable: Coordinates {
    /// Metres to the east and to the north of another position.
    fn offset_from(self, other: Self) -> [f64; 2];

    /// Position moved by metres to the east and to the north.
    fn moved(self, metres: [f64; 2]) -> Self;

    /// Position at a share of the way to another.
    fn toward(self, other: Self, share: f64) -> Self {
        self.moved(other.offset_from(self).map(|metres| share * metres))
    }
}

impl Movable for PlanePosition {
    fn offset_from(self, other: Self) -> [f64; 2] {
        [self.x - other.x, self.y - other.y]
    }

    fn moved(self, [x, y]: [f64; 2]) -> Self {
        Self { x: self.x + x, y: self.y + y }
    }
}

const DEGREE: f64 = 111_195.0;

/// Metres per degree of longitude.
fn degree_at(latitude: f64) -> f64 {
    DEGREE * latitude.to_radians().cos().max(0.01)
}

impl Movable for Position {
    fn offset_from(self, other: Self) -> [f64; 2] {
        let east = self.longitude - other.longitude;
        let east = east - 360.0 * (east / 360.0).round();
        [east * degree_at(other.latitude), (self.latitude - other.latitude) * DEGREE]
    }

    fn moved(self, [east, north]: [f64; 2]) -> Self {
        let longitude = self.longitude + east / degree_at(self.latitude);
        Self {
            latitude: (self.latitude + north / DEGREE).clamp(-90.0, 90.0),
            longitude: longitude - 360.0 * (longitude / 360.0).round(),
        }
    }
}

/// Simulates a drive.
pub(crate) fn drive<P: Movable>(
    network: &RoadNetwork<P>,
    scenario: &Scenario,
    rng: &mut ChaCha8Rng,
) -> Result<Simulated<P>, String> {
    for _ in 0..200 {
        if let Some(plan) = plan::plan(network, scenario, rng) {
            let drive = follow(network, &plan, scenario, rng);
            // A plan may be too short for two points, or fail for lack of a destination.
            if drive.points.len() > 1 {
                return Ok(drive);
            }
        }
    }
    Err(String::from(
        "cannot find a route of a minute on these roads, expected a larger or better connected network (see --largest)",
    ))
}

/// Largest time step of the simulation in seconds.
const TICK: f64 = 0.25;

/// Drives a plan: at speeds by road and driver, slower at junctions, with stops before them.
fn follow<P: Movable>(
    network: &RoadNetwork<P>,
    plan: &[Stretch<P>],
    scenario: &Scenario,
    rng: &mut ChaCha8Rng,
) -> Simulated<P> {
    // One factor per drive: drivers are consistently slow or fast.
    let driver = rng.random_range(0.8..1.15);
    let tick = TICK.min(scenario.every);
    let [mut at, mut time, mut wait] = [0.0_f64; 3];
    let (mut number, mut along) = (0, plan[0].enter);
    let mut stop = None;
    let (mut places, mut truth, mut route) = (Vec::new(), Vec::new(), Vec::new());
    while number < plan.len() {
        // A point is due. The tolerance absorbs the rounding of summed ticks.
        if time >= places.len() as f64 * scenario.every - 1e-9 {
            let position = position(network, &plan[number], along);
            places.push(position);
            truth.push(plan[number].edge.map(|edge| (edge, along)));
            route = plan[..=number].to_vec();
            (route[number].exit, route[number].ends[1]) = (along, position);
        }
        time += tick;
        if wait > 0.0 {
            wait -= tick;
            continue;
        }
        if stop.is_some_and(|line| along >= line) {
            (at, wait, stop) = (0.0, rng.random_range(4.0..35.0), None);
            continue;
        }
        let free =
            driver * plan[number].edge.map_or(plan::OFF_ROAD, |edge| plan::speed(network, edge));
        // Braking up to 3 m/s², accelerating up to 2. At least half a metre per second keeps a
        // vehicle that has just stopped moving.
        at += (free - at).clamp(-3.0 * tick, 2.0 * tick);
        along += at.max(0.5) * tick;
        // A tick may cross several short parts.
        while number < plan.len() && along >= plan[number].exit {
            let over = along - plan[number].exit;
            number += 1;
            let Some(next) = plan.get(number) else { break };
            along = next.enter + over;
            match (plan[number - 1].edge, next.edge) {
                (Some(edge), Some(next)) if network.reverse(edge) == Some(next) => {
                    (at, wait) = (0.0, rng.random_range(3.0..10.0));
                }
                (Some(edge), Some(_)) => {
                    if network.edges_from(network.edges()[edge].to).len() > 2 {
                        at = at.min(9.0);
                    }
                }
                // Parking in a car park, between two stretches off the road.
                (None, None) => (at, wait) = (0.0, rng.random_range(30.0..120.0)),
                _ => at = at.min(plan::OFF_ROAD),
            }
            stop = stop_line(network, next, rng);
        }
    }
    let points = receiver::receive(&places, scenario, rng);
    // Points that were not received have no truth.
    let received = points.iter().zip(truth).filter(|(point, _)| point.is_some());
    let truth = received.map(|(_, truth)| truth).collect();
    Simulated { points: points.into_iter().flatten().collect(), truth, route }
}

/// Position on a part of a route.
fn position<P: Movable>(network: &RoadNetwork<P>, part: &Stretch<P>, along: f64) -> P {
    match part.edge {
        Some(edge) => network.position_along(edge, along),
        None => part.ends[0].toward(part.ends[1], along / part.exit),
    }
}

/// Metres along an edge at which the vehicle stops before a junction, if it does.
fn stop_line<P: Movable>(
    network: &RoadNetwork<P>,
    part: &Stretch<P>,
    rng: &mut ChaCha8Rng,
) -> Option<f64> {
    let edge = network.edges()[part.edge?];
    let is_junction = part.exit >= edge.metres && network.edges_from(edge.to).len() > 2;
    let stops = is_junction && rng.random_bool(0.15);
    stops.then(|| (edge.metres - rng.random_range(3.0..12.0)).max(0.5 * edge.metres))
}
