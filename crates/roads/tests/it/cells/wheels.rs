//! Wheels with errors that last: the operator against its definition, and its odometer.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::transition::RestartTransition;
use wayfix::{Belief, Transition, TransitionEntries};
use wayfix_roads::cells::{CellTransition, TurnWeights, WheelTransition, WheelTravel, Wheels};

use super::{networks, road, weights};
use crate::kit::{
    Expected, Matrix, assert_operator, cases_of, close, dense, matrix, restart, text,
};

/// Probability of a scale after a distance in metres, by all outcomes of eight coins.
fn change(wheels: &Wheels, metres: f64, to: usize, from: usize) -> f64 {
    let turned = 0.5 * (1.0 - (-metres / wheels.lasts).exp());
    let start = (1_u32 << from) - 1;
    let outcomes = (0..256_u32).filter(|end| end.count_ones() as usize == to);
    let p = |end: u32| {
        let count = (start ^ end).count_ones().cast_signed();
        turned.powi(count) * (1.0 - turned).powi(8 - count)
    };
    outcomes.map(p).sum()
}

/// A[(g, i), (h, j)] = S[g, h] A_g[i, j], with the metres after which S changes the scale.
fn by_definition(motion: &WheelTransition, control: &WheelTravel, metres: Option<f64>) -> Matrix {
    let n = motion.cells().states();
    let moves = |travel| {
        let columns: Vec<Vec<(usize, f64)>> =
            (0..n).map(|from| motion.cells().outgoing(travel, from).collect()).collect();
        matrix(n, |to, from| {
            columns[from].iter().filter(|entry| entry.0 == to).map(|entry| entry.1).sum()
        })
    };
    let moves: Vec<Matrix> = control.travels().iter().map(moves).collect();
    let scale = |to, from| match metres {
        Some(metres) => change(motion.wheels(), metres, to, from),
        None => f64::from(u8::from(to == from)),
    };
    matrix(motion.states(), |to, from| scale(to / n, from / n) * moves[to / n][to % n][from % n])
}

fn wheels() -> impl Strategy<Value = Wheels> {
    let slips = prop_oneof![Just(0.0), 0.01..0.5_f64];
    (0.005..0.2_f64, 3.0..500.0_f64, slips, 0.05..0.9_f64)
        .prop_map(|(scale, lasts, slips, slipped)| Wheels { scale, lasts, slips, slipped })
}

proptest! {
    #![proptest_config(cases_of(60))]

    #[test]
    fn it_is_a_chain_of_scales_and_a_move_by_each(
        cells in networks(2, 1),
        (weights, wheels) in (weights(), wheels()),
        // One distance within a cell, which changes no scale, and two beyond it.
        (short, long) in (0.0..0.05_f64, vec((1.3..4.0_f64, 0.0..0.2_f64), 2)),
        restarts in any::<bool>(),
    ) {
        let motion = CellTransition::new(&cells, &weights).unwrap();
        let motion = WheelTransition::new(motion, wheels).unwrap();
        let mut odometer = motion.odometer();
        // Metres that are released by the first reading are less than a cell.
        let mut controls = vec![odometer.add(short * cells.mean_metres(), 0.0).unwrap()];
        let mut expected = vec![by_definition(&motion, &controls[0], None)];
        let mut since = short * cells.mean_metres();
        for (part, variance) in long {
            let metres = part * cells.mean_metres();
            since += metres;
            controls.push(odometer.add(metres, variance * cells.mean_metres().powi(2)).unwrap());
            let moved = controls.last().unwrap().travels().iter().any(|travel| travel.last() > 0);
            expected.push(by_definition(&motion, controls.last().unwrap(), moved.then_some(since)));
            since = if moved { 0.0 } else { since };
        }
        if restarts {
            let n = cells.states();
            let anywhere = motion.spread(&Belief::uniform(n).unwrap()).unwrap();
            let r = anywhere.as_slice().to_vec();
            let expected: Vec<Matrix> = expected.iter().map(|a| restart(a, 0.1, &r)).collect();
            let motion = RestartTransition::new(motion, 0.1, anywhere).unwrap();
            assert_operator(motion, Expected::each(&controls, &expected).within(1e-11, 1e-300))?;
        } else {
            assert_operator(motion, Expected::each(&controls, &expected).within(1e-11, 1e-300))?;
        }
    }

    /// Each scale drives the metres read, divided by itself, less those lost in slips.
    #[test]
    fn metres_are_kept(
        (wheels, ticks) in (wheels(), vec(0.0..3.0_f64, 200)),
    ) {
        // Slips of less than a cell: a slip cannot lose more than was driven.
        let wheels = Wheels { slips: 0.1 * wheels.slips, slipped: 0.5 * wheels.slipped, ..wheels };
        let motion = CellTransition::new(&road(5000.0), &TurnWeights::default()).unwrap();
        let motion = WheelTransition::new(motion, wheels).unwrap();
        let mut odometer = motion.odometer();
        let start: Vec<f64> = (0..9).map(|scale| odometer.ahead(scale)).collect();
        let mut places: Vec<i64> = start.iter().map(|at| (at / 5.0 * 18.0).round() as i64).collect();
        places.sort_unstable();
        prop_assert_eq!(places, vec![-8, -6, -4, -2, 0, 2, 4, 6, 8]);
        let (mut driven, mut variance) = ([0.0; 9], [0.0; 9]);
        for metres in &ticks {
            let control = odometer.add(*metres, 1e-4 * metres).unwrap();
            for (scale, travel) in control.travels().iter().enumerate() {
                driven[scale] += 5.0 * travel.mean();
                variance[scale] += 25.0 * travel.variance();
            }
        }
        let read: f64 = ticks.iter().sum();
        for (scale, value) in motion.scales().iter().enumerate() {
            let released = read / value + start[scale] - odometer.ahead(scale);
            let kept = 1.0 - wheels.slips * wheels.slipped;
            close(driven[scale], kept * released, 2e-2, 1.0)?;
            prop_assert!(variance[scale] >= 1e-4 * released / (value * value) - 1e-9);
            prop_assert!(odometer.ahead(scale).abs() <= 2.5 + 1e-9);
        }
    }
}

