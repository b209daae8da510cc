//! Families of observations whose parameters are learned (feature `emission`).
//!
//! An observation is a row of d numbers, `[f64]`; [`Rows`] makes a sequence of a T × d matrix
//! without copying it, [`Columns`] of a d × T matrix of faer, and `Series` reads the columns of a CSV
//! file (feature `csv`), or `SeriesReader`, if texts such as `NA` stand for missing values. Each
//! family is a [`Likelihood`](crate::Likelihood) with one set of parameters for each state; it is
//! learned by [`Hmm::learn`](crate::Hmm::learn) and draws observations for
//! [`Hmm::simulate`](crate::Hmm::simulate).
//!
//! | for | use |
//! |---|---|
//! | events that happen or not | [`Bernoulli`] |
//! | counts of events | [`Poisson`] |
//! | counts of several kinds in so many trials | [`Multinomial`] |
//! | durations and speeds | [`Gamma`], [`LogNormal`] |
//! | headings and other angles | [`VonMises`] |
//! | directions in d ≥ 2 dimensions | [`VonMisesFisher`] |
//! | vectors of real numbers | [`Gaussian`], [`GaussianMixture`] |
//! | the same with outliers | [`StudentT`] |
//! | outputs that depend on an input, or on the values before | [`LinearRegression`] |
//! | components of a distribution of your own | [`Independent`] of a [`Univariate`] |
//! | several sensors in one row, each with a family of its own | [`Product`] |
//!
//! Symbols (hmmlearn's `CategoricalHMM`) are observations of a
//! [`TableLikelihood`](crate::TableLikelihood), which needs no feature.

mod bernoulli;
mod clustered;
mod clusters;
mod columns;
mod concentration;
mod error;
mod family;
mod gamma;
mod gaussian;
mod gaussian_mixture;
mod independent;
mod k_means;
mod linear_regression;
mod log_normal;
mod multinomial;
mod normal;
mod poisson;
mod product;
mod rows;
#[cfg(feature = "csv")]
mod series;
#[cfg(feature = "csv")]
mod series_reader;
mod special;
mod start;
mod student_t;
pub mod univariate;
mod von_mises;
mod von_mises_fisher;

pub use bernoulli::Bernoulli;
pub use clustered::{ClusteredObservations, StartFromClusters};
pub use clusters::Clusters;
pub use columns::Columns;
pub use error::EmissionError;
pub use family::Family;
pub use gamma::Gamma;
pub use gaussian::{Gaussian, GaussianStatistics};
pub use gaussian_mixture::{GaussianMixture, GaussianMixtureStatistics};
pub use independent::Independent;
pub use linear_regression::{LinearRegression, LinearRegressionStatistics};
pub use log_normal::LogNormal;
pub use multinomial::Multinomial;
pub use normal::{CovarianceType, GaussianPrior};
pub use poisson::Poisson;
pub use product::Product;
pub use rows::Rows;
#[cfg(feature = "csv")]
pub use series::Series;
#[cfg(feature = "csv")]
pub use series_reader::SeriesReader;
pub use start::starts;
pub use student_t::{StudentT, StudentTStatistics};
pub use univariate::Univariate;
pub use von_mises::VonMises;
pub use von_mises_fisher::VonMisesFisher;
