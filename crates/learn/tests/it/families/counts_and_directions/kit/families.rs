//! Distributions of one number.

use wayfix_learn::{
    Bernoulli, Beta, Binomial, Exponential, Gamma, Independent, LogNormal, NegativeBinomial,
    Poisson, VonMises, Weibull, WrappedCauchy,
};

use super::{Family, column, with_prior};

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

/// By mean and dispersion.
impl Family for Independent<NegativeBinomial> {
    const FREE: usize = 2;
    const STEPS: usize = 12;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![(1.0 + 5.0 * unit[0]).exp(), (3.0 * unit[1] - 1.5).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        NegativeBinomial::family(&column(states, 0), &column(states, 1)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let counts = self.component(0, 0).unwrap();
        vec![counts.mean(), counts.dispersion()]
    }

    with_prior!();
}

/// By shape and scale.
impl Family for Independent<Weibull> {
    const FREE: usize = 2;
    const STEPS: usize = 25;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![(4.0 * unit[0] - 1.0).exp(), (10.0 * unit[1] - 5.0).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        Weibull::family(&column(states, 0), &column(states, 1)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let part = self.component(0, 0).unwrap();
        vec![part.shape(), part.scale()]
    }

    with_prior!();
}

/// By mean and the sum of both shapes.
impl Family for Independent<Beta> {
    const FREE: usize = 2;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![0.1 + 0.8 * unit[0], (8.0 * unit[1] - 1.0).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        let first: Vec<[f64; 1]> = states.iter().map(|state| [state[0] * state[1]]).collect();
        let second: Vec<[f64; 1]> =
            states.iter().map(|state| [(1.0 - state[0]) * state[1]]).collect();
        Beta::family(&first, &second).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let part = self.component(0, 0).unwrap();
        let sum = part.alpha() + part.beta();
        vec![part.alpha() / sum, sum]
    }

    with_prior!();
}

impl Family for Independent<WrappedCauchy> {
    const FREE: usize = 2;
    const STEPS: usize = 150;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![1.0 + unit[0], 0.05 + 0.9 * unit[1]]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        WrappedCauchy::family(&column(states, 0), &column(states, 1)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let part = self.component(0, 0).unwrap();
        vec![part.mean(), part.concentration()]
    }

    with_prior!();
}

/// In twelve trials.
impl Family for Independent<Binomial> {
    const FREE: usize = 1;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![0.05 + 0.9 * unit[0]]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        Binomial::family(&[12], &column(states, 0)).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        vec![self.component(0, 0).unwrap().probability()]
    }

    with_prior!();
}

impl Family for Independent<Exponential> {
    const FREE: usize = 1;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        vec![(10.0 * unit[0] - 5.0).exp()]
    }

    fn build(states: &[Vec<f64>]) -> Self {
        Exponential::family(&column(states, 0)).unwrap()
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
