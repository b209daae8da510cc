//! One face for all families, so that what holds for each is written once.

use std::fmt::Debug;

use wayfix::ReorderStates;
use wayfix::emission::{
    Bernoulli, Gamma, Independent, LogNormal, Multinomial, Poisson, VonMises, VonMisesFisher,
};
use wayfix::likelihood::{LearnLikelihood, SampleObservation};
use wayfix::{Belief, DenseTransition, Hmm, InferenceError, Likelihood, Prior};

/// A family with one component (or vector), and parameters that are free numbers, such that the
/// information on one does not depend on the others.
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

    /// Parameters from numbers between 0 and 1.
    fn parameters(unit: &[f64]) -> Vec<f64>;

    /// A family of states with these parameters.
    fn build(states: &[Vec<f64>]) -> Self;

    /// Parameters of the only state.
    fn read(&self) -> Vec<f64>;

    fn missing(self) -> Self;

    /// With a prior of so many observations, where there is one.
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

impl Family for Independent<Bernoulli> {
    const FREE: usize = 1;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![0.05 + 0.9 * unit[0]]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        Bernoulli::family(&column(states, 0)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        vec![self.component(0, 0).unwrap().probability()]
    }

    with_prior!();
}

impl Family for Independent<Poisson> {
    const FREE: usize = 1;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![(6.0 * unit[0]).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        Poisson::family(&column(states, 0)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        vec![self.component(0, 0).unwrap().rate()]
    }

    with_prior!();
}

/// By shape and mean.
impl Family for Independent<Gamma> {
    const FREE: usize = 2;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![(6.0 * unit[0] - 1.0).exp(), (10.0 * unit[1] - 5.0).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        let scales: Vec<[f64; 1]> = states.iter().map(|state| [state[1] / state[0]]).collect();
        Gamma::family(&column(states, 0), &scales).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let gamma = self.component(0, 0).unwrap();
        vec![gamma.shape(), gamma.shape() * gamma.scale()]
    }

    with_prior!();
}

impl Family for Independent<LogNormal> {
    const FREE: usize = 2;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![1.0 + 10.0 * unit[0], (3.0 * unit[1] - 2.0).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        LogNormal::family(&column(states, 0), &column(states, 1)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let log_normal = self.component(0, 0).unwrap();
        vec![log_normal.mean(), log_normal.deviation()]
    }

    with_prior!();
}

impl Family for Independent<VonMises> {
    const FREE: usize = 2;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![1.0 + 2.0 * unit[0], (6.0 * unit[1]).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        VonMises::family(&column(states, 0), &column(states, 1)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let angles = self.component(0, 0).unwrap();
        vec![angles.mean(), angles.concentration()]
    }

    with_prior!();
}

/// Two of three shares, each in parts of what is left, in rows of five trials.
impl Family for Multinomial {
    const FREE: usize = 2;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![0.1 + 0.8 * unit[0], 0.1 + 0.8 * unit[1]]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        let row = |s: &Vec<f64>| [s[0], s[1] * (1.0 - s[0]), (1.0 - s[1]) * (1.0 - s[0])];
        Self::new(&states.iter().map(row).collect::<Vec<_>>()).unwrap().with_trials(5)
    }

    fn read(&self) -> Vec<f64> {
        let rows = self.probabilities();
        let rest = rows[0][1] + rows[0][2];
        vec![rows[0][0], if rest == 0.0 { 0.0 } else { rows[0][1] / rest }]
    }

    fn missing(self) -> Self {
        self.with_missing()
    }

    fn and_prior(self, _: &[f64], _: f64) -> Self {
        self
    }
}

/// In three dimensions: polar angle, azimuth and concentration.
impl Family for VonMisesFisher {
    const FREE: usize = 3;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![0.7 + 1.5 * unit[0], 1.0 + unit[1], (6.0 * unit[2]).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        let mean = |s: &Vec<f64>| {
            let ((sin, cos), (sin2, cos2)) = (s[0].sin_cos(), s[1].sin_cos());
            [sin * cos2, sin * sin2, cos]
        };
        let concentrations: Vec<f64> = states.iter().map(|state| state[2]).collect();
        Self::new(&states.iter().map(mean).collect::<Vec<_>>(), &concentrations).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let mean = &self.means()[0];
        let polar = mean[0].hypot(mean[1]).atan2(mean[2]);
        vec![polar, mean[1].atan2(mean[0]), self.concentrations()[0]]
    }

    with_prior!();
}

/// Calls a generic test with each family.
macro_rules! for_all_families {
    ($($test:ident)*) => {$(
        mod $test {
            use wayfix::emission::*;

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
            of!(gamma, Independent<Gamma>);
            of!(log_normal, Independent<LogNormal>);
            of!(von_mises, Independent<VonMises>);
            of!(von_mises_fisher, VonMisesFisher);
        }
    )*};
}
pub(super) use for_all_families;

/// A model that stays in the state in which it starts.
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
) -> Result<f64, InferenceError> {
    match staying(family, state).log_likelihood(&[y.to_vec()]) {
        Err(InferenceError::Impossible { .. }) => Ok(f64::NEG_INFINITY),
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

/// Logarithm of what learning maximises, for a family of one state.
pub(super) fn objective<B: Family>(family: &B, seen: &[(Vec<f64>, f64)], pseudo_count: f64) -> f64 {
    let fits = seen.iter().map(|(y, weight)| weight * density(family, 0, y));
    fits.sum::<f64>() + family.log_prior(pseudo_count)
}

/// Newton's step to the maximum of the objective in one parameter, and the standard error of that
/// parameter.
pub(super) fn newton<B: Family>(
    around: &B,
    parameter: usize,
    objective: impl Fn(&B) -> f64,
) -> (f64, f64) {
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
    (-(above - below) / (2.0 * step) / curvature, (-curvature).sqrt().recip())
}
