//! Families of observations whose parameters are learned (feature `emission`).
//!
//! An observation is a row of d numbers, `[f64]`; [`Rows`] makes a sequence of a T × d matrix
//! without copying it, a d × T matrix of faer is one after `try_as_col_major`, and `Series` reads
//! the columns of a CSV file (feature `csv`), in which texts such as `NA` may stand for missing
//! values. Each family is a [`Likelihood`](crate::Likelihood) with one set of parameters for each
//! state; it is learned by [`Hmm::learn`](crate::Hmm::learn) and draws observations for
//! [`Hmm::simulate`](crate::Hmm::simulate).
//!
//! | for | use |
//! |---|---|
//! | events that happen or not | [`Bernoulli::family`] |
//! | counts of events | [`Poisson::family`] |
//! | counts of several kinds in so many trials | [`Multinomial`] |
//! | durations and speeds | [`Gamma::family`], [`LogNormal::family`] |
//! | headings and other angles | [`VonMises::family`] |
//! | directions in d ≥ 2 dimensions | [`VonMisesFisher`] |
//! | vectors of real numbers | [`Gaussian`], [`GaussianMixture`] |
//! | the same with outliers | [`StudentT`] |
//! | outputs that depend on an input, or on the values before | [`LinearRegression`] |
//! | components of a distribution of your own | [`Independent`] of a [`Univariate`] |
//! | several sensors in one row, each with a family of its own | [`Product`] |
//!
//! Symbols (hmmlearn's `CategoricalHMM`) are observations of a
//! [`TableLikelihood`](crate::TableLikelihood), which needs no feature.
//!
//! # Layers
//!
//! In terms of the [formulas](crate::guide::formulas), a family is the b_i(y) of section 1, and
//! learning the M-step of section 9. Modules stand on those of the lines above them alone:
//!
//! ```text
//! error, check, special, rows, columns, series     errors, checks, functions, sequences of rows
//! family, clusters                                 a row's width; families from clusters
//! normal (Gaussian densities, their moments), concentration (of directions)
//! independent (and its distributions), gaussian
//! multinomial, von_mises_fisher, gaussian_mixture, student_t, linear_regression
//! product                                          several families in one row
//! start                                            models to begin learning with
//! ```

mod check;
mod clusters;
mod columns;
mod concentration;
mod error;
mod family;
mod gaussian;
mod gaussian_mixture;
mod independent;
mod linear_regression;
mod multinomial;
mod normal;
mod product;
mod rows;
#[cfg(feature = "csv")]
mod series;
mod special;
mod start;
mod student_t;
mod von_mises_fisher;

pub use clusters::{Clusters, StartFromClusters};
pub use error::EmissionError;
pub use family::Family;
pub use gaussian::Gaussian;
pub use gaussian_mixture::GaussianMixture;
pub use independent::{Bernoulli, Gamma, Independent, LogNormal, Poisson, Univariate, VonMises};
pub use linear_regression::LinearRegression;
pub use multinomial::Multinomial;
pub use normal::{CovarianceType, GaussianPrior, GaussianStatistics};
pub use product::Product;
pub use rows::Rows;
#[cfg(feature = "csv")]
pub use series::Series;
pub use start::starts;
pub use student_t::StudentT;
pub use von_mises_fisher::VonMisesFisher;
