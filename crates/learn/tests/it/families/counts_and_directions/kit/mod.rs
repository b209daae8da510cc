//! One interface for all families, so that common properties are tested by one function.

mod families;
mod others;

use std::fmt::Debug;

use wayfix::ReorderStates;
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Belief, DenseTransition, Hmm, HmmError, Likelihood, Prior};

/// A family with one component (or vector), and parameters that are free numbers.
pub(super) trait Family:
    LearnLikelihood<Observation = [f64], Statistics: Clone>
    + SampleObservation<Sample = Vec<f64>>
    + ReorderStates
    + Clone
    + Debug
    + PartialEq
    + Sync
{
    /// Number of free parameters of a state.
    const FREE: usize;

    /// Number of M steps after which the parameters are at the maximum.
    const STEPS: usize = 1;

    /// Parameters from numbers between 0 and 1.
    fn parameters(unit: &[f64]) -> Vec<f64>;

    /// A family of states with these parameters.
    fn build(states: &[Vec<f64>]) -> Self;

    /// Parameters of the only state.
    fn read(&self) -> Vec<f64>;

    fn missing(self) -> Self;

    /// With a prior worth this many observations, if the family has one.
    fn and_prior(self, parameters: &[f64], count: f64) -> Self;
}

/// Rows of one parameter.
fn column(states: &[Vec<f64>], parameter: usize) -> Vec<[f64; 1]> {
    states.iter().map(|state| [state[parameter]]).collect()
}

macro_rules! with_prior {
    () => {
        fn missing(self) -> Self {
            self.with_missing()
        }

        fn and_prior(self, parameters: &[f64], count: f64) -> Self {
            self.with_prior(Self::build(&[parameters.to_vec()]), count).unwrap()
        }
    };
}
use with_prior;

/// Calls a generic test with each family.
macro_rules! for_all_families {
    ($($test:ident)*) => {$(
        mod $test {
            use wayfix_learn::*;

            macro_rules! of {
                ($name:ident, $family:ty) => {
                    #[test]
                    fn $name() {
                        super::$test::<$family>();
                    }
                };
            }
            of!(bernoulli, Independent<Bernoulli>);
            of!(multinomial, Multinomial);
            of!(poisson, Independent<Poisson>);
            of!(binomial, Independent<Binomial>);
            of!(negative_binomial, Independent<NegativeBinomial>);
            of!(zero_inflated, Independent<ZeroInflated<Poisson>>);
            of!(zeros_beside_gamma, Independent<ZeroInflated<Gamma>>);
            of!(hurdle, Independent<Hurdle<Binomial>>);
            of!(weibull, Independent<Weibull>);
            of!(beta, Independent<Beta>);
            of!(wrapped_cauchy, Independent<WrappedCauchy>);
            of!(exponential, Independent<Exponential>);
            of!(gamma, Independent<Gamma>);
            of!(log_normal, Independent<LogNormal>);
            of!(von_mises, Independent<VonMises>);
            of!(von_mises_fisher, VonMisesFisher);
        }
    )*};
}
pub(super) use for_all_families;

/// A model that never leaves its first state.
pub(super) fn staying<B: Likelihood>(family: B, state: usize) -> Hmm<DenseTransition, B> {
    let n = family.states();
    let row = |i: usize| (0..n).map(|j| f64::from(u8::from(i == j))).collect::<Vec<f64>>();
    let still = DenseTransition::from_rows(&(0..n).map(row).collect::<Vec<_>>()).unwrap();
    let prior = Prior::AtFirstObservation(Belief::certain(n, state).unwrap());
    Hmm::new(prior, still, family).unwrap()
}

/// Log density of an observation in a state, or its error.
pub(super) fn try_density<B: Likelihood<Observation = [f64]>>(
    family: &B,
    state: usize,
    y: &[f64],
) -> Result<f64, HmmError> {
    match staying(family, state).log_likelihood(&[y.to_vec()]) {
        Err(HmmError::Impossible { .. }) => Ok(f64::NEG_INFINITY),
        result => result,
    }
}

