//! Against second derivatives by hyper-dual numbers (Fike and Alonso 2011), exact but for rounding.

use std::ops::{Add, Div, Mul};
use wayfix_learn::StandardErrors;

use proptest::prelude::*;
use rand::RngExt;
use wayfix::inference::{LearnError, LearningOptions};
use wayfix::{Belief, DenseTransition, Hmm, Prior, TableLikelihood};

use super::Discrete;
use crate::kit::{cases_of, rng};

/// A value, its derivatives in two directions, and the mixed one.
#[derive(Debug, Clone, Copy)]
struct HyperDual([f64; 4]);

impl HyperDual {
    /// A function of it, from its value and two derivatives.
    fn map(self, [f, d, dd]: [f64; 3]) -> Self {
        let [_, a, b, ab] = self.0;
        Self([f, d * a, d * b, d * ab + dd * a * b])
    }

    fn ln(self) -> Self {
        let x = self.0[0];
        self.map([x.ln(), x.recip(), -x.recip().powi(2)])
    }

    fn exp(self) -> Self {
        self.map([self.0[0].exp(); 3])
    }
}

impl Add for HyperDual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

impl Mul for HyperDual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let ([x, a, b, ab], [y, c, d, cd]) = (self.0, other.0);
        Self([x * y, a * y + x * c, b * y + x * d, ab * y + a * d + b * c + x * cd])
    }
}

impl Div for HyperDual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let x = other.0[0];
        self * other.map([x.recip(), -x.powi(-2), 2.0 * x.powi(-3)])
    }
}

const ZERO: HyperDual = HyperDual([0.0; 4]);

/// The distributions of a model: prior, columns, rows.
fn distributions(hmm: &Discrete) -> Vec<Vec<f64>> {
    let n = hmm.states();
    let a = hmm.transition();
    let mut all = vec![hmm.prior().belief().as_slice().to_vec()];
    all.extend((0..n).map(|from| (0..n).map(|to| a.get(to, from)).collect()));
    all.extend(hmm.likelihood().to_rows());
    all
}

/// Log-odds of all probabilities relative to the last of their distribution, which is seldom the
/// library's reference.
fn log_odds(hmm: &Discrete) -> Vec<f64> {
    let odds = |of: &Vec<f64>| {
        let last = of[of.len() - 1];
        of[..of.len() - 1].iter().map(|p| (p / last).ln()).collect::<Vec<f64>>()
    };
    distributions(hmm).iter().flat_map(odds).collect()
}

/// Second derivatives of the objective in these log-odds.
fn hessian(hmm: &Discrete, sequences: &[Vec<usize>], pseudo_count: f64) -> Vec<Vec<f64>> {
    let (n, at) = (hmm.states(), log_odds(hmm));
    let shapes: Vec<usize> = distributions(hmm).iter().map(Vec::len).collect();
    let value = |i: usize, j: usize| {
        let direction = |k: usize, to: usize| f64::from(u8::from(k == to));
        let mut odds =
            (0..at.len()).map(|k| HyperDual([at[k], direction(k, i), direction(k, j), 0.0]).exp());
        let mut all = Vec::new();
        for shape in &shapes {
            let mut own: Vec<HyperDual> = odds.by_ref().take(shape - 1).collect();
            own.push(HyperDual([1.0, 0.0, 0.0, 0.0]));
            let sum = own.iter().fold(ZERO, |sum, p| sum + *p);
            all.push(own.iter().map(|p| *p / sum).collect::<Vec<HyperDual>>());
        }
        let (prior, a, b) = (&all[0], &all[1..=n], &all[n + 1..]);
        let weight = HyperDual([pseudo_count, 0.0, 0.0, 0.0]);
        let mut objective = all.iter().flatten().fold(ZERO, |sum, p| sum + weight * p.ln());
        for sequence in sequences {
            let mut alpha: Vec<HyperDual> = (0..n).map(|i| prior[i] * b[i][sequence[0]]).collect();
            for y in &sequence[1..] {
                let step =
                    |to: usize| (0..n).fold(ZERO, |sum, j| sum + a[j][to] * alpha[j]) * b[to][*y];
                alpha = (0..n).map(step).collect();
            }
            objective = objective + alpha.iter().fold(ZERO, |sum, p| sum + *p).ln();
        }
        objective.0[3]
    };
    (0..at.len()).map(|i| (0..at.len()).map(|j| value(i, j)).collect()).collect()
}

/// Inverse of a symmetric matrix with its least pivot, relative to the diagonal, by Gauss and Jordan.
fn inverse(matrix: &[Vec<f64>]) -> (Vec<Vec<f64>>, f64) {
    let p = matrix.len();
    let unit = |i: usize| (0..p).map(move |j| f64::from(u8::from(i == j)));
    let mut rows: Vec<Vec<f64>> = matrix
        .iter()
        .enumerate()
        .map(|(i, row)| row.iter().copied().chain(unit(i)).collect())
        .collect();
    let mut least = f64::INFINITY;
    for i in 0..p {
        let pivot = rows[i][i];
        least = least.min(pivot / matrix[i][i].abs());
        rows[i].iter_mut().for_each(|value| *value /= pivot);
        let own = rows[i].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(other, _)| *other != i) {
            let factor = row[i];
            row.iter_mut().zip(&own).for_each(|(value, own)| *value -= factor * own);
        }
    }
    (rows.into_iter().map(|row| row[p..].to_vec()).collect(), least)
}

