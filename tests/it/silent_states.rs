//! Silent states that are composed into the moves (guide, silent states), against the enumeration
//! of all ways with their silent states, and against the formula.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};

use crate::kit::{Matrix, all_close, cases, close_logs, distribution, transposed};

/// Removes the silent states, which are last in the matrix, until `left` states remain.
fn without_silent(a: &mut Matrix, left: usize) {
    for s in (left..a.len()).rev() {
        let leaving: f64 = (0..s).map(|to| a[to][s]).sum();
        for from in 0..s {
            let share = a[s][from] / leaving;
            a[..s].iter_mut().for_each(|row| row[from] += row[s] * share);
        }
    }
}

/// Sum over all ways from a state through these symbols, of `emitting` states and silent ones
/// after them.
fn ways(a: &Matrix, table: &Matrix, emitting: usize, from: usize, ys: &[usize]) -> f64 {
    let Some((y, rest)) = ys.split_first() else {
        return 1.0;
    };
    let step = |to: usize| match a[to][from] {
        0.0 => 0.0,
        p if to < emitting => p * table[to][*y] * ways(a, table, emitting, to, rest),
        p => p * ways(a, table, emitting, to, ys),
    };
    (0..a.len()).map(step).sum()
}

/// Emitting states, then the begin state, then silent ones, each leading only to later silent ones
/// (or to any, with `loops`) and to some emitting state; no state leads to begin.
fn models(loops: bool) -> impl Strategy<Value = (usize, Matrix)> {
    (1..=3_usize, 1..=3_usize).prop_flat_map(move |(emitting, silent)| {
        let n = emitting + 1 + silent;
        let columns = vec((distribution(false, n), distribution(false, emitting)), n);
        columns.prop_map(move |columns| {
            let column = |from: usize, (all, out): &(Vec<f64>, Vec<f64>)| {
                let legal = |to: usize| {
                    to < emitting || (to > emitting && (loops || from < emitting || to > from))
                };
                let kept: Vec<f64> =
                    (0..n).map(|to| if legal(to) { all[to] } else { 0.0 }).collect();
                let rest = 1.0 - 0.8 * kept.iter().sum::<f64>();
                let out = |to: usize| if to < emitting { rest * out[to] } else { 0.0 };
                (0..n).map(|to| 0.8 * kept[to] + out(to)).collect()
            };
            let columns = columns.iter().enumerate().map(|(from, draws)| column(from, draws));
            (emitting, transposed(&columns.collect()))
        })
    })
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn likelihoods_are_sums_over_all_ways(
        (emitting, a) in models(false),
        rows in vec(distribution(false, 3), 3),
        ys in vec(0..3_usize, 1..4),
    ) {
        let table: Matrix = rows[..emitting].to_vec();
        let expected = ways(&a, &table, emitting, emitting, &ys);
        let mut composed = a;
        without_silent(&mut composed, emitting + 1);
        let prior = (0..emitting).map(|to| composed[to][emitting]).collect();
        let hmm = Hmm::new(
            Prior::AtFirstObservation(Belief::new(prior).unwrap()),
            DenseTransition::from_fn(emitting, |to, from| composed[to][from]).unwrap(),
            TableLikelihood::from_rows(&table).unwrap(),
        ).unwrap();
        if let Ok(found) = hmm.log_likelihood(&ys) {
            close_logs(found, expected.ln(), 1e-12)?;
        } else {
            prop_assert_eq!(expected, 0.0);
        }
    }

    #[test]
    fn composed_moves_are_those_of_the_formula((emitting, a) in models(true)) {
        let mut composed = a.clone();
        without_silent(&mut composed, emitting + 1);
        for from in 0..=emitting {
            // Mass in silent states after 0, 1, 2 … silent steps, and the mass that leaves them.
            let mut silent: Vec<f64> = (0..a.len()).map(|to| a[to][from]).collect();
            let mut expected = vec![0.0; emitting];
            for _ in 0..200 {
                for (to, sum) in expected.iter_mut().enumerate() {
                    *sum += silent[to];
                }
                silent = (0..a.len())
                    .map(|to| (emitting + 1..a.len()).map(|s| a[to][s] * silent[s]).sum())
                    .collect();
            }
            let found: Vec<f64> = (0..emitting).map(|to| composed[to][from]).collect();
            all_close(&found, &expected, 1e-12, 1e-300)?;
        }
    }
}
