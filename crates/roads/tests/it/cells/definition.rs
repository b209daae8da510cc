//! The operator against its definition, a polynomial in the move by one cell.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::map::{PlanePosition, RoadClass};
use wayfix::transition::RestartTransition;
use wayfix::{Belief, Transition, TransitionEntries};
use wayfix_roads::cells::RoadCells;
use wayfix_roads::cells::{CellTransition, Travel, TurnWeights};

use super::{aisles, networks, road, weights};
use crate::kit::{
    Expected, Matrix, all_close, any_distribution, assert_operator, cases_of, matrix, power,
    restart, text,
};

/// Probability of the turn from an edge to another.
fn turn(cells: &RoadCells<PlanePosition>, weights: &TurnWeights, edge: usize, next: usize) -> f64 {
    let network = cells.network();
    let weight = |next: usize| {
        let [class, next_class] = [edge, next].map(|edge| network.edges()[edge].class);
        let main = class == RoadClass::Main && next_class == RoadClass::Main;
        let u_turn = network.reverse(edge) == Some(next);
        weights.weight.of(next_class)
            * if main { weights.straight_on } else { 1.0 }
            * if u_turn { weights.u_turn } else { 1.0 }
    };
    let all: Vec<usize> = network.next(edge).collect();
    let sum: f64 = all.iter().map(|&next| weight(next)).sum();
    match (all.contains(&next), sum > 0.0) {
        (false, _) => 0.0,
        (true, true) => weight(next) / sum,
        (true, false) => 1.0 / all.len() as f64,
    }
}

/// The move by one cell.
fn one(cells: &RoadCells<PlanePosition>, weights: &TurnWeights, stay: bool) -> Matrix {
    matrix(cells.states(), |to, from| {
        let [there, edge] = [to, from].map(|cell| cells.edge(cell));
        if from + 1 < cells.cells(edge).end {
            return f64::from(to == from + 1);
        }
        if cells.network().next(edge).next().is_none() {
            return f64::from(stay && to == from);
        }
        if to == cells.cells(there).start { turn(cells, weights, edge, there) } else { 0.0 }
    })
}

fn by(one: &Matrix, travel: &Travel) -> Matrix {
    let mut sum = matrix(one.len(), |_, _| 0.0);
    for (cells, w) in (travel.first()..).zip(travel.weights()) {
        let power = power(one, cells as u32);
        sum = matrix(one.len(), |i, j| sum[i][j] + w * power[i][j]);
    }
    sum
}

fn travels() -> impl Strategy<Value = Travel> {
    prop_oneof![
        (0..4_usize, any_distribution(false, 4))
            .prop_map(|(first, weights)| Travel::of_cells(first, &weights).unwrap()),
        (0.0..6.0_f64, prop_oneof![Just(0.0), 0.0..0.5])
            .prop_map(|(metres, variance)| measured(metres, variance)),
        Just(Travel::still()),
    ]
}

/// A travel in units of cells, which are 5 m long here, with a variance in their squares.
fn measured(cells: f64, variance: f64) -> Travel {
    let motion = CellTransition::new(&road(100.0), &TurnWeights::default()).unwrap();
    motion.travel(5.0 * cells, 25.0 * variance).unwrap()
}

