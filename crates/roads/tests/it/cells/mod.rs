//! Positions along roads: cells, their motion by metres, their sensors.

mod calibration;
mod definition;
mod numbering;
mod odometer;
mod sensors;
mod warehouse;
mod wheels;

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{ByClass, PlanePosition, RoadClass};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::TurnWeights;
use wayfix_roads::{EdgeOptions, NetworkBuilder, RoadNetwork};

/// Networks with loops, dead ends, parallel edges, one-way roads and forbidden turns, in cells
/// of 1 m.
fn networks(nodes: usize, edges: usize) -> impl Strategy<Value = RoadCells<PlanePosition>> {
    let class = prop_oneof![Just(RoadClass::Main), Just(RoadClass::Street)];
    let edge = move || (0..nodes, 0..nodes, class.clone(), 0.2..3.4_f64, any::<bool>());
    let forbidden = vec((any::<prop::sample::Index>(), any::<prop::sample::Index>()), 0..3);
    (vec(edge(), 1..=edges), forbidden).prop_map(move |(edges, forbidden)| {
        let mut builder = NetworkBuilder::new();
        for id in 0..nodes as u64 {
            let (x, y) = ((id * 7 % 5) as f64, (id * 3 % 7) as f64);
            builder.node(id, PlanePosition { x, y }).unwrap();
        }
        for (from, to, class, metres, both) in edges {
            let (from, to) = (from as u64, to as u64);
            let options = EdgeOptions::of(class).with_metres(metres);
            let there = builder.edge(from, to, options.clone()).unwrap();
            if both {
                let back = builder.edge(to, from, options).unwrap();
                builder.pair(there, back);
            }
        }
        for (edge, next) in forbidden {
            builder.forbid(edge.index(builder.edges()), next.index(builder.edges()));
        }
        RoadCells::new(builder.build().unwrap(), 1.0).unwrap()
    })
}

fn weights() -> impl Strategy<Value = TurnWeights> {
    let u_turn = prop_oneof![Just(0.0), Just(1.0), Just(0.02)];
    (0.1..4.0_f64, 0.5..3.0_f64, u_turn).prop_map(|(main, straight_on, u_turn)| TurnWeights {
        weight: ByClass { main, ..ByClass::all(1.0) },
        straight_on,
        u_turn,
    })
}

/// A road of this length in metres, in cells of 5 m, in one direction.
fn road(metres: f64) -> RoadCells<PlanePosition> {
    let mut builder = NetworkBuilder::new();
    builder.node(1, PlanePosition { x: 0.0, y: 0.0 }).unwrap();
    builder.node(2, PlanePosition { x: metres, y: 0.0 }).unwrap();
    builder.one_way(1, 2, RoadClass::Street).unwrap();
    RoadCells::new(builder.build().unwrap(), 5.0).unwrap()
}

/// Aisles in both directions between waypoints on a grid with this spacing in metres.
fn aisles(columns: u64, rows: u64, metres: f64) -> RoadNetwork<PlanePosition> {
    let mut builder = NetworkBuilder::new();
    for id in 0..columns * rows {
        let (x, y) = ((id % columns) as f64 * metres, (id / columns) as f64 * metres);
        builder.node(id, PlanePosition { x, y }).unwrap();
    }
    for id in 0..columns * rows {
        if (id + 1) % columns > 0 {
            builder.both_ways(id, id + 1, RoadClass::Street).unwrap();
        }
        if id + columns < columns * rows {
            builder.both_ways(id, id + columns, RoadClass::Street).unwrap();
        }
    }
    builder.build().unwrap()
}
