//! Formats of families of counts, durations and directions.

use super::gaussians::when;
use super::stored;
use crate::emission::{self, EmissionError, Independent};

/// Families under the names of their distributions, by which they are stored.
pub(crate) mod families {
    use crate::emission::{self, Independent};

    pub(crate) type Bernoulli = Independent<emission::Bernoulli>;
    pub(crate) type Binomial = Independent<emission::Binomial>;
    pub(crate) type Exponential = Independent<emission::Exponential>;
    pub(crate) type Poisson = Independent<emission::Poisson>;
    pub(crate) type Gamma = Independent<emission::Gamma>;
    pub(crate) type LogNormal = Independent<emission::LogNormal>;
    pub(crate) type NegativeBinomial = Independent<emission::NegativeBinomial>;
    pub(crate) type ZeroInflated<F> = Independent<emission::ZeroInflated<F>>;
    pub(crate) type Hurdle<F> = Independent<emission::Hurdle<F>>;
    pub(crate) type Weibull = Independent<emission::Weibull>;
    pub(crate) type Beta = Independent<emission::Beta>;
    pub(crate) type SkewedT = Independent<emission::SkewedT>;
    pub(crate) type WrappedCauchy = Independent<emission::WrappedCauchy>;
    pub(crate) type VonMises = Independent<emission::VonMises>;
}