fn random(states: usize, symbols: usize, seed: u64) -> Discrete {
    let mut rng = rng(seed);
    let mut draw = |count: usize| {
        let weights: Vec<f64> = (0..count).map(|_| rng.random::<f64>() + 0.05).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|w| w / sum).collect::<Vec<f64>>()
    };
    let prior = Prior::AtFirstObservation(Belief::new(draw(states)).unwrap());
    let columns: Vec<Vec<f64>> = (0..states).map(|_| draw(states)).collect();
    let rows: Vec<Vec<f64>> = (0..states).map(|_| draw(symbols)).collect();
    let a = DenseTransition::from_fn(states, |to, from| columns[from][to]).unwrap();
    Hmm::new(prior, a, TableLikelihood::from_rows(&rows).unwrap()).unwrap()
}

fn options(count: f64) -> LearningOptions {
    LearningOptions::default()
        .with_iterations(400)
        .with_tolerance(1e-9)
        .with_prior_pseudo_count(count)
        .with_transition_pseudo_count(count)
        .with_likelihood_pseudo_count(count)
}

proptest! {
    #![proptest_config(cases_of(200))]

    /// Standard errors of log-odds, whose covariance is the inverse information itself, at any
    /// point that learning reached.
    #[test]
    fn the_information_is_that_of_hyper_dual_numbers(
        (states, symbols, seed) in (2..=3_usize, 2..=3_usize, any::<u64>()),
        count in prop_oneof![Just(0.0), 0.3..2.0],
    ) {
        let mut draws = rng(seed ^ 1);
        let truth = random(states, symbols, seed);
        let sequences: Vec<Vec<usize>> =
            (0..4).map(|_| truth.simulate(12, &mut draws).observations().to_vec()).collect();
        let options = options(count);
        let learned = random(states, symbols, seed ^ 2).learn(&sequences, &options).unwrap();
        let ended = learned.iterations() < options.iterations;
        let learned = learned.into_model();
        let found = StandardErrors::from_likelihood(&learned, &sequences, &options, log_odds);
        if let Ok(found) = &found {
            prop_assert!(found.errors().iter().all(|error| error.is_finite()));
            if found.at_bound() > 0 {
                return Ok(()); // others have a closed form
            }
        } else if count == 0.0 {
            return Ok(()); // usually one is on its way to 0, and rules out others
        }
        let minus: Vec<Vec<f64>> = hessian(&learned, &sequences, count)
            .iter()
            .map(|row| row.iter().map(|value| -value).collect())
            .collect();
        let (covariance, least) = inverse(&minus);
        match found {
            // Errors of the information, some 1e-7 of it, are as many times larger in its inverse as
            // a pivot is small.
            Ok(found) => {
                for (i, row) in covariance.iter().enumerate() {
                    for (j, expected) in row.iter().enumerate() {
                        let size = (covariance[i][i] * covariance[j][j]).sqrt();
                        let own = found.covariance(i, j).unwrap();
                        let limit = 1e-5 * size * least.recip().max(1.0);
                        prop_assert!((own - expected).abs() < limit, "{} {} {}", own, expected, least);
                    }
                }
            }
            // Learning has hardly begun to tell states apart.
            Err(LearnError::NotAtMaximum { .. }) => prop_assert!(!ended || least < 1e-4, "{}", least),
            // Equal states.
            Err(LearnError::NotDetermined { .. }) => prop_assert!(least < 1e-4, "{}", least),
            Err(error) => return Err(TestCaseError::fail(error.to_string())),
        }
    }

    /// Standard errors do not depend on the order of the states.
    #[test]
    fn the_order_of_states_does_not_matter(seed in any::<u64>(), order in Just([0, 1, 2]).prop_shuffle()) {
        let mut draws = rng(seed ^ 1);
        let truth = random(3, 3, seed);
        let sequences: Vec<Vec<usize>> =
            (0..4).map(|_| truth.simulate(12, &mut draws).observations().to_vec()).collect();
        let options = options(1.0);
        let learned = truth.learn(&sequences, &options).unwrap().into_model();
        let other = learned.reordered(&order).unwrap();
        let read = |hmm: &Discrete| distributions(hmm).concat();
        let [found, other] = [&learned, &other].map(|hmm| StandardErrors::from_likelihood(hmm, &sequences, &options, read));
        let (found, other) = match (found, other) {
            (Ok(found), Ok(other)) => (found, other),
            // Learning ended at a saddle with equal states.
            (Err(LearnError::NotDetermined { .. }), Err(LearnError::NotDetermined { .. })) => {
                return Ok(());
            }
            others => return Err(TestCaseError::fail(format!("{others:?}"))),
        };
        // Position of each number of the model among those of the other.
        let at = |i: usize, j: usize| 3 + 3 * i + j;
        for i in 0..3 {
            for j in 0..3 {
                let pairs = [
                    (order[i], i),
                    (at(order[i], order[j]), at(i, j)),
                    (at(3 + order[i], j), at(3 + i, j)),
                ];
                for (own, others) in pairs {
                    prop_assert_eq!(found.values()[own], other.values()[others]);
                    let (a, b) = (found.errors()[own], other.errors()[others]);
                    prop_assert!((a - b).abs() < 1e-2 * a, "{} {}", a, b);
                }
            }
        }
    }
}
