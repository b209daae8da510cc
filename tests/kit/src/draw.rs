//! Random distributions, matrices and parameters of operators.

use proptest::collection::vec;
use proptest::prelude::*;

use super::{Matrix, matrix};

/// A distribution in proportion to weights; certain at `spare` if they are all tiny.
pub fn normalized(mut weights: Vec<f64>, spare: usize) -> Vec<f64> {
    if weights.iter().sum::<f64>() < 1e-6 {
        // Avoids a division by a tiny sum: tiny weights get a large one.
        weights[spare] = 1.0;
    }
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

/// Distributions of `count` probabilities, in proportion to weights drawn like this.
pub fn weighted(
    weight: impl Strategy<Value = f64>,
    count: usize,
) -> impl Strategy<Value = Vec<f64>> {
    (vec(weight, count), 0..count).prop_map(|(weights, spare)| normalized(weights, spare))
}

/// Distributions with zeros; `exact` ones are powers of two, whose logarithms are exact.
pub fn distribution(exact: bool, count: usize) -> BoxedStrategy<Vec<f64>> {
    if exact {
        // 1/2, 1/4, … for as many as are drawn, the rest 0, in any order.
        let halves = move |kept: usize| {
            let share = |k: usize| 0.5_f64.powi((k + 1).min(kept - 1).try_into().unwrap());
            (0..count).map(|k| if k < kept { share(k) } else { 0.0 }).collect::<Vec<f64>>()
        };
        return (1..=count).prop_map(halves).prop_shuffle().boxed();
    }
    weighted(prop_oneof![1 => Just(0.0), 3 => 0.01..1.0], count).boxed()
}

/// As [`distribution`], of 1 to `most` probabilities.
pub fn any_distribution(exact: bool, most: usize) -> impl Strategy<Value = Vec<f64>> {
    (1..=most).prop_flat_map(move |count| distribution(exact, count))
}

/// Transposes columns into rows.
pub fn transposed(columns: &Matrix) -> Matrix {
    matrix(columns.len(), |i, j| columns[j][i])
}

/// Matrices of n states whose columns are [`distribution`]s.
pub fn stochastic(exact: bool, n: usize) -> impl Strategy<Value = Matrix> {
    vec(distribution(exact, n), n).prop_map(|columns| transposed(&columns))
}

/// Stochastic matrices of 1 to `most` states.
pub fn any_stochastic(exact: bool, most: usize) -> impl Strategy<Value = Matrix> {
    (1..=most).prop_flat_map(move |n| stochastic(exact, n))
}

/// Probabilities, including 0 and 1; `exact` ones have exact logarithms.
pub fn rate(exact: bool) -> BoxedStrategy<f64> {
    if exact {
        return prop_oneof![Just(0.0), Just(0.5), Just(1.0)].boxed();
    }
    prop_oneof![1 => Just(0.0), 1 => Just(1.0), 1 => Just(0.25), 4 => 0.0..1.0].boxed()
}
