//! Families of observations whose parameters are learned (feature `emission`).
//!
//! An observation is a row of d numbers, `[f64]`. [`Rows`] makes a sequence of a T × d matrix
//! without copying it, a d × T matrix of faer is one after `try_as_col_major`, and `Series` reads
//! columns of a CSV file (feature `csv`), in which texts such as `NA` may stand for missing values.
//! Each family is a [`Likelihood`](wayfix::Likelihood) with one set of parameters for each state;
//! [`Hmm::learn`](wayfix::Hmm::learn) learns it, and [`Hmm::simulate`](wayfix::Hmm::simulate) draws
//! observations from it.
//!
//! | for | use |
//! |---|---|
//! | events that happen or not | [`Bernoulli::family`] |
//! | counts of events | [`Poisson::family`] |
//! | counts of clustered events, with a variance above the mean | [`NegativeBinomial::family`] |
//! | successes in a known number of trials | [`Binomial::family`] |
//! | counts of several kinds in a number of trials | [`Multinomial`] |
//! | counts with more or fewer zeros than these have | [`ZeroInflated`], [`Hurdle`] |
//! | positive numbers that are sometimes exactly 0 | [`ZeroInflated`] |
//! | times until the next event | [`Exponential::family`] |
//! | durations and speeds | [`Gamma::family`], [`LogNormal::family`], [`Weibull::family`] |
//! | shares | [`Beta::family`] |
//! | headings and other angles | [`VonMises::family`], with heavy tails [`WrappedCauchy::family`] |
//! | returns, skewed and with heavy tails | [`SkewedT::family`] |
//! | directions in d ≥ 2 dimensions | [`VonMisesFisher`] |
//! | vectors of real numbers | [`Gaussian`], [`GaussianMixture`] |
//! | vectors with outliers | [`StudentT`] |
//! | outputs that depend on an input, or on previous values | [`LinearRegression`] |
//! | components with a distribution of your own | [`Independent`] of a [`Univariate`] |
//! | several sensors in one row, each with its own family | [`Product`] |
//!
//! The fit of a model shows in its [pseudo-residuals](wayfix::Hmm::pseudo_residuals), the positions
//! of observations in the distributions that the model predicts. The distribution of the next
//! observation is [`Filter::predictive`](wayfix::Filter::predictive). Both are about one number of
//! an observation: see [`Marginals`].
//!
//! Symbols (hmmlearn's `CategoricalHMM`) are observations of a
//! [`TableLikelihood`](wayfix::TableLikelihood), which needs no feature; only [`table_starts`] is
//! here.
//!
//! # Layers
//!
//! In terms of the [formulas](wayfix::guide::formulas), a family is the b_i(y) of section 1, and
//! learning it is the M step of section 9. Modules use only those of the lines above them:
//!
//! ```text
//! error, check, special, rows, columns, series     errors, checks, functions, sequences of rows
//! tails                                            probabilities on both sides of a number
//! family, marginals, clusters                      a row's width; its numbers; families from clusters
//! normal (Gaussian densities, their moments), concentration (of directions)
//! independent (and its distributions), gaussian
//! multinomial, von_mises_fisher, gaussian_mixture, student_t, linear_regression
//! product                                          several families in one row
//! start, symbols                                   models to begin learning with; those of tables
//! residuals, predictive                            whether a model fits; the next observation
//! ```

#![cfg_attr(docsrs, feature(doc_cfg))]
#![allow(missing_docs)] // TEMP

mod check;
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
mod information;
mod jackknife;
mod linear_regression;
mod logit;
mod marginals;
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
mod standard_normal;
mod start;
mod student_t;
mod symbols;
mod tails;
mod von_mises_fisher;

pub use clusters::{Clusters, StartFromClusters, StartKind};
pub use error::EmissionError;
pub use family::Family;
pub use gaussian::Gaussian;
pub use gaussian_mixture::GaussianMixture;
pub use generator::{GeneratorStatistics, GeneratorTransition};
pub use independent::{
    Bernoulli, Beta, Binomial, Cumulative, Exponential, Gamma, Hurdle, Independent, LogNormal,
    NegativeBinomial, Poisson, SkewedT, Sums, Univariate, VonMises, Weibull, WrappedCauchy,
    ZeroInflated,
};
pub use linear_regression::LinearRegression;
pub use logit::{InputCounts, LogitTransition};
pub use marginals::Marginals;
pub use model_selection::{Candidate, ModelSelection};
pub use multinomial::Multinomial;
pub use normal::{CovarianceType, GaussianPrior, GaussianStatistics};
pub use predictive::Predictive;
pub use product::Product;
pub use residuals::PseudoResiduals;
pub use rows::Rows;
#[cfg(feature = "csv")]
pub use series::Series;
pub use standard_errors::StandardErrors;
pub use start::starts;
pub use student_t::StudentT;
pub use symbols::table_starts;
pub use tails::Tails;
pub use von_mises_fisher::VonMisesFisher;
