//! A robot in a warehouse of 144 waypoints, with wheel odometry at 10 Hz and a tag reader, located
//! live, and once carried elsewhere. Its wheels have errors that the odometer does not know: their
//! size, and slips.
//!
//! `cargo run --release -p wayfix-roads --example warehouse`
//!
//! Each line compares a model of independent errors with a model of the wheels. After a crossing
//! nobody knows which aisle was taken until the next tag is read, and four out of ten waypoints
//! have none: so a robot with correct probabilities is sure of its place in a sixth of the ticks.

use std::error::Error;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use wayfix::likelihood::GroupedLikelihood;
use wayfix::map::{ByClass, PlanePosition, RoadClass};
use wayfix::transition::RestartTransition;
use wayfix::{Belief, Hmm, Prior};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, TurnWeights, WheelTransition, Wheels};
use wayfix_roads::cells::{ReadRates, TagLikelihood};
use wayfix_roads::{NetworkBuilder, RoadNetwork};

const SIDE: u64 = 12;
const AISLE: f64 = 2.0;
/// Metres before and behind a tag at which it is read.
const RANGE: f64 = 0.4;
/// Ticks of a run, and the tick at which the robot is carried.
const TICKS: (usize, usize) = (3000, 1500);
/// Ticks after the start, and after it was carried, whose answers do not count.
const LOST: usize = 300;
/// Metres within which an answer is right.
const RIGHT: f64 = 1.5;

/// Errors of the wheels.
#[derive(Clone, Copy)]
struct Fault {
    name: &'static str,
    /// Metres read for each metre driven, less 1; of either sign.
    scale: f64,
    /// Probability that a slip begins in a tick, its length in ticks, and the part of the way
    /// driven in it.
    slips: (f64, usize, f64),
}

/// A tick: where the robot is, what the wheels read, and the tag that was read.
struct Tick {
    edge: usize,
    metres: f64,
    reading: f64,
    tag: Option<usize>,
}

