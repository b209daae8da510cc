//! Simulated drives: the fastest routes between random roads, with stops before junctions, and the
//! positions that a receiver would report, whose errors last.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use wayfix::map::{Position, RoadClass, RoadNetwork};
use wayfix::matching::TracePoint;

/// Receiver of a simulated drive.
#[derive(Clone, Copy)]
pub(crate) struct Receiver {
    /// Standard deviation in each direction in metres.
    pub(crate) noise: f64,
    /// Seconds between two points.
    pub(crate) every: f64,
    /// Share of points with eight times the independent noise.
    pub(crate) outliers: f64,
}

/// A drive, and what is true of it.
pub(crate) struct Simulated {
    pub(crate) points: Vec<TracePoint>,
    /// Edge at each point.
    pub(crate) edges: Vec<usize>,
    /// Edges of the route, from that of the first point to that of the last.
    pub(crate) route: Vec<usize>,
}

/// Share of the variance of positions that lasts, and for how many seconds.
const LASTING: f64 = 0.7;
const LASTS: f64 = 25.0;

/// Error of a receiver that lasts, in deviations to the north and to the east.
struct Offset([f64; 2]);

impl Offset {
    fn new(rng: &mut ChaCha8Rng) -> Self {
        Self([StandardNormal.sample(rng), StandardNormal.sample(rng)])
    }

    /// Goes on by a time.
    fn go_on(&mut self, seconds: f64, rng: &mut ChaCha8Rng) {
        let kept = (-seconds / LASTS).exp();
        for part in &mut self.0 {
            let new: f64 = StandardNormal.sample(rng);
            *part = kept * *part + (1.0 - kept * kept).sqrt() * new;
        }
    }
}

/// Longest drives, in seconds.
const LONGEST: f64 = 900.0;

/// Seconds of a step of the simulation, at most.
const TICK: f64 = 0.25;

/// Free speed on an edge in metres per second.
fn speed(network: &RoadNetwork, edge: usize) -> f64 {
    let edge = network.edges()[edge];
    edge.speed.map_or(0.0, |speed| 0.9 * speed).max(match edge.class {
        _ if edge.speed.is_some() => 2.0,
        _ if edge.roundabout => 7.0,
        RoadClass::Main => 20.0,
        RoadClass::Arterial => 15.0,
        RoadClass::Collector => 12.0,
        RoadClass::Street => 9.0,
    })
}

fn between(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * Distribution::<f64>::sample(&rand_distr::StandardUniform, rng)
}

fn index(rng: &mut ChaCha8Rng, count: usize) -> usize {
    Uniform::new(0, count).map_or(0, |uniform| uniform.sample(rng))
}

/// Simulates a drive.
pub(crate) fn drive(
    network: &RoadNetwork,
    receiver: Receiver,
    rng: &mut ChaCha8Rng,
) -> Result<Simulated, String> {
    for _ in 0..200 {
        if let Some(route) = route(network, rng) {
            let drive = follow(network, &route, receiver, rng);
            if drive.points.len() > 1 {
                return Ok(drive);
            }
        }
    }
    Err(String::from(
        "cannot find a route of a minute on these roads, expected a larger or better connected network (see --largest)",
    ))
}

/// Fastest route from a random edge to another, of at least a minute.
fn route(network: &RoadNetwork, rng: &mut ChaCha8Rng) -> Option<Vec<usize>> {
    let edges = network.edges();
    (!edges.is_empty()).then_some(())?;
    let from = index(rng, edges.len());
    let mut best = vec![(f64::INFINITY, usize::MAX); edges.len()];
    let mut settled = Vec::new();
    let mut queue = BinaryHeap::from([Reverse((0, from))]);
    best[from].0 = 0.0;
    while let Some(Reverse((bits, edge))) = queue.pop() {
        let seconds = f64::from_bits(bits);
        if seconds > best[edge].0 {
            continue;
        }
        settled.push(edge);
        let after = seconds + edges[edge].metres / speed(network, edge);
        if after > LONGEST {
            continue;
        }
        let back = network.reverse(edge);
        // Back only where no other way goes on.
        let is_end = network.next(edge).all(|next| Some(next) == back);
        for next in network.next(edge).filter(|next| is_end || Some(*next) != back) {
            if after < best[next].0 {
                best[next] = (after, edge);
                queue.push(Reverse((after.to_bits(), next)));
            }
        }
    }
    let longest = settled.last().map_or(0.0, |&edge| best[edge].0);
    let least = (0.4 * longest).max(60.0);
    let ends: Vec<usize> = settled.into_iter().filter(|&edge| best[edge].0 >= least).collect();
    (!ends.is_empty()).then_some(())?;
    let mut route = vec![ends[index(rng, ends.len())]];
    while let Some(&edge) = route.last()
        && edge != from
    {
        route.push(best[edge].1);
    }
    route.reverse();
    Some(route)
}

