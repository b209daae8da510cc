//! Continuous time: exponentials of rates, and learning them.

mod errors;
mod exponential;
mod learning;
mod statistics;

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix_learn::GeneratorTransition;

use crate::kit::{Matrix, matrix};

/// Rates of up to `most` states, `rates[to][from]`, some of them 0, over several orders of
/// magnitude.
fn rates(most: usize, orders: f64) -> impl Strategy<Value = Matrix> {
    let rate =
        move || prop_oneof![2 => Just(0.0), 3 => (-orders..orders).prop_map(|x| 10_f64.powf(x))];
    (1..=most).prop_flat_map(move |n| {
        vec(rate(), n * n)
            .prop_map(move |rates| matrix(n, |i, j| if i == j { 0.0 } else { rates[i * n + j] }))
    })
}

fn generator(rates: &Matrix) -> GeneratorTransition {
    let n = rates.len();
    let entries = (0..n).flat_map(|i| (0..n).map(move |j| (i, j, rates[i][j])));
    GeneratorTransition::from_triplets(n, entries).unwrap()
}