/// A robot that turns at random at each crossing.
fn drive(
    network: &RoadNetwork<PlanePosition>,
    turns: &CellTransition,
    tags: &[usize],
    fault: Fault,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<Tick>, Box<dyn Error>> {
    let noise = Normal::new(0.0, 0.01)?;
    let scale = 1.0 + if rng.random_bool(0.5) { fault.scale } else { -fault.scale };
    let anywhere = |rng: &mut ChaCha8Rng| rng.random_range(0..network.edges().len());
    let (mut edge, mut metres, mut slipping) = (anywhere(rng), 0.0, 0);
    let mut ticks = Vec::new();
    for tick in 0..TICKS.0 {
        slipping = match slipping {
            0 if rng.random_bool(fault.slips.0) => fault.slips.1,
            left => left.saturating_sub(1),
        };
        metres += if slipping > 0 { 0.1 * fault.slips.2 } else { 0.1 };
        if metres >= AISLE {
            // Inverse transform over the turns of the model: the robot drives as the model assumes.
            let mut left = rng.random::<f64>();
            let mut next = network.next(edge).filter(|&next| {
                left -= turns.turn(edge, next);
                left < 0.0
            });
            (edge, metres) = (next.next().unwrap_or(edge), metres - AISLE);
        }
        if tick == TICKS.1 {
            edge = anywhere(rng);
        }
        let ends = network.edges()[edge];
        let node = if metres < AISLE / 2.0 { ends.from } else { ends.to };
        let near = metres < RANGE || AISLE - metres < RANGE;
        let there = tags.iter().position(|&tag| tag == node && near);
        // Tags are often missed, and rarely another is read by mistake.
        let tag = match rng.random::<f64>() {
            x if x < 0.002 => Some(rng.random_range(0..tags.len())),
            x if x < 0.2 => there,
            _ => None,
        };
        ticks.push(Tick { edge, metres, reading: 0.1 * scale + noise.sample(rng), tag });
    }
    Ok(ticks)
}

/// Answers: all, those within `RIGHT` with a probability of 0.95, the right ones among these, and
/// those whose set of 95% holds the cell of the robot.
#[derive(Default)]
struct Counts {
    all: usize,
    sure: usize,
    right: usize,
    held: usize,
}

impl Counts {
    fn add(
        &mut self,
        cells: &RoadCells<PlanePosition>,
        belief: &Belief,
        ahead: f64,
        tick: &Tick,
    ) -> Result<(), Box<dyn Error>> {
        let answer = cells.position_ahead(belief.mode(), ahead);
        // The cell's own length is taken off, so that all positions within the cell are near
        // enough.
        let within = RIGHT - cells.mean_metres() / 2.0;
        let near = (0..cells.states())
            .filter(|&cell| cells.position_ahead(cell, ahead).metres_to(answer) <= within);
        let sure = belief.mass(near)? >= 0.95;
        let there = cells.network().position_along(tick.edge, tick.metres);
        self.all += 1;
        self.sure += usize::from(sure);
        self.right += usize::from(sure && answer.metres_to(there) <= RIGHT);
        let cell = cells.cell_at(tick.edge, tick.metres);
        self.held += usize::from(belief.credible_set(0.95)?.contains(&cell));
        Ok(())
    }

    fn print(&self, name: &str) {
        let share = |part: usize, all: usize| 100.0 * part as f64 / all as f64;
        println!(
            "  {name:20} sure {:4.1}%, right when sure {:5.1}%, sets of 95% hold {:4.1}%",
            share(self.sure, self.all),
            share(self.right, self.sure),
            share(self.held, self.all),
        );
    }
}

fn run(seed: u64, fault: Fault, counts: &mut [Counts; 2]) -> Result<(), Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut builder = NetworkBuilder::new();
    for id in 0..SIDE * SIDE {
        let (x, y) = (AISLE * (id % SIDE) as f64, AISLE * (id / SIDE) as f64);
        builder.node(id, PlanePosition { x, y })?;
    }
    for id in 0..SIDE * SIDE {
        if (id + 1) % SIDE > 0 {
            builder.both_ways(id, id + 1, RoadClass::Street)?;
        }
        if id + SIDE < SIDE * SIDE {
            builder.both_ways(id, id + SIDE, RoadClass::Street)?;
        }
    }
    let cells = RoadCells::new(builder.build()?, 0.5)?;
    let anywhere = Belief::uniform(cells.states())?;
    let nodes = cells.network().nodes().len();
    let tags: Vec<usize> = (0..nodes).filter(|_| rng.random_bool(0.6)).collect();
    // Close to the rates at which `drive` reads.
    let rates = ReadRates { read: 0.2, misread: 0.002 };
    let reader = TagLikelihood::at_nodes(&cells, &tags, RANGE, rates)?;
    let weights = TurnWeights { weight: ByClass::all(1.0), straight_on: 1.0, u_turn: 0.1 };
    let motion = CellTransition::new(&cells, &weights)?;
    let ticks = drive(cells.network(), &motion, &tags, fault, &mut rng)?;
    let counted = |tick: usize| tick % TICKS.1 >= LOST;
    // It is carried about once in three hours.
    let rate = 1e-5;

    // Each reading has an error of its own.
    let mut odometer = motion.odometer();
    let independent = RestartTransition::new(motion.clone(), rate, anywhere.clone())?;
    let hmm = Hmm::new(Prior::AtFirstObservation(anywhere.clone()), independent, &reader)?;
    let mut filter = hmm.filter();
    for (number, tick) in ticks.iter().enumerate() {
        filter.step_with(&odometer.add(tick.reading, 2e-4)?, &tick.tag)?;
        if counted(number) {
            let belief = Belief::new(filter.belief().as_slice().to_vec())?;
            counts[0].add(&cells, &belief, odometer.ahead(), tick)?;
        }
    }

    // Wheels of unknown size, which may slip.
    let motion = WheelTransition::new(motion, Wheels::default())?;
    let mut odometer = motion.odometer();
    // Tags depend on the cell, not on the scale: each cell's states share its likelihood.
    let groups = motion.cell_groups();
    let reader = GroupedLikelihood::new(reader, groups.clone())?;
    let anywhere = motion.spread(&anywhere)?;
    let motion = RestartTransition::new(motion, rate, anywhere.clone())?;
    let hmm = Hmm::new(Prior::AtFirstObservation(anywhere), motion, reader)?;
    let mut filter = hmm.filter();
    for (number, tick) in ticks.iter().enumerate() {
        filter.step_with(&odometer.add(tick.reading, 2e-4)?, &tick.tag)?;
        if counted(number) {
            // Each scale is ahead of its cells by a different distance; together they average to
            // the middle.
            counts[1].add(&cells, &groups.marginal(&filter.belief())?, 0.0, tick)?;
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let none = (0.0, 0, 1.0);
    let faults = [
        Fault { name: "wheels as they should be", scale: 0.0, slips: none },
        Fault { name: "a scale error of 1%", scale: 0.01, slips: none },
        Fault { name: "a scale error of 2%", scale: 0.02, slips: none },
        Fault { name: "a scale error of 5%", scale: 0.05, slips: none },
        Fault { name: "slips, each of half a tick", scale: 0.0, slips: (0.02, 1, 0.5) },
        Fault { name: "2%, and slips for a second", scale: 0.02, slips: (0.004, 10, 0.3) },
    ];
    for fault in faults {
        let mut counts = [Counts::default(), Counts::default()];
        for seed in 0..4 {
            run(seed, fault, &mut counts)?;
        }
        println!("{}", fault.name);
        counts[0].print("independent errors");
        counts[1].print("errors of wheels");
    }
    Ok(())
}
