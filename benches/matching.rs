//! Map matching: whole drives, and live points, in a made-up city of 40 × 40 junctions, or on the
//! network in the folder WAYFIX_ROADS. One point every 5 s, 10 m of noise; the unit is points.
#![allow(missing_docs)]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use wayfix::map::{Position, RoadClass};
use wayfix_roads::matching::{MatchModel, Matcher, TracePoint};
use wayfix_roads::{ImportOptions, NetworkBuilder, RoadNetwork};

const SIDE: u64 = 40;
const NOISE: f64 = 10.0;

fn network() -> RoadNetwork {
    if let Ok(folder) = std::env::var("WAYFIX_ROADS") {
        return RoadNetwork::from_path(folder, &ImportOptions::default()).expect("a network").0;
    }
    let mut builder = NetworkBuilder::new();
    for id in 0..SIDE * SIDE {
        let (row, column) = ((id / SIDE) as f64, (id % SIDE) as f64);
        let position =
            Position { latitude: -35.3 + 0.0009 * row, longitude: 149.1 + 0.0011 * column };
        builder.node(id, position).expect("a node");
    }
    for id in 0..SIDE * SIDE {
        let class = if id % 5 == 0 { RoadClass::Arterial } else { RoadClass::Street };
        if id % SIDE + 1 < SIDE {
            builder.both_ways(id, id + 1, class).expect("a road");
        }
        if id / SIDE + 1 < SIDE {
            builder.both_ways(id, id + SIDE, class).expect("a road");
        }
    }
    builder.build().expect("a network")
}

/// Points of a drive of 10 minutes at 14 m/s that turns at random.
fn drive(network: &RoadNetwork, rng: &mut impl Rng) -> Vec<TracePoint> {
    let noise = Normal::new(0.0, NOISE / 111_195.0).expect("a deviation");
    let (mut edge, mut along) = (rng.random_range(0..network.edges().len()), 0.0);
    let mut points = Vec::new();
    for k in 0..120 {
        let at = network.position_along(edge, along);
        let longitude = at.longitude + noise.sample(rng) / at.latitude.to_radians().cos();
        let position = Position { latitude: at.latitude + noise.sample(rng), longitude };
        points.push(TracePoint::new(5.0 * f64::from(k), position));
        along += 70.0;
        while along > network.edges()[edge].metres {
            along -= network.edges()[edge].metres;
            let ways: Vec<usize> =
                network.next(edge).filter(|next| network.reverse(edge) != Some(*next)).collect();
            match ways.len() {
                0 => return points,
                n => edge = ways[rng.random_range(0..n)],
            }
        }
    }
    points
}

fn matching(criterion: &mut Criterion) {
    let network = network();
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let drives: Vec<_> = (0..50).map(|_| drive(&network, rng)).collect();
    let model = MatchModel { noise: NOISE, ..MatchModel::default() };
    let matcher = Matcher::new(network).with_model(model).expect("a model");
    let mut group = criterion.benchmark_group("matching");
    group.throughput(Throughput::Elements(drives.iter().map(Vec::len).sum::<usize>() as u64));
    group.sample_size(10);
    group.bench_function("whole drives", |bencher| {
        bencher.iter(|| {
            for drive in &drives {
                black_box(matcher.match_drive(drive).expect("a match"));
            }
        });
    });
    group.bench_function("live", |bencher| {
        bencher.iter(|| {
            for drive in &drives {
                let mut vehicle = matcher.start(&drive[0], 3).expect("a vehicle");
                for point in &drive[1..] {
                    black_box(vehicle.step(&matcher, point).expect("a step"));
                }
            }
        });
    });
    group.finish();
}

criterion_group!(benches, matching);
criterion_main!(benches);
