//! Robots whose wheels are too large or too small, or slip: probabilities are calibrated.
//!
//! The constants of the model were chosen on other seeds.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wayfix::likelihood::GroupedLikelihood;
use wayfix::map::{ByClass, PlanePosition};
use wayfix::transition::RestartTransition;
use wayfix::{Belief, Hmm, Prior};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, TurnWeights, WheelTransition, Wheels};
use wayfix_roads::cells::{ReadRates, TagLikelihood};

use super::aisles;
use crate::kit::rng;

const TICKS: usize = 1200;
/// Ticks before the first answer that counts.
const FIRST: usize = 200;

/// Errors of the wheels.
#[derive(Debug, Clone, Copy, Default)]
struct Truth {
    /// Metres read for each metre driven, less 1; of either sign.
    scale: f64,
    /// Probability that a slip begins in a tick, its ticks, and the part of the way driven in it.
    slips: (f64, usize, f64),
}

#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    /// Numbers of answers, of answers within 1.5 m with probability 0.95 or more, and of right ones
    /// among the latter.
    all: usize,
    sure: usize,
    right: usize,
    /// Steps with the vehicle's cell in the smallest set of 95%, and the probability of these sets.
    held: usize,
    stated: f64,
}

fn run(seed: u64, truth: Truth, counts: &mut Counts) {
    let mut rng = rng(seed);
    let cells = RoadCells::new(aisles(8, 8, 2.0), 0.5).unwrap();
    let n = cells.states();
    let network = cells.network().clone();
    let tags: Vec<usize> = (0..64).filter(|_| rng.random_bool(0.6)).collect();
    let weights = TurnWeights { weight: ByClass::all(1.0), straight_on: 1.0, u_turn: 0.1 };
    let turns = CellTransition::new(&cells, &weights).unwrap();
    let motion = WheelTransition::new(turns.clone(), Wheels::default()).unwrap();
    let mut odometer = motion.odometer();
    let groups = motion.cell_groups();
    let rates = ReadRates { read: 0.2, misread: 0.002 };
    let reader = TagLikelihood::at_nodes(&cells, &tags, 0.4, rates).unwrap();
    let reader = GroupedLikelihood::new(reader, groups.clone()).unwrap();
    let anywhere = motion.spread(&Belief::uniform(n).unwrap()).unwrap();
    let motion = RestartTransition::new(motion, 1e-5, anywhere.clone()).unwrap();
    let hmm = Hmm::new(Prior::AtFirstObservation(anywhere), motion, reader).unwrap();
    let mut filter = hmm.filter();

    let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let (mut edge, mut metres) = (rng.random_range(0..network.edges().len()), 0.0);
    let mut slipping = 0;
    for tick in 0..TICKS {
        slipping = match slipping {
            0 if rng.random_bool(truth.slips.0) => truth.slips.1,
            ticks => ticks.saturating_sub(1),
        };
        metres += if slipping > 0 { 0.1 * truth.slips.2 } else { 0.1 };
        if metres >= 2.0 {
            (edge, metres) = (turn(&turns, &network, edge, &mut rng), metres - 2.0);
        }
        let noise: f64 = StandardNormal.sample(&mut rng);
        let reading = 0.1 * (1.0 + sign * truth.scale) + 0.01 * noise;
        // The model's noise is twice the true one.
        let travel = odometer.add(reading, 2e-4).unwrap();
        let ends = network.edges()[edge];
        let node = if metres < 0.4 { Some(ends.from) } else { None };
        let node = node.or((metres > 1.6).then_some(ends.to));
        let seen = match rng.random::<f64>() {
            x if x < 0.002 => Some(rng.random_range(0..tags.len())),
            x if x < 0.2 => tags.iter().position(|tag| Some(*tag) == node),
            _ => None,
        };
        filter.step_with(&travel, &seen).unwrap();
        if tick < FIRST {
            continue;
        }
        let belief = groups.marginal(&filter.belief()).unwrap();
        let answer = cells.position(belief.mode());
        let near = (0..n).filter(|&cell| cells.position(cell).metres_to(answer) <= 1.25);
        let sure = belief.mass(near).unwrap() >= 0.95;
        let right = answer.metres_to(network.position_along(edge, metres)) <= 1.5;
        counts.all += 1;
        counts.sure += usize::from(sure);
        counts.right += usize::from(sure && right);
        let set = belief.credible_set(0.95).unwrap();
        counts.held += usize::from(set.contains(&cells.cell_at(edge, metres)));
        counts.stated += belief.mass(set.iter().copied()).unwrap();
    }
}

fn turn(
    turns: &CellTransition,
    network: &wayfix_roads::RoadNetwork<PlanePosition>,
    edge: usize,
    rng: &mut ChaCha8Rng,
) -> usize {
    let mut left = rng.random::<f64>();
    let chosen = network.next(edge).find(|&next| {
        left -= turns.turn(edge, next);
        left < 0.0
    });
    chosen.unwrap_or(edge)
}

#[test]
fn a_robot_whose_wheels_err_is_right_when_it_is_sure() {
    let scales = [0.0, 0.01, 0.02, 0.05].map(|scale| Truth { scale, ..Truth::default() });
    let slips = [
        Truth { scale: 0.0, slips: (0.02, 1, 0.5) },
        Truth { scale: 0.02, slips: (0.004, 10, 0.3) },
    ];
    let (mut all, mut seed) = (Counts::default(), 500);
    for truth in scales.into_iter().chain(slips) {
        let mut counts = Counts::default();
        for _ in 0..2 {
            run(seed, truth, &mut counts);
            seed += 1;
        }
        println!("{truth:?}: {counts:?}");
        // Even for each kind of wheels.
        assert!(counts.right as f64 >= 0.97 * counts.sure as f64, "{truth:?}: {counts:?}");
        assert!(counts.held as f64 >= 0.9 * counts.all as f64, "{truth:?}: {counts:?}");
        all = Counts {
            all: all.all + counts.all,
            sure: all.sure + counts.sure,
            right: all.right + counts.right,
            held: all.held + counts.held,
            stated: all.stated + counts.stated,
        };
    }
    assert!(all.right as f64 >= 0.98 * all.sure as f64, "{all:?}");
    assert!(all.held as f64 >= all.stated - 0.02 * all.all as f64, "{all:?}");
    // Never being sure would be useless. Live, the aisle is unknown right after a crossing.
    assert!(all.sure as f64 >= 0.08 * all.all as f64, "{all:?}");
}
