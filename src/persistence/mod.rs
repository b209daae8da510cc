//! Models and states of filters in files and messages (feature `serde`).
//!
//! With [serde](https://serde.rs) these are `Serialize` and `Deserialize`:
//! [`Hmm`](crate::Hmm), [`Prior`], [`Belief`], [`Groups`],
//! [`Fixed`](crate::Fixed); all transition operators but those with a closure
//! ([`EvidenceTransition`](crate::transition::EvidenceTransition)), which can't be stored; all
//! sensors but [`LogLikelihoodFn`](crate::likelihood::LogLikelihoodFn), for the same reason; the
//! snapshots [`FilterSnapshot`](crate::inference::FilterSnapshot),
//! [`FixedLagSnapshot`](crate::inference::FixedLagSnapshot),
//! [`PrunedFilterSnapshot`](crate::inference::PrunedFilterSnapshot) and
//! [`OnlineViterbiSnapshot`](crate::inference::OnlineViterbiSnapshot), which also have a smaller
//! form without this feature ([`to_bytes`](crate::inference::FilterSnapshot::to_bytes)); and a
//! recogniser's [`Parameters`](crate::recognition::Parameters) and
//! [`TrackSnapshot`](crate::recognition::TrackSnapshot).
//!
//! ```
//! use wayfix::inference::FilterSnapshot;
//! use wayfix::{Belief, Hmm, Prior, SparseTransition, TableLikelihood};
//!
//! let hmm = Hmm::new(
//!     Prior::BeforeFirstTransition(Belief::uniform(2)?),
//!     SparseTransition::from_rows(&[[0.7, 0.3], [0.3, 0.7]])?,
//!     TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?,
//! )?;
//! let mut filter = hmm.filter();
//! filter.step(&0)?;
//! let model = serde_json::to_string(&hmm)?; // before the engine is switched off
//! let state = serde_json::to_string(&filter.snapshot())?;
//!
//! // The next morning.
//! let restored: Hmm<SparseTransition, TableLikelihood> = serde_json::from_str(&model)?;
//! let mut next = restored.filter();
//! next.restore(&serde_json::from_str::<FilterSnapshot>(&state)?)?;
//! filter.step(&1)?;
//! next.step(&1)?;
//! assert_eq!(next.snapshot(), filter.snapshot()); // as if it had never stopped
//!
//! let wrong = r#"{"version":1,"states":2,"to":[0,1],"from":[0,1],"probability":[1,0.9]}"#;
//! assert_eq!(
//!     serde_json::from_str::<SparseTransition>(wrong).unwrap_err().to_string(),
//!     "column 1 (the transitions out of state 1) sums to 0.9, expected 1",
//! );
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Exact
//!
//! Values that are read give the same results to the bit, if the format keeps
//! doubles. **serde_json needs its feature `float_roundtrip`** for that; without
//! it, it may read the last bit of a number wrongly. Later results on another platform may differ
//! in the last bit of a logarithm or an exponential, which come from the platform's mathematical
//! library.
//!
//! # Checked
//!
//! Values are read through the constructors, with their errors; a snapshot is checked for
//! consistency here, and against the model when it is restored. A small file can describe a
//! costly model: a few bytes make a window of 2^32 places, or the 2^32-th power of an operator.
//! So read models only from sources that you trust to run one.
//!
//! # The format
//!
//! A struct has exactly the fields below and a `version`, which is 1; any other version is an
//! error. Parts have the same formats. States and symbols are counted from 0; probabilities are
//! numbers.
//!
//! | type | fields |
//! |---|---|
//! | `Hmm` | `prior`, `transition`, `likelihood`; `rounds_tails`, true if tails are rounded |
//! | `DenseTransition` | `states`; `columns`, column after column |
//! | `SparseTransition` | `states`; `to`, `from` and `probability` of each entry, in any order |
//! | `ConstrainedTransition` | `transition`, sparse; for each entry, column by column, `parameters`, the number of its own (null if it is fixed), and `pseudo_counts`, a list that may be empty |
//! | `SwitchedTransition` | `operators` |
//! | `LogitTransition` | `states`, `inputs`; `to`, `from` and `intercept` of each move, column by column; `group`, the number of its slopes, or null; `slopes`, a row for each number; `ridge` |
//! | `WindowTransition` | `states`, `first`, `weights`, `closed` |
//! | `Speeds` | `values`, ascending; `shares`; `nearby` and `anywhere`, the probabilities of a change; `slack` |
//! | `RouteTransition` | `places`, `closed`, `speeds`; `odometry`: `scale`, `bias` and `deviation`; `views`: null or the rates `standing` and `moved`; `off_map`: null or `leave`, `back`, `near` and `within` |
//! | `RestartTransition` | `inner`; `keep`, 1 − ε; `restart`, ε r; `evidence`, a log-likelihood, or null |
//! | `DistanceTransition` | `base`; `lengths` of its entries, column by column |
//! | `OffMapTransition` | `inner`; `leave`, λ; `stay`, 1 − ρ; `back`, ρ r; `evidence`, a log-likelihood, or null |
//! | `KroneckerTransition` | `first`, `second` |
//! | `PowerTransition` | `inner`, `exponent` |
//! | `GeneratorTransition` | `rates`: for each state a list of pairs, the state that it leads to and the rate |
//! | `DwellTransition` | `moves`; `ages`: for each place a list of pairs, the probabilities of leaving and staying; `durations`: a list, empty or with one for each place |
//! | `TableLikelihood` | `rows`, one for each state |
//! | `LikelihoodVector` | `states`; `log`, true for logarithms |
//! | `Confusion` | `places`; `place`, `seen_as` and `probability` of each entry, in any order |
//! | `SparseLikelihood` | `states` |
//! | `SparseTableLikelihood` | `states`; `symbols`, for each a pair: the states that it lists, as pairs of a state and its likelihood, and the likelihood of the others |
//! | `OptionalLikelihood` | `sensor` |
//! | `FusedLikelihood` | `first`, `second` |
//! | `GroupedLikelihood` | `sensor`, `groups` |
//! | `PooledLikelihood` | `sensor`, `groups` |
//! | `emission::Gaussian` | `covariance_type` (`spherical`, `diagonal`, `full` or `tied`), `means`, `covariances`; `missing`, true if components may be; `prior`, or null |
//! | `emission::GaussianPrior` | `mean_weight`, `mean`, `covariance_weight`, `scale`, row after row |
//! | `emission::GaussianMixture` | `covariance_type`, as above; `weights`, `means` and `covariances`, by state and part (one of a state if they are tied); `missing`, `prior` |
//! | `emission::StudentT` | `scale_type`, `degrees`, `means`, `scales`; `fixed_degrees`, true if they are not learned; `missing`, `prior` |
//! | `emission::LinearRegression` | `full`, true for covariances and false for variances; `coefficients` (d × p, row after row), `intercepts`, `covariances`; `missing`, `ridge`; `noise_prior`, or null |
//! | `emission::Bernoulli` | `probabilities`, `missing`, `prior` |
//! | `emission::Multinomial` | `probabilities`, `missing`; `trials` of rows that are drawn |
//! | `emission::Binomial` | `trials`, `probabilities`, `missing`, `prior` |
//! | `emission::Poisson`, `emission::Exponential` | `rates`, `missing`, `prior` |
//! | `emission::NegativeBinomial` | `means`, `dispersions`, `missing`, `prior` |
//! | `emission::ZeroInflated`, `emission::Hurdle` | `probabilities` of 0; `inner`, a family of the other distribution; `missing`, `prior` |
//! | `emission::Beta` | `alphas`, `betas`, `missing`, `prior` |
//! | `emission::SkewedT` | `locations`, `scales`, `skewnesses`, `degrees`, `missing`, `prior` |
//! | `emission::Gamma`, `emission::Weibull` | `shapes`, `scales`, `missing`, `prior` |
//! | `emission::LogNormal` | `means`, `deviations`, `missing`, `prior` |
//! | `emission::VonMises`, `emission::WrappedCauchy`, `emission::VonMisesFisher` | `means`, `concentrations`, `missing`, `prior` |
//! | `emission::Product` | `first`, `second` |
//! | `FilterSnapshot` | `steps`, `steps_in_logs`, `belief`; `logs`, its logarithms (null for −∞), or null; `log_likelihood`, as sum and remainder |
//! | `FixedLagSnapshot` | `lag`; `present`, a filter state; `past`: pairs of a filter state and the control after it |
//! | `PrunedFilterSnapshot` | `states` of the model, `steps`; `tolerance`, or null for ∞; `most_active`, or null for any number; the states that are `active`, and for each its `estimate`, `lower` bound and the `excess` above that (null for ∞); `others`, the bounds on another state and on all of these; `bound`; `log_likelihood` and `log_excess`, as sum and remainder; `log_lost`, whether nothing is known of it; `share`, the part of the tolerance that a step may drop |
//! | `OnlineViterbiSnapshot` | `steps`; `scores` (null for −∞); what was `taken_out` of them, a whole number, a sum and its remainder; `undecided`, for each such step pairs of a state and the one before |
//! | `MatchOdds` | `slope`, `even`, `nothing`, `temperature` |
//! | `Standardizer` | `count` of queries; for each reference, `sums` of scores and of their `squares`, and of squared `steps` to the next |
//! | `Parameters`, by the name of `Fit` | `options`; `standardizer`; `best_scores`, their mean and deviation; each of these null if it is not known |
//! | `TrackSnapshot` | `filter`; `standardizer`; `last_view`, scores (null for ∞), or null; `run`: null or a pair, `changed`, `unchanged` or null and its length; `still`, the largest change of an unchanged view; `lingering`, a share of views; `driven`: null or `standing`, a probability, and `odometry`, null or a mean reading and the number of readings |
//!
//! A family of observations has one row of parameters for each state; `missing`, true if NaN is a
//! missing component; and `prior`: null, or a family with the same states and its number of
//! observations.
//!
//! Without a version: `Belief` is a list of probabilities, `Prior` an object with one field,
//! `before_first_transition`, `at_first_observation` or `stationary`, `Groups` the list of each state's group,
//! `Fixed` its content, `OdometryReading` an object with `distance` and `variance`, and
//! `RouteControl` one with `odometry`, null or a number of places, with `view`, null or `view`
//! (`changed` or `unchanged`) and `weight`, and, if it is known, with `before`, as `driven` above.
//! The `Options` of a recogniser are an object with a field for each; they are checked when a
//! recogniser is made.

