//! GPS, a camera that recognises some places, and an odometer: how often each of them names the
//! right road, and how often all of them together do. The drives are simulated, take ten minutes
//! and start anywhere within a kilometre.
//!
//! Run `cargo run --release -p wayfix-roads --example sensors` for a made-up town, or add `-- --roads FOLDER`.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::PathBuf;

use clap::Parser;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wayfix::inference::Pruning;
use wayfix::map::{Position, RoadClass};
use wayfix::{Belief, FusedLikelihood, Hmm, OptionalLikelihood, Prior, PrunedFilter};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, Travel, TurnWeights};
use wayfix_roads::cells::{PositionFix, PositionLikelihood, ReadRates, TagLikelihood};
use wayfix_roads::{ImportOptions, NetworkBuilder, RoadNetwork};

#[derive(Parser)]
struct Arguments {
    /// Folder with `nodes.csv` and `edges.csv` [default: a made-up town].
    #[arg(long)]
    roads: Option<PathBuf>,
    #[arg(long, default_value_t = 8)]
    drives: u64,
}

/// Steps of a drive, one a second.
const STEPS: usize = 600;
/// Metres from a recognised place within which the camera sees it.
const SEEN: f64 = 25.0;
/// Deviation of fixes in the model: larger than their error of 10 m, since that persists.
const DEVIATION: f64 = 20.0;
/// Share of places that the camera recognises.
const KNOWN: f64 = 0.4;
const RATES: ReadRates = ReadRates { read: 0.5, misread: 0.005 };

/// Sensors in use: GPS, camera, odometer.
const CHOICES: [(&str, [bool; 3]); 5] = [
    ("GPS", [true, false, false]),
    ("camera", [false, true, false]),
    ("odometer", [false, false, true]),
    ("GPS + odometer", [true, false, true]),
    ("all", [true, true, true]),
];

/// One second of a drive: its edge, the metres to the edge's nearer end, and the measurements.
struct Second {
    edge: usize,
    to_end: f64,
    fix: Option<Position>,
    seen: Option<usize>,
    metres: f64,
}

type Sensor =
    FusedLikelihood<OptionalLikelihood<PositionLikelihood>, OptionalLikelihood<TagLikelihood>>;

/// Builds a town of 12 × 10 crossings, some 120 m apart; every fourth road is a main road.
fn town(rng: &mut ChaCha8Rng) -> Result<RoadNetwork, Box<dyn Error>> {
    let mut builder = NetworkBuilder::new();
    for id in 0..120 {
        let mut at = |i: u64| 0.00108 * (i as f64 + 0.3 * (rng.random::<f64>() - 0.5));
        let position = Position { latitude: -35.3 + at(id / 12), longitude: 149.1 + at(id % 12) };
        builder.node(id, position)?;
    }
    let class = |line: u64| if line % 4 == 1 { RoadClass::Main } else { RoadClass::Street };
    for id in 0..120 {
        let (x, y) = (id % 12, id / 12);
        if x < 11 && (class(y) == RoadClass::Main || rng.random_bool(0.8)) {
            builder.both_ways(id, id + 1, class(y))?;
        }
        if y < 9 && (class(x) == RoadClass::Main || rng.random_bool(0.8)) {
            builder.both_ways(id, id + 12, class(x))?;
        }
    }
    Ok(builder.build()?)
}

/// Drives at random, at up to 14 m/s, and measures.
fn drive(
    cells: &RoadCells,
    motion: &CellTransition,
    known: &[usize],
    rng: &mut ChaCha8Rng,
) -> Vec<Second> {
    let network = cells.network();
    let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
    let (mut edge, mut along) = (rng.random_range(0..network.edges().len()), 0.0);
    let (mut speed, mut error, mut gap) = (10.0_f64, [0.0; 2], 0_u32);
    let mut second = |_| {
        speed = (speed + normal(rng)).clamp(0.0, 14.0);
        along += speed;
        while along >= network.edges()[edge].metres {
            along -= network.edges()[edge].metres;
            // Inverse transform: the first turn at which the cumulative probability exceeds a
            // uniform number.
            let mut left: f64 = rng.random();
            let mut turns = network.next(edge).skip_while(|&next| {
                left -= motion.turn(edge, next);
                left >= 0.0
            });
            edge = turns.next().unwrap_or(edge);
        }
        let road = network.edges()[edge];
        // Errors of 10 m that persist for some ten seconds, outliers, gaps of half a minute.
        error = error.map(|error: f64| 0.9 * error + 4.4 * normal(rng));
        gap = if gap == 0 && rng.random_bool(0.01) { 30 } else { gap.saturating_sub(1) };
        let degrees = if rng.random_bool(0.04) { 8.0 } else { 1.0 } / 111_195.0;
        let Position { latitude, longitude } = network.position_along(edge, along);
        // A degree of longitude is shorter than one of latitude.
        let east = degrees / latitude.to_radians().cos();
        let fix = (gap == 0).then(|| Position {
            latitude: latitude + degrees * error[0],
            longitude: longitude + east * error[1],
        });
        let to_end = along.min(road.metres - along);
        let node = if along < SEEN { road.from } else { road.to };
        let there = known.binary_search(&node).ok().filter(|_| to_end < SEEN);
        let seen = match rng.random::<f64>() {
            x if x < RATES.misread => Some(rng.random_range(0..known.len())),
            x if x < RATES.misread + RATES.read => there,
            _ => None,
        };
        let metres = (speed * (1.0 + 0.02 * normal(rng))).max(0.0);
        Second { edge, to_end, fix, seen, metres }
    };
    (0..STEPS).map(&mut second).collect()
}