/// Log density of an observation in a state.
pub(super) fn density<B: Likelihood<Observation = [f64]>>(
    family: &B,
    state: usize,
    y: &[f64],
) -> f64 {
    try_density(family, state, y).unwrap()
}

/// Re-estimates a family of one state from weighted observations.
pub(super) fn fit<B: Family>(start: &B, seen: &[(Vec<f64>, f64)], pseudo_count: f64) -> B {
    let mut sums = start.statistics();
    let (first, second) = seen.split_at(seen.len() / 2);
    first.iter().for_each(|(y, weight)| start.add(&mut sums, y, &[*weight]));
    let mut others = start.statistics();
    second.iter().for_each(|(y, weight)| start.add(&mut others, y, &[*weight]));
    start.merge(&mut sums, &others);
    start.maximize(&sums, pseudo_count).unwrap()
}

/// Re-estimates a family of one state until its maximum, and checks that no step leads down.
pub(super) fn fit_to_maximum<B: Family>(
    start: &B,
    seen: &[(Vec<f64>, f64)],
    pseudo_count: f64,
) -> B {
    (0..B::STEPS).fold(start.clone(), |before, _| {
        let after = fit(&before, seen, pseudo_count);
        if B::STEPS > 1 {
            let [low, high] = [&before, &after].map(|at| objective(at, seen, pseudo_count));
            assert!(high >= low - 1e-11 * low.abs().max(1.0), "{low} {before:?} {high} {after:?}");
        }
        after
    })
}

/// Objective of learning, for a family of one state.
pub(super) fn objective<B: Family>(family: &B, seen: &[(Vec<f64>, f64)], pseudo_count: f64) -> f64 {
    let fits = seen.iter().map(|(y, weight)| weight * density(family, 0, y));
    fits.sum::<f64>() + family.log_prior(pseudo_count)
}

/// Newton's step to the maximum of the objective in one parameter.
pub(super) fn newton<B: Family>(
    around: &B,
    parameter: usize,
    objective: impl Fn(&B) -> f64,
) -> f64 {
    let theta = around.read();
    let step = 1e-3 * theta[parameter].abs();
    let at = |shift: f64| {
        let mut moved = theta.clone();
        moved[parameter] += shift;
        objective(&B::build(&[moved]))
    };
    let (below, here, above) = (at(-step), at(0.0), at(step));
    let curvature = (above - 2.0 * here + below) / (step * step);
    assert!(curvature < 0.0, "no maximum in parameter {parameter} of {around:?}");
    -(above - below) / (2.0 * step) / curvature
}

/// Standard errors of all parameters: roots of the diagonal of the inverse of the negative second
/// derivatives.
pub(super) fn standard_errors<B: Family>(around: &B, objective: impl Fn(&B) -> f64) -> Vec<f64> {
    let (theta, n) = (around.read(), B::FREE);
    let at = |moves: &[(usize, f64)]| {
        let mut moved = theta.clone();
        moves.iter().for_each(|&(k, by)| moved[k] += by * 1e-3 * theta[k].abs());
        objective(&B::build(&[moved]))
    };
    // In units of the steps, beside a unit matrix, by Gauss–Jordan elimination.
    let mut rows: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let second = |j: usize| {
                let sum = |a: f64, b: f64| at(&[(i, 0.5 * a), (j, 0.5 * b)]);
                sum(1.0, -1.0) + sum(-1.0, 1.0) - sum(1.0, 1.0) - sum(-1.0, -1.0)
            };
            (0..n).map(second).chain((0..n).map(|j| f64::from(u8::from(i == j)))).collect()
        })
        .collect();
    for i in 0..n {
        let pivot = rows[i][i];
        assert!(pivot > 0.0, "no maximum in parameter {i} of {around:?}");
        rows[i].iter_mut().for_each(|value| *value /= pivot);
        let row = rows[i].clone();
        for other in (0..n).filter(|other| *other != i) {
            let factor = rows[other][i];
            rows[other].iter_mut().zip(&row).for_each(|(value, own)| *value -= factor * own);
        }
    }
    (0..n).map(|k| rows[k][n + k].sqrt() * 1e-3 * theta[k].abs()).collect()
}
