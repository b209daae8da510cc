//! Free parameters of the distributions of one number, for standard errors (section 9 of the
//! formulas): each on the scale of its constraint, logarithms for positive parameters and log-odds
//! for probabilities.

use std::error::Error;

use super::family::Independent;
use super::univariate::Univariate;
use super::{
    Bernoulli, Beta, Binomial, Exponential, Gamma, Hurdle, LogNormal, NegativeBinomial, Poisson,
    SkewedT, VonMises, Weibull, WrappedCauchy, ZeroInflated,
};
use wayfix::inference::{Displacement, FreeParameters};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Parameters of each component in turn, and within it of each state.
impl<F: Univariate + FreeParameters> FreeParameters for Independent<F> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        let parts = self.parts.iter().map(|part| part.displaced(by)).collect::<Result<_, _>>()?;
        Ok(Self { parts, prior: self.prior.clone(), ..*self })
    }
}

/// Implements the trait by calling a distribution's constructor with displaced parameters.
macro_rules! displaced {
    ($($type:ident, $part:ident, $by:ident => [$($parameter:expr),+];)+) => {$(
        impl FreeParameters for $type {
            fn displaced(&self, $by: &mut Displacement<'_>) -> Outcome<Self> {
                let $part = self;
                Ok(Self::new($($parameter),+)?)
            }
        }
    )+};
}

displaced! {
    Bernoulli, d, by => [by.probability(d.probability())];
    Binomial, d, by => [d.trials(), by.probability(d.probability())];
    Poisson, d, by => [by.positive(d.rate())];
    Exponential, d, by => [by.positive(d.rate())];
    NegativeBinomial, d, by => [by.positive(d.mean()), by.positive(d.dispersion())];
    Gamma, d, by => [by.positive(d.shape()), by.positive(d.scale())];
    LogNormal, d, by => [by.real(d.mean()), by.positive(d.deviation())];
    Weibull, d, by => [by.positive(d.shape()), by.positive(d.scale())];
    Beta, d, by => [by.positive(d.alpha()), by.positive(d.beta())];
    VonMises, d, by => [by.real(d.mean()), by.positive(d.concentration())];
    WrappedCauchy, d, by => [by.real(d.mean()), by.probability(d.concentration())];
    SkewedT, d, by => [
        by.real(d.location()),
        by.positive(d.scale()),
        by.positive(d.skewness()),
        by.positive(d.degrees())
    ];
}

/// The log-odds of a zero, then the parameters of the distribution.
impl<F: Univariate + FreeParameters> FreeParameters for ZeroInflated<F> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        Ok(Self::new(by.probability(self.probability()), self.inner().displaced(by)?)?)
    }
}

/// The log-odds of a zero, then the parameters of the distribution.
impl<F: Univariate + FreeParameters> FreeParameters for Hurdle<F> {
    fn displaced(&self, by: &mut Displacement<'_>) -> Outcome<Self> {
        Ok(Self::new(by.probability(self.probability()), self.inner().displaced(by)?)?)
    }
}