#[cfg(feature = "emission")]
mod counts_and_directions;
#[cfg(feature = "emission")]
mod distributions_with_zeros;
#[cfg(feature = "emission")]
mod gaussians;
mod likelihood;
#[cfg(feature = "places")]
mod motion;
#[cfg(feature = "emission")]
mod products;
#[cfg(feature = "places")]
mod recognition;
mod state;
mod transition;

use std::error::Error;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::belief::Belief;
use crate::groups::Groups;
use crate::hmm::Prior;
use crate::likelihood::Likelihood;
use crate::transition::Transition;

/// Version of the format, the only one that is read.
pub const VERSION: u32 = 1;

/// Field `version` of a stored struct.
struct Version;

impl Serialize for Version {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u32(VERSION)
    }
}

impl<'de> Deserialize<'de> for Version {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match u32::deserialize(deserializer)? {
            VERSION => Ok(Self),
            other => Err(D::Error::custom(format!("version {other}, expected {VERSION}"))),
        }
    }
}

/// Converts an error with all its sources to one of serde.
fn refused<E: serde::de::Error>(error: impl Into<Box<dyn Error>>) -> E {
    let error = error.into();
    let (mut text, mut source) = (error.to_string(), error.source());
    while let Some(cause) = source {
        text += &format!(": {cause}");
        source = cause.source();
    }
    E::custom(text)
}