proptest! {
    #![proptest_config(cases_of(400))]

    #[test]
    fn it_is_a_polynomial_in_the_move_by_one_cell(
        cells in networks(4, 5),
        weights in weights(),
        travels in vec(travels(), 3),
    ) {
        let one = one(&cells, &weights, true);
        let expected: Vec<Matrix> = travels.iter().map(|travel| by(&one, travel)).collect();
        let a = CellTransition::new(&cells, &weights).unwrap();
        assert_operator(a, Expected::each(&travels, &expected))?;
    }

    #[test]
    fn what_would_drive_on_from_an_end_is_impossible(
        cells in networks(4, 4),
        weights in weights(),
        travels in vec(travels(), 3),
    ) {
        let one = one(&cells, &weights, false);
        let expected: Vec<Matrix> = travels.iter().map(|travel| by(&one, travel)).collect();
        let a = CellTransition::new(&cells, &weights).unwrap().with_evidence_at_ends();
        let has_ends = a.ends().len() > 0;
        let ends: Vec<usize> = a.ends().collect();
        let edges = 0..cells.network().edges().len();
        let none = |&edge: &usize| cells.network().next(edge).next().is_none();
        prop_assert_eq!(ends, edges.filter(none).collect::<Vec<_>>());
        let factor = |travel: &Travel| (has_ends && travel.last() > 0).then_some(0.0);
        let factors: Vec<_> = travels.iter().map(factor).collect();
        if factors.iter().any(Option::is_some) {
            assert_operator(a, Expected::each(&travels, &expected).with_evidence(&factors))?;
        }
    }

    #[test]
    fn kidnapping_composes(
        cells in networks(3, 3),
        weights in weights(),
        travels in vec(travels(), 3),
    ) {
        let n = cells.states();
        let one = one(&cells, &weights, true);
        let r = vec![1.0 / n as f64; n];
        let expected = travels.iter().map(|travel| restart(&by(&one, travel), 0.01, &r));
        let expected: Vec<Matrix> = expected.collect();
        let a = CellTransition::new(&cells, &weights).unwrap();
        let a = RestartTransition::new(a, 0.01, Belief::uniform(n).unwrap()).unwrap();
        assert_operator(a, Expected::each(&travels, &expected))?;
    }

    /// Consecutive steps equal one step by their sum, across junctions.
    #[test]
    fn steps_add_up(cells in networks(4, 6), weights in weights(), start in any::<prop::sample::Index>()) {
        let a = CellTransition::new(&cells, &weights).unwrap();
        let n = cells.states();
        let mut x = vec![0.0; n];
        x[start.index(n)] = 1.0;
        let (part, whole) = (measured(30.0, 0.4), measured(300.0, 4.0));
        let mut once = vec![0.0; n];
        a.apply(&whole, &x, &mut once);
        let mut out = vec![0.0; n];
        for _ in 0..10 {
            a.apply(&part, &x, &mut out);
            std::mem::swap(&mut x, &mut out);
        }
        all_close(&x, &once, 1e-12, 1.0)?;
    }
}

/// Over a hundred junctions, walks merge: entries are those of products.
#[test]
fn entries_of_a_long_jump_are_those_of_products() {
    let cells = RoadCells::new(aisles(6, 5, 3.0), 1.0).unwrap();
    let a = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let travel = a.travel(200.0, 4.0).unwrap();
    let n = cells.states();
    for from in [0, n / 2] {
        let (mut x, mut out) = (vec![0.0; n], vec![0.0; n]);
        x[from] = 1.0;
        a.apply(&travel, &x, &mut out);
        let mut listed = vec![0.0; n];
        a.outgoing(&travel, from).for_each(|(to, p)| listed[to] = p);
        let difference = |(a, b): (&f64, &f64)| (a - b).abs();
        assert!(out.iter().zip(&listed).map(difference).fold(0.0, f64::max) < 1e-14);
        let to = (0..n).max_by(|&a, &b| out[a].total_cmp(&out[b])).unwrap();
        let (_, p) = a.incoming(&travel, to).find(|entry| entry.0 == from).unwrap();
        assert!((p - out[to]).abs() < 1e-11 * p);
    }
}

#[test]
fn bad_numbers_are_errors() {
    let cells = road(100.0);
    let a = CellTransition::new(&cells, &TurnWeights::default()).unwrap();
    let says = |found: Result<Travel, _>, expected: &str| assert_eq!(text(found), expected);
    says(a.travel(-1.0, 0.0), "-1 metres driven, expected 0 or more");
    says(a.travel(f64::NAN, 0.0), "NaN metres driven, expected a finite value");
    says(a.travel(1.0, -2.0), "a variance of -2 of the metres driven, expected 0 or more");
    says(
        a.travel(1e9, 0.0),
        "the number of cells of a step is 200000000, expected at most 10,000,000",
    );
    says(
        a.travel(1.0, 1e14),
        "the deviation of a step in cells is 2000000, expected at most 100,000",
    );
    says(
        Travel::of_cells(3, &[0.5, 0.25]),
        "the sum of the probabilities of distances is 0.75, expected 1",
    );
    says(
        Travel::of_cells(3, &[1.5, -0.5]),
        "the probability of 4 cells is -0.5, expected a finite value of at least 0",
    );
    let weights = TurnWeights { u_turn: -1.0, ..TurnWeights::default() };
    let expected = "the U-turn factor is -1, expected a finite value of at least 0";
    assert_eq!(text(CellTransition::new(&cells, &weights)), expected);
    let weights = TurnWeights { straight_on: 0.0, ..TurnWeights::default() };
    let expected = "the straight-on factor is 0, expected a finite value above 0";
    assert_eq!(text(CellTransition::new(&cells, &weights)), expected);
}
