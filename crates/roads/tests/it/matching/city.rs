//! A simulated city, and drives in it.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wayfix::map::{PlanePosition, RoadClass};
use wayfix_roads::matching::TracePoint;
use wayfix_roads::{NetworkBuilder, RoadNetwork};

use super::simulate;
pub(crate) use super::simulate::Scenario;

pub(crate) type Network = RoadNetwork<PlanePosition>;
pub(crate) type Point = TracePoint<PlanePosition>;
pub(crate) type Drive = simulate::Simulated<PlanePosition>;

pub(crate) fn at(x: f64, y: f64) -> PlanePosition {
    PlanePosition { x, y }
}

pub(crate) fn id(column: usize, row: usize) -> u64 {
    (1000 * row + column) as u64
}

/// A grid of two-way streets `spacing` metres apart. Every fifth column is one-way to the north,
/// and streets with both ends in `is_missing` are left out.
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

pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Drives only on roads, with reception throughout.
pub(crate) const ON_ROADS: Scenario =
    Scenario { noise: 8.0, every: 5.0, outliers: 0.0, gaps: 0.0, car_parks: 0.0, u_turns: 0.0 };

/// Simulates a drive.
pub(crate) fn drive(network: &Network, scenario: &Scenario, seed: u64) -> Drive {
    simulate::drive(network, scenario, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap()
}

/// First points of a simulated drive.
pub(crate) fn points(network: &Network, scenario: &Scenario, most: usize, seed: u64) -> Vec<Point> {
    let mut points = drive(network, scenario, seed).points;
    points.truncate(most);
    points
}

/// Points of a vehicle that stands.
pub(crate) fn standing(
    place: PlanePosition,
    count: usize,
    [noise, every]: [f64; 2],
    rng: &mut ChaCha8Rng,
) -> Vec<Point> {
    let scenario = Scenario { noise, every, ..ON_ROADS };
    let points = simulate::receiver::receive(&vec![place; count], &scenario, rng);
    points.into_iter().flatten().collect()
}
