//! A small made-up city: a grid with one-way streets, an arterial road through a roundabout, a
//! ring road, and dead ends.

use wayfix::map::{Position, RoadClass};
use wayfix_roads::NetworkError;
use wayfix_roads::{EdgeOptions, NetworkBuilder, RoadNetwork};

/// Name of the city in output.
pub(crate) const NAME: &str = "a made-up city";

/// Numbers of streets to the north and to the east, and metres between them.
const STREETS: [u64; 2] = [7, 9];
const BLOCK: f64 = 160.0;
/// Street in the middle in each direction, where the arterial roads and the roundabout are.
const MIDDLE: [u64; 2] = [3, 4];
/// First ids of the nodes of the roundabout, the ring and the dead ends; ids of crossings are 100 ·
/// row + column.
const ROUNDABOUT: u64 = 1000;
const RING: u64 = 2000;
const DEAD_ENDS: u64 = 3000;
const RING_NODES: u64 = 48;

fn at(east: f64, north: f64) -> Position {
    // Metres per degree of latitude, and the cosine of 50°.
    let degree = 111_195.0;
    Position { latitude: 50.0 + north / degree, longitude: 10.0 + east / (degree * 0.642_788) }
}

/// Metres of a crossing to the east and north of the middle; the grid is slightly bent, as in old
/// towns.
fn crossing(row: u64, column: u64) -> [f64; 2] {
    let [y, x] = [row as f64 - MIDDLE[0] as f64, column as f64 - MIDDLE[1] as f64];
    [BLOCK * x + 9.0 * (1.7 * y).sin() * x, BLOCK * y + 14.0 * (0.9 * x).sin()]
}

fn id(row: u64, column: u64) -> u64 {
    100 * row + column
}

fn on_ring(number: u64) -> [f64; 2] {
    let angle = std::f64::consts::TAU * number as f64 / RING_NODES as f64;
    [1.42 * BLOCK * MIDDLE[1] as f64 * angle.cos(), 1.55 * BLOCK * MIDDLE[0] as f64 * angle.sin()]
}

/// Builds the city.
pub(crate) fn network() -> Result<RoadNetwork, NetworkError> {
    let mut builder = NetworkBuilder::new();
    for row in 0..STREETS[0] {
        for column in 0..STREETS[1] {
            if [row, column] != MIDDLE {
                let [east, north] = crossing(row, column);
                builder.node(id(row, column), at(east, north))?;
            }
        }
    }
    for row in 0..STREETS[0] {
        for column in 0..STREETS[1] {
            let streets = [(id(row, column + 1), row, 0), (id(row + 1, column), column, 1)];
            let is_last = [column + 1 == STREETS[1], row + 1 == STREETS[0]];
            for ((to, number, direction), is_last) in streets.into_iter().zip(is_last) {
                let from = id(row, column);
                let middle = id(MIDDLE[0], MIDDLE[1]);
                // The crossing in the middle is the roundabout, which is joined to its neighbours
                // below.
                if !is_last && from != middle && to != middle {
                    street(&mut builder, [from, to], number, MIDDLE[direction])?;
                }
            }
        }
    }
    roundabout(&mut builder)?;
    ring(&mut builder)?;
    // Dead ends between the streets.
    for (number, (row, column)) in [(1, 1), (4, 6), (5, 2)].into_iter().enumerate() {
        let dead_end = DEAD_ENDS + number as u64;
        let [east, north] = crossing(row, column);
        builder.node(dead_end, at(east + 75.0, north + 70.0))?;
        builder.both_ways(id(row, column), dead_end, RoadClass::Street)?;
    }
    builder.build()
}

/// Adds a block of a street: an arterial road in the middle, every third street one-way.
fn street(
    builder: &mut NetworkBuilder,
    [from, to]: [u64; 2],
    number: u64,
    middle: u64,
) -> Result<(), NetworkError> {
    match number {
        _ if number == middle => builder.both_ways(from, to, RoadClass::Arterial)?,
        1 => builder.one_way(from, to, RoadClass::Street)?,
        2 => builder.one_way(to, from, RoadClass::Street)?,
        5 => builder.both_ways(from, to, RoadClass::Collector)?,
        _ => builder.both_ways(from, to, RoadClass::Street)?,
    };
    Ok(())
}

/// Adds the roundabout in the middle, driven anticlockwise.
fn roundabout(builder: &mut NetworkBuilder) -> Result<(), NetworkError> {
    for number in 0..8 {
        let (sine, cosine) = (std::f64::consts::FRAC_PI_4 * number as f64).sin_cos();
        builder.node(ROUNDABOUT + number, at(28.0 * cosine, 28.0 * sine))?;
    }
    for number in 0..8 {
        let options = EdgeOptions::of(RoadClass::Arterial).with_roundabout(true);
        builder.edge(ROUNDABOUT + number, ROUNDABOUT + (number + 1) % 8, options)?;
    }
    let [row, column] = MIDDLE;
    let around =
        [id(row, column + 1), id(row + 1, column), id(row, column - 1), id(row - 1, column)];
    for (number, crossing) in (0..).zip(around) {
        // Every other node of the roundabout has an arm.
        builder.both_ways(ROUNDABOUT + 2 * number, crossing, RoadClass::Arterial)?;
    }
    Ok(())
}

/// Adds the ring road, with roads into the city.
fn ring(builder: &mut NetworkBuilder) -> Result<(), NetworkError> {
    for number in 0..RING_NODES {
        let [east, north] = on_ring(number);
        builder.node(RING + number, at(east, north))?;
    }
    for number in 0..RING_NODES {
        let next = RING + (number + 1) % RING_NODES;
        builder.both_ways(RING + number, next, RoadClass::Main)?;
    }
    let [rows, columns] = STREETS;
    let [row, column] = MIDDLE;
    let (top, right) = (rows - 1, columns - 1);
    let ends = [
        (0, id(row, right), RoadClass::Arterial),
        (6, id(top, right), RoadClass::Collector),
        (12, id(top, column), RoadClass::Arterial),
        (18, id(top, 0), RoadClass::Collector),
        (24, id(row, 0), RoadClass::Arterial),
        (30, id(0, 0), RoadClass::Collector),
        (36, id(0, column), RoadClass::Arterial),
        (42, id(0, right), RoadClass::Collector),
    ];
    for (number, crossing, class) in ends {
        builder.both_ways(RING + number, crossing, class)?;
    }
    Ok(())
}
