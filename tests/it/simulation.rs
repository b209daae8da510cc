//! Drawn drives have the model's frequencies.

use wayfix::transition::SwitchedTransition;
use wayfix::{
    Belief, DenseTransition, FusedLikelihood, Hmm, OptionalLikelihood, Prior, SparseTransition,
    TableLikelihood,
};

use crate::kit::rng;

/// Pearson's statistic of counts against probabilities.
fn chi_square(counts: &[usize], probabilities: &[f64]) -> f64 {
    let total = counts.iter().sum::<usize>() as f64;
    counts.iter().zip(probabilities).fold(0.0, |sum, (&count, p)| {
        if *p == 0.0 {
            assert_eq!(count, 0, "something impossible was drawn");
            return sum;
        }
        sum + (count as f64 - total * p).powi(2) / (total * p)
    })
}

const COLUMNS: [[f64; 3]; 3] = [[0.5, 0.3, 0.2], [0.0, 0.9, 0.1], [0.25, 0.0, 0.75]];
const ROWS: [[f64; 4]; 3] = [[0.1, 0.2, 0.3, 0.4], [0.0, 0.5, 0.5, 0.0], [0.7, 0.1, 0.1, 0.1]];

fn transition() -> SparseTransition {
    let entries = (0..9).map(|at| (at / 3, at % 3, COLUMNS[at % 3][at / 3]));
    SparseTransition::from_triplets(3, entries).unwrap()
}

/// Moves out of each state, and symbols in it, by chi-square tests. The seed is fixed; with another
/// one, a correct program fails one of these seven tests with a probability below 7 in 10,000
/// (99.99% quantiles for 1, 2 and 3 degrees of freedom: 15.1, 18.4, 21.1).
#[test]
fn moves_and_symbols_have_their_frequencies() {
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::new(vec![0.2, 0.0, 0.8]).unwrap()),
        transition(),
        TableLikelihood::from_rows(&ROWS).unwrap(),
    )
    .unwrap();
    let mut rng = rng(3);
    let (mut first, mut moves, mut symbols) = ([0; 3], [[0; 3]; 3], [[0; 4]; 3]);
    for _ in 0..2000 {
        let drive = hmm.simulate(50, &mut rng);
        assert_eq!(drive.initial(), None);
        first[drive.states()[0]] += 1;
        for pair in drive.states().windows(2) {
            moves[pair[0]][pair[1]] += 1;
        }
        for (&state, &symbol) in drive.states().iter().zip(drive.observations()) {
            symbols[state][symbol] += 1;
        }
    }
    assert!(chi_square(&first, &[0.2, 0.0, 0.8]) < 15.1);
    for (counts, (column, quantile)) in moves.iter().zip(COLUMNS.iter().zip([18.4, 15.1, 15.1])) {
        assert!(chi_square(counts, column) < quantile);
    }
    for (counts, (row, quantile)) in symbols.iter().zip(ROWS.iter().zip([21.1, 15.1, 21.1])) {
        assert!(chi_square(counts, row) < quantile);
    }
}

#[test]
fn the_same_seed_gives_the_same_drive_and_the_prior_comes_before_the_first_move() {
    let prior = Prior::BeforeFirstTransition(Belief::certain(3, 1).unwrap());
    let table = TableLikelihood::from_rows(&ROWS).unwrap();
    let sensors = FusedLikelihood::new(OptionalLikelihood::new(table.clone()), table).unwrap();
    let hmm = Hmm::new(prior, transition(), sensors).unwrap();
    let drive = |seed| hmm.simulate(100, &mut rng(seed));
    assert_eq!(drive(1), drive(1));
    assert_ne!(drive(1), drive(2));
    assert_eq!(drive(1).initial(), Some(1));
    assert_ne!(drive(1).states()[0], 0, "no road leads from 1 to 0");
    assert!(drive(1).observations().iter().all(|(first, _)| first.is_some()));
    assert!(hmm.smooth(drive(1).observations()).is_ok());
    assert!(hmm.simulate(0, &mut rng(1)).states().is_empty());
}

#[test]
fn controls_drive_the_simulation_too() {
    let stay = DenseTransition::from_fn(3, |i, j| f64::from(i == j)).unwrap();
    let go = DenseTransition::from_fn(3, |i, j| f64::from(i == (j + 1) % 3)).unwrap();
    let gears = SwitchedTransition::new(vec![stay, go]).unwrap();
    let table = TableLikelihood::from_rows(&[[1.0]; 3]).unwrap();
    let prior = Prior::BeforeFirstTransition(Belief::certain(3, 0).unwrap());
    let hmm = Hmm::new(prior, gears, table).unwrap();
    let mut rng = rng(1);
    assert_eq!(hmm.simulate_with(&[0, 1, 1, 0], &mut rng).unwrap().states(), [0, 1, 2, 2]);
    let error = hmm.simulate_with(&[0, 2], &mut rng).unwrap_err();
    assert_eq!(
        error.to_string(),
        "step 2 has no valid control: operator 2, expected one of 2 (0 to 1)"
    );
}
