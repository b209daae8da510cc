//! Distributions with additional zeros, and families of vectors.

use wayfix_learn::{Hurdle, Independent, Multinomial, Univariate, VonMisesFisher, ZeroInflated};

use super::{Family, column, with_prior};

/// Parameters of a distribution with additional zeros: with small ones, zeros would be informative.
fn beside<F: Univariate>(unit: &[f64]) -> Vec<f64>
where
    Independent<F>: Family,
{
    let unit: Vec<f64> = unit[1..].iter().map(|unit| 0.3 + 0.7 * unit).collect();
    let probability = 0.15 + 0.7 * (unit[0] - 0.3);
    [vec![probability], <Independent<F> as Family>::parameters(&unit)].concat()
}

fn inner<F: Univariate>(state: &[f64]) -> [F; 1]
where
    Independent<F>: Family,
{
    let family = Independent::<F>::build(&[state[1..].to_vec()]);
    [family.component(0, 0).unwrap().clone()]
}

/// The total probability of 0, and the parameters of the distribution beside the zeros.
impl<F: Univariate + PartialEq + Sync> Family for Independent<ZeroInflated<F>>
where
    Independent<F>: Family,
{
    const FREE: usize = 1 + Independent::<F>::FREE;
    const STEPS: usize = Independent::<F>::STEPS;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        beside::<F>(unit)
    }

    fn build(states: &[Vec<f64>]) -> Self {
        let all: Vec<[F; 1]> = states.iter().map(|state| inner::<F>(state)).collect();
        let rows = states.iter().zip(&all).map(|(state, [inner])| {
            let zero = if F::HAS_ZERO { F::point(0.0) } else { None };
            let own = zero.map_or(0.0, |zero| inner.log_density(&zero).exp());
            [(state[0] - own) / (1.0 - own)]
        });
        ZeroInflated::family(&rows.collect::<Vec<_>>(), &all).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let part = self.component(0, 0).unwrap();
        let inner = Independent::from_rows(&[[part.inner().clone()]]).unwrap();
        [vec![part.log_density(&None).exp()], inner.read()].concat()
    }

    with_prior!();
}

/// The probability of 0, and the parameters of the distribution above it.
impl<F: Univariate + PartialEq + Sync> Family for Independent<Hurdle<F>>
where
    Independent<F>: Family,
{
    const FREE: usize = 1 + Independent::<F>::FREE;
    const STEPS: usize = Independent::<F>::STEPS;

    fn parameters(unit: &[f64]) -> Vec<f64> {
        beside::<F>(unit)
    }

    fn build(states: &[Vec<f64>]) -> Self {
        let all: Vec<[F; 1]> = states.iter().map(|state| inner::<F>(state)).collect();
        Hurdle::family(&column(states, 0), &all).unwrap()
    }

    fn read(&self) -> Vec<f64> {
        let part = self.component(0, 0).unwrap();
        let inner = Independent::from_rows(&[[part.inner().clone()]]).unwrap();
        [vec![part.probability()], inner.read()].concat()
    }

    with_prior!();
}

/// Two of three shares, each as a part of the rest, in rows of five trials.
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
