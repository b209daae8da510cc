//! Hidden Markov models for statisticians: families of observations whose parameters are learned,
//! covariates, continuous time, model choice, standard errors and residuals, on the exact inference
//! of [`wayfix`].
//!
//! ```
//! use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
//! use wayfix::{Hmm, inference::LearningOptions};
//! use wayfix_learn::{Poisson, Predictive, starts};
//!
//! // Calls in each of 24 hours. How busy are quiet and busy hours, and which are which?
//! let calls = [3, 1, 2, 4, 2, 9, 14, 11, 8, 12, 10, 2, 3, 1, 0, 2, 13, 9, 11, 10, 3, 2, 1, 4];
//! let calls = calls.map(|count| [f64::from(count)]);
//! let family = Poisson::family(&[[1.0], [1.0]])?; // a placeholder: counts, in two states
//! let starts = starts(&family, &[&calls], 5, &mut ChaCha8Rng::seed_from_u64(1))?;
//! let learned = Hmm::learn_best(&starts, &[&calls], &LearningOptions::default(), |_, _| ())?;
//!
//! let hmm = learned.model();
//! println!("rates {:?}, BIC {}", hmm.likelihood().parameters(Poisson::rate), learned.criteria().bic());
//! assert_eq!(hmm.viterbi(&calls)?.states()[4..7], [0, 1, 1]); // it became busy in the sixth hour
//! let mut filter = hmm.filter();
//! calls.iter().try_for_each(|count| filter.step(count).map(drop))?;
//! assert_eq!(Predictive::ahead(&filter, 1, 0)?.quantile(0.5)?, 2.0); // median of the next hour
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! An observation is a row of d numbers, `[f64]`. A sequence of them is a slice of rows, a T × d
//! matrix in [`Rows`] (without a copy), a d × T matrix of faer after `try_as_col_major`, or columns
//! of a CSV file in `Series` (feature `csv`), where texts such as `NA` may stand for missing values.
//! Each family is a [`Likelihood`](wayfix::Likelihood) with one set of parameters for each state:
//! [`Hmm::learn`](wayfix::Hmm::learn) estimates them, and all other methods of
//! [`Hmm`](wayfix::Hmm) (filter, smoother, Viterbi, simulation) work with them.
//!
//! # Families
//!
//! | data | family |
//! |---|---|
//! | events that happen or not | [`Bernoulli`] |
//! | counts of events | [`Poisson`] |
//! | counts of clustered events, with a variance above the mean | [`NegativeBinomial`] |
//! | successes in a known number of trials | [`Binomial`] |
//! | counts of several kinds in a number of trials | [`Multinomial`] |
//! | counts with more or fewer zeros than these have | [`ZeroInflated`], [`Hurdle`] |
//! | positive numbers that are sometimes exactly 0 | [`ZeroInflated`] |
//! | times until the next event | [`Exponential`] |
//! | durations and speeds | [`Gamma`], [`LogNormal`], [`Weibull`] |
//! | shares | [`Beta`] |
//! | headings and other angles | [`VonMises`], with heavy tails [`WrappedCauchy`] |
//! | directions in d ≥ 2 dimensions | [`VonMisesFisher`] |
//! | vectors of real numbers | [`Gaussian`], [`GaussianMixture`] |
//! | vectors with outliers, such as returns | [`StudentT`] |
//! | outputs that depend on inputs, or on previous values | [`LinearRegression`] |
//! | components with a distribution of your own | [`Independent`] of a [`Univariate`] |
//! | several sensors in one row, each with its own family | [`Product`] |
//!
//! Distributions of one number have a constructor `family`, such as [`Poisson::family`], which
//! takes a row of parameters for each state. Families accept missing components (NaN) and priors if
//! you ask for them: `with_missing`, `with_prior`. Symbols (hmmlearn's `CategoricalHMM`) are
//! observations of a [`TableLikelihood`](wayfix::TableLikelihood).
//!
//! # From data to a model
//!
//! | question | use |
//! |---|---|
//! | Where does learning begin? | [`starts`], of several [kinds](StartKind); [`table_starts`] for symbols |
//! | How many states? Which family? | [`ModelSelection`]: AIC, BIC and the likelihood of held-out sequences |
//! | Does the model fit? | [`PseudoResiduals::new`]: forecast and ordinary residuals, uniform, normal or randomised |
//! | How certain are the parameters? | [`StandardErrors::from_likelihood`], for one long sequence too; [`StandardErrors::from_jackknife`], for many, even if the model is not true |
//! | What comes next? | [`Predictive::ahead`]: density, tails, quantiles and draws of an observation to come; [`Predictive::ahead_with`] under covariates |
//!
//! Residuals and predictive distributions are about one number of an observation: see [`Marginals`].
//!
//! # Covariates and time
//!
//! - **Moves that depend on covariates**: [`LogitTransition`], a multinomial logit out of each
//!   state (input–output HMMs, time-varying transition probabilities), learned by Newton's method
//!   with or without a ridge. The covariates of a step are its [control](wayfix::Controlled).
//! - **Observations that depend on covariates**, or on previous observations:
//!   [`LinearRegression`] of rows that begin with the inputs; [`Rows::lagged`] makes them of a
//!   series (Markov-switching autoregression).
//! - **Irregular times**: [`GeneratorTransition`], a continuous-time chain by its rates, with the
//!   time since the last observation as the control of a step.
//!
//! # Not included
//!
//! - Random effects and Bayesian estimation: all sequences share the parameters, which are point
//!   estimates.
//! - Covariates of families other than [`LinearRegression`] (generalised linear models), and of the
//!   rates of a [`GeneratorTransition`].
//! - General linear constraints and bounds on parameters.
//! - Formulas, factors and plots: inputs are columns of numbers.
//!
//! The [guide] has the names of [hmmlearn](guide::from_hmmlearn) and of [depmixS4, momentuHMM and
//! others of R](guide::from_depmixs4_and_momentuhmm) with the conventions that differ, and chapters
//! on [rows with labels](guide::labels) at some steps and on [storing models](guide::storing). In
//! terms of the [formulas](wayfix::guide::formulas), a family is the b_i(y) of section 1, and
//! learning it is the M step of section 9.
//!
//! # Crate features
//!
//! - **`csv`**: `Series`, columns of numbers from CSV files.
//! - **`rayon`**: sequences, starts and groups of the jackknife in parallel, with identical results.
//! - **`serde`**: families and operators as JSON or in any other format of [serde](https://serde.rs),
//!   exact to the bit; the chapter on [storing](guide::storing) lists the fields.