stored! {
    [] Bernoulli in persistence::counts_and_directions::families: [], |family| {
        probabilities: Vec<Vec<f64>> = family.parameters(emission::Bernoulli::probability),
        missing: bool = family.takes_missing(),
        prior: Option<(families::Bernoulli, f64)> = family.prior(),
    } => emission::Bernoulli::family(&probabilities).and_then(|new| with(new, missing, prior));

    [] Binomial in persistence::counts_and_directions::families: [], |family| {
        trials: Vec<Vec<f64>> = family.parameters(|part| part.trials().into()),
        probabilities: Vec<Vec<f64>> = family.parameters(emission::Binomial::probability),
        missing: bool = family.takes_missing(),
        prior: Option<(families::Binomial, f64)> = family.prior(),
    } => emission::Binomial::from_rows(&trials, &probabilities).and_then(|new| with(new, missing, prior));

    [] Multinomial in emission: [], |family| {
        probabilities: Vec<Vec<f64>> = family.probabilities(),
        missing: bool = family.takes_missing(),
        trials: u32 = family.trials(),
    } => Self::new(&probabilities).map(|family| family.with_trials(trials))
        .map(|new| when(missing, new, Self::with_missing));

    [] Poisson in persistence::counts_and_directions::families: [], |family| {
        rates: Vec<Vec<f64>> = family.parameters(emission::Poisson::rate),
        missing: bool = family.takes_missing(),
        prior: Option<(families::Poisson, f64)> = family.prior(),
    } => emission::Poisson::family(&rates).and_then(|new| with(new, missing, prior));

    [] Exponential in persistence::counts_and_directions::families: [], |family| {
        rates: Vec<Vec<f64>> = family.parameters(emission::Exponential::rate),
        missing: bool = family.takes_missing(),
        prior: Option<(families::Exponential, f64)> = family.prior(),
    } => emission::Exponential::family(&rates).and_then(|new| with(new, missing, prior));

    [] Gamma in persistence::counts_and_directions::families: [], |family| {
        shapes: Vec<Vec<f64>> = family.parameters(emission::Gamma::shape),
        scales: Vec<Vec<f64>> = family.parameters(emission::Gamma::scale),
        missing: bool = family.takes_missing(),
        prior: Option<(families::Gamma, f64)> = family.prior(),
    } => emission::Gamma::family(&shapes, &scales).and_then(|new| with(new, missing, prior));

    [] LogNormal in persistence::counts_and_directions::families: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(emission::LogNormal::mean),
        deviations: Vec<Vec<f64>> = family.parameters(emission::LogNormal::deviation),
        missing: bool = family.takes_missing(),
        prior: Option<(families::LogNormal, f64)> = family.prior(),
    } => emission::LogNormal::family(&means, &deviations).and_then(|new| with(new, missing, prior));

    [] NegativeBinomial in persistence::counts_and_directions::families: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(emission::NegativeBinomial::mean),
        dispersions: Vec<Vec<f64>> = family.parameters(emission::NegativeBinomial::dispersion),
        missing: bool = family.takes_missing(),
        prior: Option<(families::NegativeBinomial, f64)> = family.prior(),
    } => emission::NegativeBinomial::family(&means, &dispersions)
        .and_then(|new| with(new, missing, prior));

    [] Weibull in persistence::counts_and_directions::families: [], |family| {
        shapes: Vec<Vec<f64>> = family.parameters(emission::Weibull::shape),
        scales: Vec<Vec<f64>> = family.parameters(emission::Weibull::scale),
        missing: bool = family.takes_missing(),
        prior: Option<(families::Weibull, f64)> = family.prior(),
    } => emission::Weibull::family(&shapes, &scales).and_then(|new| with(new, missing, prior));

    [] Beta in persistence::counts_and_directions::families: [], |family| {
        alphas: Vec<Vec<f64>> = family.parameters(emission::Beta::alpha),
        betas: Vec<Vec<f64>> = family.parameters(emission::Beta::beta),
        missing: bool = family.takes_missing(),
        prior: Option<(families::Beta, f64)> = family.prior(),
    } => emission::Beta::family(&alphas, &betas).and_then(|new| with(new, missing, prior));

    [] SkewedT in persistence::counts_and_directions::families: [], |family| {
        locations: Vec<Vec<f64>> = family.parameters(emission::SkewedT::location),
        scales: Vec<Vec<f64>> = family.parameters(emission::SkewedT::scale),
        skewnesses: Vec<Vec<f64>> = family.parameters(emission::SkewedT::skewness),
        degrees: Vec<Vec<f64>> = family.parameters(emission::SkewedT::degrees),
        missing: bool = family.takes_missing(),
        prior: Option<(families::SkewedT, f64)> = family.prior(),
    } => emission::SkewedT::family(&locations, &scales, &skewnesses, &degrees)
        .and_then(|new| with(new, missing, prior));

    [] WrappedCauchy in persistence::counts_and_directions::families: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(emission::WrappedCauchy::mean),
        concentrations: Vec<Vec<f64>> = family.parameters(emission::WrappedCauchy::concentration),
        missing: bool = family.takes_missing(),
        prior: Option<(families::WrappedCauchy, f64)> = family.prior(),
    } => emission::WrappedCauchy::family(&means, &concentrations)
        .and_then(|new| with(new, missing, prior));

    [] VonMises in persistence::counts_and_directions::families: [], |family| {
        means: Vec<Vec<f64>> = family.parameters(emission::VonMises::mean),
        concentrations: Vec<Vec<f64>> = family.parameters(emission::VonMises::concentration),
        missing: bool = family.takes_missing(),
        prior: Option<(families::VonMises, f64)> = family.prior(),
    } => emission::VonMises::family(&means, &concentrations).and_then(|new| with(new, missing, prior));

    [] VonMisesFisher in emission: [], |family| {
        means: Vec<Vec<f64>> = family.means(),
        concentrations: Vec<f64> = family.concentrations(),
        missing: bool = family.takes_missing(),
        prior: Option<(emission::VonMisesFisher, f64)> = family.prior(),
    } => Self::new(&means, &concentrations)
        .map(|new| when(missing, new, Self::with_missing))
        .and_then(|new| prior.into_iter().try_fold(new, |new, (prior, count)| new.with_prior(prior, count)));
}

/// Returns a family with its settings.
pub(super) fn with<F: Clone>(
    family: Independent<F>,
    missing: bool,
    prior: Option<(Independent<F>, f64)>,
) -> Result<Independent<F>, EmissionError> {
    let family = when(missing, family, Independent::with_missing);
    prior.into_iter().try_fold(family, |family, (prior, count)| family.with_prior(prior, count))
}
