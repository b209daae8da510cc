//! Free parameters of operators and of discrete sensors: as many as learning has, each has an
//! effect, and fixed or tied ones stay so.

use wayfix::inference::{Displacement, FreeParameters};
use wayfix::likelihood::{GroupedLikelihood, Groups, LearnLikelihood};
use wayfix::transition::{
    ConstrainedTransition, Durations, DwellTransition, EvidenceTransition, LearnTransition,
    RestartTransition, SwitchedTransition,
};
use wayfix::{
    Belief, DenseTransition, Fixed, FusedLikelihood, OptionalLikelihood, SparseLikelihood,
    SparseTransition, TableLikelihood,
};
use wayfix_learn::{GeneratorTransition, LogitTransition};

/// Entries out of all states, under this control.
fn entries<A: LearnTransition>(a: &A, control: &A::Control) -> Vec<f64> {
    let columns = (0..a.states()).flat_map(|from| a.outgoing(control, from));
    columns.map(|entry| entry.1).collect()
}

/// Checks an operator with entries above 0 and returns its number of free parameters.
fn check<A: LearnTransition + FreeParameters>(a: &A, controls: &[A::Control]) -> usize {
    let mut all = Displacement::new(&[]);
    let same = a.displaced(&mut all).unwrap();
    assert_eq!(all.count(), a.free_parameters());
    let read = |a: &A| controls.iter().flat_map(|u| entries(a, u)).collect::<Vec<f64>>();
    let before = read(a);
    let moved = |now: &[f64]| before.iter().zip(now).any(|(a, b)| (a - b).abs() > 1e-6 * a);
    assert!(!moved(&read(&same)));
    for at in 0..all.count() {
        for step in [-0.01, 0.01] {
            let mut by = vec![0.0; all.count()];
            by[at] = step;
            let now = a.displaced(&mut Displacement::new(&by)).unwrap();
            assert!(moved(&read(&now)), "{at}");
            assert_eq!(read(&now).len(), before.len());
        }
    }
    all.count()
}

fn sparse() -> SparseTransition {
    SparseTransition::from_rows(&[[0.5, 0.0, 0.3], [0.25, 1.0, 0.3], [0.25, 0.0, 0.4]]).unwrap()
}

#[test]
fn operators_have_as_many_as_learning() {
    assert_eq!(check(&sparse(), &[()]), 4);
    let dense = DenseTransition::from_rows(&[[0.7, 0.4], [0.3, 0.6]]).unwrap();
    assert_eq!(check(&dense, &[()]), 2);
    let switched = SwitchedTransition::new(vec![dense.clone(), dense.clone()]).unwrap();
    assert_eq!(check(&switched, &[0, 1]), 4);
    let anywhere = Belief::uniform(2).unwrap();
    assert_eq!(check(&RestartTransition::new(dense.clone(), 0.1, anywhere).unwrap(), &[()]), 2);
    let evidence = EvidenceTransition::new(dense.clone(), |_: &f64, _, _| 0.0).unwrap();
    assert_eq!(check(&evidence, &[0.0]), 2);
    assert_eq!(check(&Fixed(dense.clone()), &[()]), 0);
    let rates = [(1, 0, 2.0), (0, 1, 0.5), (2, 1, 0.0625), (1, 2, 0.01)];
    let generator = GeneratorTransition::from_triplets(3, rates).unwrap();
    assert_eq!(check(&generator, &[0.5, 3.0]), 4);

    let swap = DenseTransition::from_rows(&[[0.2, 1.0], [0.8, 0.0]]).unwrap();
    let ages = DwellTransition::new(swap.clone(), &[vec![0.2, 0.3, 0.5], vec![1.0]]).unwrap();
    assert_eq!(check(&ages, &[()]), 1 + 2);
    let kinds = [
        Durations::Geometric { mean: 3.0 },
        Durations::ShiftedPoisson { mean: 2.0 },
        Durations::NegativeBinomial { mean: 3.0, size: 2.0 },
        Durations::Gamma { shape: 2.0, scale: 1.5 },
    ];
    for (kind, parameters) in kinds.into_iter().zip([1, 1, 2, 2]) {
        let dwell = DwellTransition::from_durations(swap.clone(), &[kind, kind], 12).unwrap();
        assert_eq!(check(&dwell, &[()]), 1 + 2 * parameters, "{kind:?}");
    }
}

