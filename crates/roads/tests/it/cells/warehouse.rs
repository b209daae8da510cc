//! A robot among 400 waypoints that reports when it is sure.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use wayfix::map::{ByClass, PlanePosition};
use wayfix::transition::RestartTransition;
use wayfix::{Belief, Hmm, Prior};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, TurnWeights};
use wayfix_roads::cells::{ReadRates, TagLikelihood};

use super::aisles;
use crate::kit::rng;

const LAG: usize = 20;
const TICKS: usize = 1500;
/// Tick at which the robot is carried elsewhere, without its odometer.
const CARRIED: usize = 800;

/// Robot that turns at random, at 1 m/s.
struct Robot<'a> {
    cells: &'a RoadCells<PlanePosition>,
    motion: &'a CellTransition,
    edge: usize,
    metres: f64,
    rng: ChaCha8Rng,
}

impl Robot<'_> {
    fn drive(&mut self, metres: f64) {
        let network = self.cells.network();
        self.metres += metres;
        let length = network.edges()[self.edge].metres;
        if self.metres >= length {
            let mut left = self.rng.random::<f64>();
            let chosen = network.next(self.edge).find(|&next| {
                left -= self.motion.turn(self.edge, next);
                left < 0.0
            });
            (self.edge, self.metres) = (chosen.unwrap_or(self.edge), self.metres - length);
        }
    }

    /// Tag that is read: sometimes one in range, rarely a wrong one. A tenth of the tags is broken,
    /// which the model does not know.
    fn read(&mut self, tags: &[usize]) -> Option<usize> {
        let edge = self.cells.network().edges()[self.edge];
        let node = if self.metres < 0.4 { edge.from } else { edge.to };
        let near = self.metres < 0.4 || edge.metres - self.metres < 0.4;
        let there = tags.iter().position(|&tag| tag == node && near);
        match self.rng.random::<f64>() {
            x if x < 0.002 => Some(self.rng.random_range(0..tags.len())),
            x if x < 0.2 => there.filter(|tag| tag % 10 > 0),
            _ => None,
        }
    }

    fn position(&self) -> PlanePosition {
        self.cells.network().position_along(self.edge, self.metres)
    }
}

/// Numbers of answers that were sure, sure and right, right, and of all; and the last wrong one
/// before the robot was carried, and in all.
fn run(seed: u64) -> [usize; 4] {
    let mut rng = rng(seed);
    let cells = RoadCells::new(aisles(20, 20, 2.0), 1.0).unwrap();
    let n = cells.states();
    let tags: Vec<usize> = (0..400).filter(|_| rng.random_bool(0.6)).collect();
    let weights = TurnWeights { weight: ByClass::all(1.0), straight_on: 1.0, u_turn: 0.1 };
    let motion = CellTransition::new(&cells, &weights).unwrap();
    let mut odometer = motion.odometer();
    let truth = motion.clone();
    let motion = RestartTransition::new(motion, 1e-5, Belief::uniform(n).unwrap()).unwrap();
    let rates = ReadRates { read: 0.2, misread: 0.002 };
    let reader = TagLikelihood::at_nodes(&cells, &tags, 0.4, rates).unwrap();
    let prior = Prior::AtFirstObservation(Belief::uniform(n).unwrap());
    let hmm = Hmm::new(prior, motion, reader).unwrap();
    let mut smoother = hmm.fixed_lag(LAG);

    let edges = cells.network().edges().len();
    let edge = rng.random_range(0..edges);
    let mut robot = Robot { cells: &cells, motion: &truth, edge, metres: 0.0, rng };
    let noise = Normal::new(0.0, 0.01).unwrap();
    // Wheels never have quite the size that the model assumes.
    let scale = 1.0 + 0.01 * (robot.rng.random::<f64>() - 0.5);
    let (mut positions, mut aheads, mut counts) = (Vec::new(), Vec::new(), [0; 4]);
    for tick in 0..TICKS {
        robot.drive(0.1);
        if tick == CARRIED {
            robot.edge = robot.rng.random_range(0..edges);
        }
        let reading = 0.1 * scale + noise.sample(&mut robot.rng);
        let travel = odometer.add(reading, 2e-4).unwrap();
        smoother.step_with(&travel, &robot.read(&tags)).unwrap();
        positions.push(robot.position());
        aheads.push(odometer.ahead());
        if tick < LAG {
            continue;
        }
        let (belief, ahead) = (smoother.lagged(), aheads[tick - LAG]);
        let answer = cells.position_ahead(belief.mode(), ahead);
        // All positions within the cell are within 1.5 m.
        let mass: f64 = (0..n)
            .filter(|&cell| belief.as_slice()[cell] > 1e-6)
            .filter(|&cell| cells.position_ahead(cell, ahead).metres_to(answer) <= 1.0)
            .map(|cell| belief.as_slice()[cell])
            .sum();
        let (sure, right) = (mass >= 0.9, answer.metres_to(positions[tick - LAG]) <= 1.5);
        for (count, one) in counts.iter_mut().zip([sure, sure && right, right, true]) {
            *count += usize::from(one);
        }
    }
    counts
}

#[test]
fn a_robot_that_says_it_is_sure_is_right() {
    let runs: Vec<[usize; 4]> = (0..4).map(run).collect();
    for &[sure, both, right, all] in &runs {
        println!("sure {sure}, of these right {both}, right {right} of {all}");
    }
    let total = |at: usize| runs.iter().map(|run| run[at]).sum::<usize>() as f64;
    let (sure, both, right, all) = (total(0), total(1), total(2), total(3));
    assert!(both >= 0.9 * sure, "right in {both} of {sure}");
    // Never being sure would be useless.
    assert!(sure >= 0.25 * all && right >= 0.5 * all, "{sure}, {right} of {all}");
}
