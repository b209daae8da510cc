//! A robot in a warehouse of 400 waypoints, with wheel odometry at 10 Hz and a reader of tags,
//! located live with a lag of two seconds, and once carried elsewhere.
//!
//! `cargo run --release --example warehouse`

use std::error::Error;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use wayfix::map::{ByClass, NetworkBuilder, PlanePosition, RoadCells, RoadClass};
use wayfix::motion::{CellTransition, TurnWeights};
use wayfix::observation::{ReadRates, TagLikelihood};
use wayfix::transition::RestartTransition;
use wayfix::{Belief, Hmm, Prior};

const SIDE: u64 = 20;
const AISLE: f64 = 2.0;
const LAG: usize = 20;
/// Ticks of a run, and the tick at which the robot is carried.
const TICKS: (usize, usize) = (3000, 1500);
/// Metres within which an answer is right.
const RIGHT: f64 = 1.5;

/// A robot that turns at random: edge and metres along it.
struct Robot {
    edge: usize,
    metres: f64,
    rng: ChaCha8Rng,
}

impl Robot {
    fn drive(&mut self, motion: &CellTransition, cells: &RoadCells<PlanePosition>, metres: f64) {
        self.metres += metres;
        let length = cells.network().edges()[self.edge].metres;
        if self.metres >= length {
            let mut left = self.rng.random::<f64>();
            let mut next = cells.network().next(self.edge).filter(|&next| {
                left -= motion.turn(self.edge, next);
                left < 0.0
            });
            self.edge = next.next().unwrap_or(self.edge);
            self.metres -= length;
        }
    }

    /// Tag that is read: of those near, with misses, or any by mistake.
    fn read(&mut self, tags: &[usize], cells: &RoadCells<PlanePosition>) -> Option<usize> {
        let edge = cells.network().edges()[self.edge];
        let node = if self.metres < 0.4 { edge.from } else { edge.to };
        let near = self.metres < 0.4 || edge.metres - self.metres < 0.4;
        let there = tags.iter().position(|&tag| tag == node && near);
        match self.rng.random::<f64>() {
            x if x < 0.002 => Some(self.rng.random_range(0..tags.len())),
            x if x < 0.2 => there,
            _ => None,
        }
    }
}

/// Answers that were sure, sure and right, right, and all.
fn run(seed: u64) -> Result<[usize; 4], Box<dyn Error>> {
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
    let cells = RoadCells::new(builder.build()?, 1.0)?;
    let n = cells.states();
    let tags: Vec<usize> = (0..400).filter(|_| rng.random_bool(0.6)).collect();

    let weights = TurnWeights { weight: ByClass::all(1.0), straight_on: 1.0, u_turn: 0.1 };
    let motion = CellTransition::new(&cells, &weights)?;
    let mut odometer = motion.odometer();
    let truth = motion.clone();
    // Carried about once in three hours.
    let motion = RestartTransition::new(motion, 1e-5, Belief::uniform(n)?)?;
    let rates = ReadRates { read: 0.2, misread: 0.002 };
    let reader = TagLikelihood::at_nodes(&cells, &tags, 0.4, rates)?;
    let hmm = Hmm::new(Prior::AtFirstObservation(Belief::uniform(n)?), motion, reader)?;
    let mut smoother = hmm.fixed_lag(LAG);

    let anywhere = |rng: &mut ChaCha8Rng| rng.random_range(0..cells.network().edges().len());
    let mut robot = Robot { edge: anywhere(&mut rng), metres: 0.0, rng };
    let noise = Normal::new(0.0, 0.01)?;
    // Wheels are never quite as large as they are taken to be.
    let scale = 1.0 + 0.005 * (robot.rng.random::<f64>() - 0.5);
    let (mut positions, mut aheads, mut counts) = (Vec::new(), Vec::new(), [0; 4]);
    for tick in 0..TICKS.0 {
        let metres = 0.1;
        robot.drive(&truth, &cells, metres);
        if tick == TICKS.1 {
            robot.edge = anywhere(&mut robot.rng);
        }
        let reading = metres * scale + noise.sample(&mut robot.rng);
        let travel = odometer.add(reading, 2e-4)?;
        let seen = robot.read(&tags, &cells);
        smoother.step_with(&travel, &seen)?;
        positions.push(cells.network().position_along(robot.edge, robot.metres));
        aheads.push(odometer.ahead());
        if tick < LAG {
            continue;
        }
        let (belief, ahead) = (smoother.lagged(), aheads[tick - LAG]);
        let answer = cells.position_ahead(belief.mode(), ahead);
        // Near enough for all positions within the cell.
        let near = (0..n)
            .filter(|&cell| cells.position_ahead(cell, ahead).metres_to(answer) < RIGHT - 0.5);
        let sure = belief.mass(near)? >= 0.9;
        let right = answer.metres_to(positions[tick - LAG]) <= RIGHT;
        counts[0] += usize::from(sure);
        counts[1] += usize::from(sure && right);
        counts[2] += usize::from(right);
        counts[3] += 1;
    }
    Ok(counts)
}

fn main() -> Result<(), Box<dyn Error>> {
    for seed in 0..8 {
        let [sure, both, right, all] = run(seed)?;
        let share = |part: usize, all: usize| 100.0 * part as f64 / all as f64;
        println!(
            "run {seed}: right {:.1}%, sure {:.1}%, right when sure {:.1}%",
            share(right, all),
            share(sure, all),
            share(both, sure)
        );
    }
    Ok(())
}