/// Drives along a route: speeds by road and driver, slower before turns, with stops at junctions.
fn follow(
    network: &RoadNetwork,
    route: &[usize],
    receiver: Receiver,
    rng: &mut ChaCha8Rng,
) -> Simulated {
    let driver = between(rng, 0.8, 1.15);
    let tick = TICK.min(receiver.every);
    let [mut at, mut time, mut next_point] = [0, 0, 0].map(f64::from);
    let mut along = between(rng, 0.0, 0.8) * network.edges()[route[0]].metres;
    let (mut driven, mut wait) = (0, 0.0);
    let mut offset = Offset::new(rng);
    let mut stop = None;
    let mut drive = Simulated { points: Vec::new(), edges: Vec::new(), route: Vec::new() };
    while driven < route.len() {
        if time >= next_point - 1e-9 {
            let true_position = network.position_along(route[driven], along);
            let position = measured(true_position, receiver, &offset, rng);
            drive.points.push(TracePoint::new(next_point, position));
            drive.edges.push(route[driven]);
            drive.route = route[..=driven].to_vec();
            next_point += receiver.every;
            offset.go_on(receiver.every, rng);
        }
        time += tick;
        if wait > 0.0 {
            wait -= tick;
            continue;
        }
        if stop.is_some_and(|line| along >= line) {
            (at, wait, stop) = (0.0, between(rng, 4.0, 35.0), None);
            continue;
        }
        let free = driver * speed(network, route[driven]);
        at += (free - at).clamp(-3.0 * tick, 2.0 * tick);
        along += at.max(0.5) * tick;
        while driven < route.len() && along >= network.edges()[route[driven]].metres {
            along -= network.edges()[route[driven]].metres;
            let node = network.edges()[route[driven]].to;
            driven += 1;
            if network.edges_from(node).len() > 2 {
                at = at.min(9.0);
            }
            stop = route.get(driven).and_then(|&edge| stop_line(network, edge, rng));
        }
    }
    drive
}

/// Place on an edge where the vehicle stops before a junction, if it does.
fn stop_line(network: &RoadNetwork, edge: usize, rng: &mut ChaCha8Rng) -> Option<f64> {
    let edge = network.edges()[edge];
    let is_junction = network.edges_from(edge.to).len() > 2;
    let stops = is_junction && between(rng, 0.0, 1.0) < 0.15;
    stops.then(|| (edge.metres - between(rng, 3.0, 12.0)).max(0.5 * edge.metres))
}

/// Position that the receiver reports.
fn measured(
    position: Position,
    receiver: Receiver,
    offset: &Offset,
    rng: &mut ChaCha8Rng,
) -> Position {
    let is_outlier = between(rng, 0.0, 1.0) < receiver.outliers;
    let white = (1.0 - LASTING).sqrt() * if is_outlier { 8.0 } else { 1.0 };
    let mut metres = |offset: f64| -> f64 {
        let sample: f64 = StandardNormal.sample(rng);
        receiver.noise * (LASTING.sqrt() * offset + white * sample)
    };
    let degree = 111_195.0;
    let latitude = position.latitude + metres(offset.0[0]) / degree;
    let cosine = position.latitude.to_radians().cos().max(0.01);
    let longitude = position.longitude + metres(offset.0[1]) / (degree * cosine);
    Position { latitude: latitude.clamp(-90.0, 90.0), longitude: longitude.clamp(-180.0, 180.0) }
}