#[test]
fn logits_have_intercepts_and_slopes() {
    let controls = [vec![0.3, -1.0], vec![-0.7, 0.4], vec![1.1, 0.9]];
    let own = LogitTransition::new(&sparse(), 2).unwrap();
    assert_eq!(check(&own, &controls), 4 + 8);
    // Slopes of all moves to state 1, of state 0 to itself, and of no move.
    let label = |from: usize, to: usize| match (from, to) {
        (_, 1) => Some(0),
        (0, 0) => Some(1),
        _ => None,
    };
    assert_eq!(check(&own.with_shared_slopes(label), &controls), 4 + 4);
    // If all moves have slopes, one of two sets is the reference, unless a ridge decides.
    let two = SparseTransition::from_rows(&[[0.5, 0.5], [0.5, 0.5]]).unwrap();
    let all = LogitTransition::new(&two, 2).unwrap().with_shared_slopes(|_, to| Some(to));
    assert_eq!(check(&all, &controls), 2 + 2);
    let ridge = all.with_ridge(1.0).unwrap();
    let mut count = Displacement::new(&[]);
    ridge.displaced(&mut count).unwrap();
    assert_eq!(count.count(), 2 + 4);
}

#[test]
fn constraints_hold_for_displaced_operators() {
    let rows =
        [[0.6, 0.1, 0.0, 0.3], [0.4, 0.6, 0.1, 0.1], [0.0, 0.3, 0.6, 0.1], [0.0, 0.0, 0.3, 0.5]];
    let chain = SparseTransition::from_rows(&rows).unwrap();
    let plain = ConstrainedTransition::new(chain.clone());
    assert_eq!(check(&plain, &[()]), chain.free_parameters());

    let fixed = plain.clone().with_fixed(|from, to| from == 3 && to < 2);
    assert_eq!(check(&fixed, &[()]), 1 + 2 + 2 + 1);
    let moved = fixed.displaced(&mut Displacement::new(&[0.5; 6])).unwrap();
    assert_eq!((moved.inner().get(0, 3), moved.inner().get(1, 3)), (0.3, 0.1));
    assert!((moved.inner().get(2, 3) + moved.inner().get(3, 3) - 0.6).abs() < 1e-15);

    // Columns 1 and 2 share their probabilities; two ways out of state 3 are equally probable.
    let tied = plain.with_ties(|from, to| match (from, to) {
        (1 | 2, _) => 1 + to + 2 - from,
        (3, 1 | 2) => 8,
        _ => 10 + 4 * from + to,
    });
    assert_eq!(check(&tied, &[()]), 1 + 2 + 2);
    let moved = tied.displaced(&mut Displacement::new(&[0.5, -0.3, 0.2, 1.0, -1.0])).unwrap();
    let moved = moved.inner();
    for (to, other) in [(0, 1), (1, 2), (2, 3)] {
        assert!((moved.get(to, 1) - moved.get(other, 2)).abs() < 1e-15);
    }
    assert!((moved.get(1, 3) - moved.get(2, 3)).abs() < 1e-15);
    // An entry that underflows would vanish.
    assert!(tied.displaced(&mut Displacement::new(&[-2000.0])).is_err());
}

#[test]
fn compositions_of_sensors_have_those_of_their_parts() {
    let table = TableLikelihood::from_rows(&[[0.7, 0.3, 0.0], [0.2, 0.3, 0.5]]).unwrap();
    let count = |all: &Displacement<'_>| (all.count(), all.at_bound());
    let mut of_table = Displacement::new(&[]);
    table.displaced(&mut of_table).unwrap();
    assert_eq!(count(&of_table), (3, 1));
    assert_eq!(of_table.count(), table.free_parameters());

    let grouped =
        GroupedLikelihood::new(table.clone(), Groups::new(vec![0, 0, 1]).unwrap()).unwrap();
    let optional = OptionalLikelihood::new(grouped);
    let fused = FusedLikelihood::new(optional, SparseLikelihood::new(3)).unwrap();
    let mut of_all = Displacement::new(&[]);
    let same = fused.displaced(&mut of_all).unwrap();
    assert_eq!(count(&of_all), (3, 1));
    assert_eq!(same.free_parameters(), 3);
    // The odds of 0.3 to 0.7, doubled; the other row follows.
    let by = [2.0_f64.ln(), 0.0, 0.0];
    let moved = table.displaced(&mut Displacement::new(&by)).unwrap();
    assert!((moved.probability(0, 1).unwrap() - 0.6 / 1.3).abs() < 1e-15);
    assert_eq!(moved.to_rows()[1], table.to_rows()[1]);
}
