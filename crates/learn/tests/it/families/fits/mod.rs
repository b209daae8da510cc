//! Goodness of fit: tails of distributions, pseudo-residuals, forecasts of observations.

mod literal_tails;
mod predictive;
mod residuals;
mod tails;

use proptest::prelude::*;
use wayfix::{Belief, DenseTransition, Hmm, Prior};
use wayfix_learn::{Independent, Poisson};

/// Models of two regimes.
type Counts = Hmm<DenseTransition, Independent<Poisson>>;

/// A model of few counts and of many.
fn counts() -> Counts {
    let prior = Prior::AtFirstObservation(Belief::new(vec![0.6, 0.4]).unwrap());
    let moves = DenseTransition::from_rows(&[[0.9, 0.2], [0.1, 0.8]]).unwrap();
    Hmm::new(prior, moves, Poisson::family(&[[1.5], [6.0]]).unwrap()).unwrap()
}

/// Fails if uniform numbers are further from uniform than in one of 8,000 samples: the distance of
/// Kolmogorov and Smirnov times the root of their number is above 2.2 with probability
/// 2 exp(−2 · 2.2²) = 1.25e-4.
fn distance_from_uniform(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let count = values.len() as f64;
    let distance = |(at, u): (usize, &f64)| {
        let at = at as f64;
        f64::max(u - at / count, (at + 1.0) / count - u)
    };
    values.iter().enumerate().map(distance).fold(0.0, f64::max) * count.sqrt()
}

/// Largest [`distance_from_uniform`] that passes.
const FURTHEST: f64 = 2.2;

/// Numbers from 0 to 1.
fn units(count: usize) -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(0.0..1.0, count)
}