#[test]
fn wheels_without_a_deviation_have_one_scale() {
    let cells = road(100.0);
    let motion = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let wheels = Wheels { scale: 0.0, ..Wheels::default() };
    let motion = WheelTransition::new(motion, wheels).unwrap();
    assert_eq!((motion.scales(), motion.states()), (&[1.0][..], cells.states()));
    let mut odometer = motion.odometer();
    assert_eq!(odometer.ahead(0), 0.0);
    let control = odometer.add(5.0, 0.0).unwrap();
    assert_eq!((control.travels().len(), control.change(0, 0)), (1, 1.0));
    assert!(dense(&by_definition(&motion, &control, None)).states() == 20);
}

#[test]
fn states_are_scales_at_cells() {
    let cells = road(50.0);
    let motion = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let motion = WheelTransition::new(motion, Wheels::default()).unwrap();
    let state = motion.index(3, 7).unwrap();
    assert_eq!(motion.cell_groups().group_of(state), Some(7));
    assert_eq!(motion.scale_groups().group_of(state), Some(3));
    assert_eq!((motion.index(9, 0), motion.index(0, 10)), (None, None));
    let belief = motion.spread(&Belief::certain(10, 7).unwrap()).unwrap();
    assert_eq!(belief.as_slice()[state], motion.shares()[3]);
    assert_eq!(motion.cell_groups().marginal(&belief).unwrap().as_slice()[7], 1.0);
}

#[test]
fn bad_numbers_are_errors() {
    let cells = road(100.0);
    let motion = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let says = |wheels: Wheels, expected: &str| {
        assert_eq!(text(WheelTransition::new(motion.clone(), wheels)), expected);
    };
    let usual = Wheels::default();
    says(
        Wheels { scale: f64::NAN, ..usual },
        "the deviation of the wheels' scale is NaN, expected a value from 0 to 0.2",
    );
    says(
        Wheels { lasts: 0.0, ..usual },
        "the distance over which the scale lasts is 0, expected metres above 0",
    );
    says(
        Wheels { slips: -1.0, ..usual },
        "the number of slips in a metre is -1, expected a value from 0 to 1000",
    );
    says(
        Wheels { slipped: 1e9, ..usual },
        "the metres lost in a slip is 1000000000, expected above 0, at most 1000 cells",
    );
    says(
        Wheels { slips: 2.0, slipped: 0.5, ..usual },
        "the part of the metres lost in slips is 1, expected at most a half",
    );
    let wheeled = WheelTransition::new(motion.clone(), usual).unwrap();
    let mut odometer = wheeled.odometer();
    odometer.add(2.0, 0.01).unwrap();
    let before = odometer.clone();
    assert_eq!(text(odometer.add(f64::NAN, 0.0)), "NaN metres driven, expected a finite value");
    // Too many cells for the smallest scale alone.
    assert!(odometer.add(4.9e7, 0.0).is_err());
    for scale in 0..9 {
        assert_eq!(odometer.ahead(scale), before.ahead(scale));
    }
    let one = WheelTransition::new(motion, Wheels { scale: 0.0, ..usual }).unwrap();
    let control = one.odometer().add(5.0, 0.0).unwrap();
    assert_eq!(text(wheeled.check_control(&control)), "distances at 1 scales, expected 9");
    odometer.reset();
    assert_eq!(odometer.ahead(4), wheeled.odometer().ahead(4));
    let short = Belief::uniform(3).unwrap();
    assert_eq!(
        text(wheeled.spread(&short)),
        "the belief has 3 states, expected 20 to match the inner operator"
    );
}