#![cfg_attr(docsrs, feature(doc_cfg))]

mod clusters;
mod concentration;
mod curvature;
mod error;
mod family;
mod gaussian;
mod gaussian_mixture;
mod generator;
pub mod guide;
mod independent;
mod linear_regression;
mod logit;
mod model_selection;
mod multinomial;
mod normal;
mod predictive;
mod product;
mod residuals;
mod rows;
#[cfg(feature = "csv")]
mod series;
mod special;
mod standard_errors;
mod start;
mod student_t;
mod tails;
mod von_mises_fisher;

// Families of rows of numbers, and what they have in common.
pub use family::{Family, Marginals};
pub use gaussian::Gaussian;
pub use gaussian_mixture::GaussianMixture;
pub use linear_regression::LinearRegression;
pub use multinomial::Multinomial;
pub use normal::{CovarianceType, GaussianPrior, GaussianStatistics};
pub use product::Product;
pub use student_t::StudentT;
pub use von_mises_fisher::VonMisesFisher;

// Distributions of one number, and families of them.
pub use independent::{
    Bernoulli, Beta, Binomial, Cumulative, Exponential, ExtraZeros, Gamma, Hurdle, Independent,
    LogNormal, NegativeBinomial, Poisson, Sums, Univariate, VonMises, Weibull, WrappedCauchy,
    ZeroInflated,
};

// Moves that depend on covariates, and on elapsed time.
pub use generator::{GeneratorStatistics, GeneratorTransition};
pub use logit::{InputCounts, LogitTransition};

// Data.
pub use error::EmissionError;
pub use rows::Rows;
#[cfg(feature = "csv")]
pub use series::Series;

// Starts, model choice, standard errors, fit and forecasts.
pub use clusters::{Clusters, StartFromClusters, StartKind};
pub use model_selection::{Candidate, ModelSelection};
pub use predictive::Predictive;
pub use residuals::PseudoResiduals;
pub use standard_errors::StandardErrors;
pub use start::{starts, table_starts};
pub use tails::Tails;

/// Doc test of the README's example.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
