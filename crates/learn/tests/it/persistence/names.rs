//! Names that structs are stored under; some formats write them, and messages show them.

use serde::de::DeserializeOwned;
use wayfix_learn::{GeneratorTransition, LogitTransition};

fn name<T: DeserializeOwned>() -> String {
    let error = serde_json::from_str::<T>("1").map(drop).unwrap_err().to_string();
    let name = error.strip_prefix("invalid type: integer `1`, expected struct ");
    name.unwrap_or(&error).strip_suffix(" at line 1 column 1").unwrap_or(&error).to_owned()
}

#[test]
fn names_of_families_stay() {
    use wayfix_learn::{
        Bernoulli, Beta, Binomial, Exponential, Gamma, Gaussian, GaussianMixture, GaussianPrior,
        Hurdle, Independent, LinearRegression, LogNormal, Multinomial, NegativeBinomial, Poisson,
        Product, StudentT, VonMises, VonMisesFisher, Weibull, WrappedCauchy, ZeroInflated,
    };
    let names = [
        (name::<Gaussian>(), "Gaussian"),
        (name::<GaussianPrior>(), "GaussianPrior"),
        (name::<GaussianMixture>(), "GaussianMixture"),
        (name::<StudentT>(), "StudentT"),
        (name::<LinearRegression>(), "LinearRegression"),
        (name::<Independent<Bernoulli>>(), "Bernoulli"),
        (name::<Independent<Binomial>>(), "Binomial"),
        (name::<Independent<Exponential>>(), "Exponential"),
        (name::<Independent<NegativeBinomial>>(), "NegativeBinomial"),
        (name::<Independent<ZeroInflated<Gamma>>>(), "ZeroInflated"),
        (name::<Independent<Hurdle<Poisson>>>(), "Hurdle"),
        (name::<Independent<Poisson>>(), "Poisson"),
        (name::<Independent<Weibull>>(), "Weibull"),
        (name::<Independent<Beta>>(), "Beta"),
        (name::<Independent<WrappedCauchy>>(), "WrappedCauchy"),
        (name::<Independent<Gamma>>(), "Gamma"),
        (name::<Independent<LogNormal>>(), "LogNormal"),
        (name::<Independent<VonMises>>(), "VonMises"),
        (name::<Multinomial>(), "Multinomial"),
        (name::<VonMisesFisher>(), "VonMisesFisher"),
        (name::<Product<Gaussian, Multinomial>>(), "Product"),
    ];
    for (found, expected) in names {
        assert_eq!(found, expected);
    }
}

#[test]
fn names_of_operators_stay() {
    assert_eq!(name::<LogitTransition>(), "LogitTransition");
    assert_eq!(name::<GeneratorTransition>(), "GeneratorTransition");
}
