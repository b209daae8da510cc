//! A made-up city, and drives in it.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wayfix::map::{NetworkBuilder, PlanePosition, RoadClass, RoadNetwork};
use wayfix::matching::TracePoint;

pub(crate) type Network = RoadNetwork<PlanePosition>;
pub(crate) type Point = TracePoint<PlanePosition>;

pub(crate) fn at(x: f64, y: f64) -> PlanePosition {
    PlanePosition { x, y }
}

pub(crate) fn id(column: usize, row: usize) -> u64 {
    (1000 * row + column) as u64
}

/// A grid of two-way streets `spacing` metres apart. Every fifth column is one-way to the north,
/// and streets for which `is_missing` holds of both ends are left out.
pub(crate) fn city(
    columns: usize,
    rows: usize,
    spacing: f64,
    is_missing: impl Fn([usize; 2], [usize; 2]) -> bool,
) -> Network {
    let mut builder = NetworkBuilder::new();
    for row in 0..rows {
        for column in 0..columns {
            let position = at(column as f64 * spacing, row as f64 * spacing);
            builder.node(id(column, row), position).unwrap();
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            for next in [[column + 1, row], [column, row + 1]] {
                let here = [column, row];
                if next[0] >= columns || next[1] >= rows || is_missing(here, next) {
                    continue;
                }
                let ends = [id(column, row), id(next[0], next[1])];
                if next[1] > row && column % 5 == 2 {
                    builder.one_way(ends[0], ends[1], RoadClass::Street).unwrap();
                } else {
                    builder.both_ways(ends[0], ends[1], RoadClass::Street).unwrap();
                }
            }
        }
    }
    builder.build().unwrap()
}

/// How a simulated receiver and driver behave.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Habits {
    pub(crate) points: usize,
    /// Seconds between two points.
    pub(crate) seconds: f64,
    /// Standard deviation of a position in each direction, in metres.
    pub(crate) sigma: f64,
    /// Share of the variance of positions that lasts, for 25 s.
    pub(crate) lasting: f64,
    /// Share of positions that are up to 150 m off in each direction.
    pub(crate) outliers: f64,
    /// Probability of a stop before the end of an edge, of half a minute on average.
    pub(crate) stops: f64,
}

impl Default for Habits {
    fn default() -> Self {
        Self { points: 120, seconds: 5.0, sigma: 8.0, lasting: 0.7, outliers: 0.0, stops: 0.15 }
    }
}

/// Error of a receiver in one direction, in deviations: a share of the variance lasts for 25 s.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LastingError {
    lasting: f64,
    offset: f64,
}

impl LastingError {
    pub(crate) fn new(lasting: f64, rng: &mut impl Rng) -> Self {
        Self { lasting, offset: normal(rng) }
    }

    /// Error some seconds after the last.
    pub(crate) fn next(&mut self, seconds: f64, rng: &mut impl Rng) -> f64 {
        let kept = (-seconds / 25.0).exp();
        self.offset = kept * self.offset + (1.0 - kept * kept).sqrt() * normal(rng);
        self.lasting.sqrt() * self.offset + (1.0 - self.lasting).sqrt() * normal(rng)
    }
}

/// A drive with the truth.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    pub(crate) points: Vec<Point>,
    /// Edge at each point.
    pub(crate) edges: Vec<usize>,
    /// Metres from the start of the edge.
    pub(crate) along: Vec<f64>,
    /// Number of points since the one before which the vehicle stood.
    pub(crate) stood: usize,
}

pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Drives to destinations at random, on the straightest way through the grid.
pub(crate) fn drive(network: &Network, habits: &Habits, seed: u64) -> Drive {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut edge = rng.random_range(0..network.edges().len());
    let mut along = rng.random_range(0.0..network.edges()[edge].metres);
    let (mut speed, mut standing): (f64, f64) = (rng.random_range(8.0..16.0), 0.0);
    let mut stop: Option<f64> = None;
    let mut heading_to = rng.random_range(0..network.nodes().len());
    let mut errors = [0; 2].map(|_| LastingError::new(habits.lasting, &mut rng));
    let mut drive = Drive { points: Vec::new(), edges: Vec::new(), along: Vec::new(), stood: 0 };
    for number in 0..habits.points {
        if number > 0 {
            let mut seconds = habits.seconds;
            let mut moved = 0.0;
            while seconds > 1e-9 {
                let waits = standing.min(seconds);
                (standing, seconds) = (standing - waits, seconds - waits);
                // Up to where it stops, or to the end of the edge.
                let goal = stop.unwrap_or(network.edges()[edge].metres);
                let goes = (speed * seconds).min((goal - along).max(0.0));
                (along, seconds, moved) = (along + goes, seconds - goes / speed, moved + goes);
                if seconds <= 1e-9 {
                    break;
                }
                if stop.take().is_some() {
                    standing = -30.0 * (1.0 - rng.random::<f64>()).ln();
                    continue;
                }
                edge = turn(network, edge, &mut heading_to, &mut rng);
                along = 0.0;
                speed = (speed + 1.5 * normal(&mut rng)).clamp(6.0, 18.0);
                let line = network.edges()[edge].metres - rng.random_range(4.0..15.0);
                stop = rng.random_bool(habits.stops).then_some(line);
            }
            drive.stood += usize::from(moved == 0.0);
        }
        let place = network.position_along(edge, along);
        let bad = rng.random_bool(habits.outliers);
        let [dx, dy] = errors.each_mut().map(|error| {
            let error = habits.sigma * error.next(habits.seconds, &mut rng);
            if bad { rng.random_range(-150.0..150.0) } else { error }
        });
        let position = at(place.x + dx, place.y + dy);
        drive.points.push(TracePoint::new(number as f64 * habits.seconds, position));
        drive.edges.push(edge);
        drive.along.push(along);
    }
    drive
}

/// Next edge towards a destination; a new destination where it is reached.
fn turn(network: &Network, edge: usize, to: &mut usize, rng: &mut ChaCha8Rng) -> usize {
    let node = network.edges()[edge].to;
    if node == *to || rng.random_bool(0.02) {
        *to = rng.random_range(0..network.nodes().len());
    }
    let goal = network.nodes()[*to].position;
    let mut ways: Vec<usize> =
        network.next(edge).filter(|&next| network.reverse(edge) != Some(next)).collect();
    if ways.is_empty() {
        ways.extend(network.next(edge));
    }
    let distance = |next: usize| {
        let end = network.nodes()[network.edges()[next].to].position;
        (end.x - goal.x).abs() + (end.y - goal.y).abs()
    };
    // Of equally good ones, the straight one more often.
    let start = network.nodes()[network.edges()[edge].from].position;
    let bend = |next: usize| {
        let end = network.nodes()[network.edges()[next].to].position;
        if (end.x - start.x).abs() > 1.0 && (end.y - start.y).abs() > 1.0 { 20.0 } else { 0.0 }
    };
    let noise: Vec<f64> = ways.iter().map(|_| 30.0 * rng.random::<f64>()).collect();
    (0..ways.len())
        .min_by(|&a, &b| {
            let cost = |i: usize| distance(ways[i]) + bend(ways[i]) + noise[i];
            cost(a).total_cmp(&cost(b))
        })
        .map(|best| ways[best])
        .unwrap()
}