/// Follows a drive, and counts steps: all that are judged, right, sure, and sure and right.
fn judge(
    filter: &mut PrunedFilter<&Hmm<&CellTransition, &Sensor>>,
    cells: &RoadCells,
    seconds: &[Second],
    [gps, camera, odometer]: [bool; 3],
) -> Result<[usize; 4], Box<dyn Error>> {
    let mut meter = filter.model().transition().odometer();
    // Without an odometer, all distances up to 20 m are equally likely.
    let most = (0..1000).take_while(|&k| f64::from(k) * cells.mean_metres() < 20.0).count();
    let any = Travel::of_cells(0, &vec![1.0 / most as f64; most])?;
    let mut counts = [0; 4];
    for second in seconds {
        let travel = if odometer { meter.add(second.metres, 0.05)? } else { any.clone() };
        let ahead = meter.ahead();
        let fix = second.fix.filter(|_| gps);
        let fix = fix.map(|at| PositionFix { ahead, ..PositionFix::new(at, DEVIATION) });
        filter.step_with(&travel, &(fix, camera.then_some(second.seen)))?;
        if second.to_end < 10.0 {
            continue; // at a junction, the road is a matter of metres
        }
        // An answer is a road, not a cell: cells of an edge count together.
        let mut roads = BTreeMap::new();
        for (&cell, p) in filter.active().iter().zip(filter.probabilities()) {
            *roads.entry(cells.edge(cell)).or_insert(0.0_f64) += p;
        }
        let best = roads.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let (edge, p) = best.unwrap_or_default();
        let (sure, right) = (p >= 0.9, edge == second.edge);
        let is = [true, right, sure, sure && right];
        counts.iter_mut().zip(is).for_each(|(count, is)| *count += usize::from(is));
    }
    Ok(counts)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (network, spacing) = match &arguments.roads {
        Some(roads) => (RoadNetwork::from_path(roads, &ImportOptions::default())?.0, 10.0),
        None => (town(&mut rng)?, 5.0),
    };
    let cells = RoadCells::new(network.largest_component().0, spacing)?;
    let nodes = cells.network().nodes().len();
    let known: Vec<usize> = (0..nodes).filter(|_| rng.random_bool(KNOWN)).collect();
    let motion = CellTransition::new(&cells, &TurnWeights::default())?;
    let gps = OptionalLikelihood::new(PositionLikelihood::new(&cells));
    let camera = OptionalLikelihood::new(TagLikelihood::at_nodes(&cells, &known, SEEN, RATES)?);
    let sensor = FusedLikelihood::new(gps, camera)?;
    println!("{} cells, {} of {nodes} places known to the camera", cells.states(), known.len());
    println!("sensors            right road     p >= 0.9   right where p >= 0.9");
    for (name, choice) in CHOICES {
        // Each choice of sensors sees the same drives.
        let (mut sums, mut rng) = ([0; 4], ChaCha8Rng::seed_from_u64(2));
        for _ in 0..arguments.drives {
            let seconds = drive(&cells, &motion, &known, &mut rng);
            let start = cells.position(cells.cells(seconds[0].edge).start);
            let near = |cell| f64::from(cells.position(cell).metres_to(start) < 1000.0);
            let prior = Belief::from_weights((0..cells.states()).map(near).collect::<Vec<_>>())?;
            let hmm = Hmm::new(Prior::AtFirstObservation(prior), &motion, &sensor)?;
            let pruning = Pruning::default().with_tolerance(1e-4).with_most_active(20_000);
            let judged = judge(&mut hmm.pruned_filter(pruning), &cells, &seconds, choice)?;
            sums.iter_mut().zip(judged).for_each(|(sum, count)| *sum += count);
        }
        let percent = |part: usize, of: usize| match sums[of] {
            0 => String::from("-"),
            all => format!("{:.1}%", 100.0 * sums[part] as f64 / all as f64),
        };
        println!("{name:18} {:>10} {:>12} {:>22}", percent(1, 0), percent(2, 0), percent(3, 2));
    }
    Ok(())
}
