//! Names under which structs are stored; some formats write them, and messages show them.

use serde::de::DeserializeOwned;
use wayfix::inference::{
    FilterSnapshot, FixedLagSnapshot, OnlineViterbiSnapshot, PrunedFilterSnapshot,
};
use wayfix::likelihood::{GroupedLikelihood, PooledLikelihood, SparseTableLikelihood};
use wayfix::motion::{
    DistanceTransition, OdometryModel, OffMap, OffMapTransition, RouteControl, RouteTransition,
    Speeds, ViewChangeRates,
};
use wayfix::observation::{Confusion, MatchOdds, Standardizer};
use wayfix::recognition::{Options, Parameters, TrackSnapshot};
use wayfix::transition::{
    ConstrainedTransition, DwellTransition, GeneratorTransition, KroneckerTransition,
    LogitTransition, PowerTransition, RestartTransition, SwitchedTransition, WindowTransition,
};
use wayfix::{
    DenseTransition, FusedLikelihood, Hmm, LikelihoodVector, OptionalLikelihood, SparseLikelihood,
    SparseTransition, TableLikelihood,
};

fn name<T: DeserializeOwned>() -> String {
    let error = serde_json::from_str::<T>("1").map(drop).unwrap_err().to_string();
    let name = error.strip_prefix("invalid type: integer `1`, expected struct ");
    name.unwrap_or(&error).strip_suffix(" at line 1 column 1").unwrap_or(&error).to_owned()
}

#[test]
fn names_of_structs_stay() {
    type A = SparseTransition;
    type B = TableLikelihood;
    let names = [
        (name::<Hmm<A, B>>(), "Hmm"),
        (name::<DenseTransition>(), "DenseTransition"),
        (name::<A>(), "SparseTransition"),
        (name::<ConstrainedTransition>(), "ConstrainedTransition"),
        (name::<LogitTransition>(), "LogitTransition"),
        (name::<SwitchedTransition<A>>(), "SwitchedTransition"),
        (name::<WindowTransition>(), "WindowTransition"),
        (name::<RestartTransition<A>>(), "RestartTransition"),
        (name::<KroneckerTransition<A, A>>(), "KroneckerTransition"),
        (name::<PowerTransition<A>>(), "PowerTransition"),
        (name::<DwellTransition<A>>(), "DwellTransition"),
        (name::<GeneratorTransition>(), "GeneratorTransition"),
        (name::<B>(), "TableLikelihood"),
        (name::<LikelihoodVector>(), "LikelihoodVector"),
        (name::<SparseLikelihood>(), "SparseLikelihood"),
        (name::<SparseTableLikelihood>(), "SparseTableLikelihood"),
        (name::<OptionalLikelihood<B>>(), "OptionalLikelihood"),
        (name::<FusedLikelihood<B, B>>(), "FusedLikelihood"),
        (name::<GroupedLikelihood<B>>(), "GroupedLikelihood"),
        (name::<PooledLikelihood<B>>(), "PooledLikelihood"),
        (name::<FilterSnapshot>(), "FilterSnapshot"),
        (name::<FixedLagSnapshot<()>>(), "FixedLagSnapshot"),
        (name::<PrunedFilterSnapshot>(), "PrunedFilterSnapshot"),
        (name::<OnlineViterbiSnapshot>(), "OnlineViterbiSnapshot"),
        (name::<Speeds>(), "Speeds"),
        (name::<RouteTransition>(), "RouteTransition"),
        (name::<RouteControl>(), "RouteControl"),
        (name::<OdometryModel>(), "OdometryModel"),
        (name::<ViewChangeRates>(), "ViewChangeRates"),
        (name::<OffMap>(), "OffMap"),
        (name::<OffMapTransition<A>>(), "OffMapTransition"),
        (name::<DistanceTransition>(), "DistanceTransition"),
        (name::<Confusion>(), "Confusion"),
        (name::<MatchOdds>(), "MatchOdds"),
        (name::<Standardizer>(), "Standardizer"),
        (name::<Options>(), "Options"),
        (name::<Parameters>(), "Fit"),
        (name::<TrackSnapshot>(), "TrackSnapshot"),
    ];
    for (found, expected) in names {
        assert_eq!(found, expected);
    }
}

#[cfg(feature = "emission")]
#[test]
fn names_of_families_stay() {
    use wayfix::emission::{
        Bernoulli, Beta, Binomial, Exponential, Gamma, Gaussian, GaussianMixture, GaussianPrior,
        Hurdle, Independent, LinearRegression, LogNormal, Multinomial, NegativeBinomial, Poisson,
        Product, SkewedT, StudentT, VonMises, VonMisesFisher, Weibull, WrappedCauchy, ZeroInflated,
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
        (name::<Independent<SkewedT>>(), "SkewedT"),
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