/// Implements `Serialize` and `Deserialize` for structs:
///
/// ```text
/// [generics of the impl] Type<…>: [generics that fields depend on], |value| {
///     field: its type = expression of the value,
/// } => result of building the value from the fields;
/// ```
macro_rules! stored {
    ($(
        [$($generics:tt)*] $name:ident$(<$($argument:ident),*>)? $(in $($module:ident)::+)?: [$($part:ident),*], |$value:ident| {
            $($field:ident: $type:ty = $stored:expr,)*
        } => $built:expr;
    )*) => {$(
        const _: () = {
            // Has the name of the type, since formats and messages show it.
            #[derive(serde::Deserialize)]
            #[serde(deny_unknown_fields)]
            struct $name<$($part),*> {
                version: $crate::persistence::Version,
                $($field: $type,)*
            }

            impl<$($generics)*> serde::Serialize for $crate::$($($module::)+)?$name$(<$($argument),*>)?
            where
                $($part: serde::Serialize,)*
            {
                fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                    use serde::ser::SerializeStruct;
                    let $value = self;
                    let fields = 1 + [$(stringify!($field)),*].len();
                    let mut out = serializer.serialize_struct(stringify!($name), fields)?;
                    out.serialize_field("version", &$crate::persistence::Version)?;
                    $(out.serialize_field(stringify!($field), &$stored)?;)*
                    out.end()
                }
            }

            impl<'de, $($generics)*> serde::Deserialize<'de> for $crate::$($($module::)+)?$name$(<$($argument),*>)?
            where
                $($part: serde::Deserialize<'de>,)*
            {
                fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                    let $name { version: $crate::persistence::Version, $($field),* } =
                        serde::Deserialize::deserialize(from)?;
                    $built.map_err($crate::persistence::refused)
                }
            }
        };
    )*};
}
use stored;

stored! {
    [A: Transition, B: Likelihood] Hmm<A, B>: [A, B], |hmm| {
        prior: Prior = hmm.prior(),
        transition: A = hmm.transition(),
        likelihood: B = hmm.likelihood(),
        rounds_tails: bool = hmm.rounds_tails(),
    } => Self::new(prior, transition, likelihood).map(|hmm| hmm.rounding_tails(rounds_tails));
}

impl<S: AsRef<[f64]>> Serialize for Belief<S> {
    fn serialize<Out: Serializer>(&self, serializer: Out) -> Result<Out::Ok, Out::Error> {
        self.values().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Belief {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::new(Vec::deserialize(deserializer)?).map_err(refused)
    }
}

impl Serialize for Groups {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.as_slice().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Groups {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::new(Vec::deserialize(deserializer)?).map_err(refused)
    }
}
