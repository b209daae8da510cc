//! Families of observations whose parameters are learned (feature `emission`).
//!
//! An observation is a row of d numbers, `[f64]`; [`Rows`] makes a sequence of a T × d matrix
//! without copying it. Each family is a [`Likelihood`](crate::Likelihood) with one set of
//! parameters for each state; it is learned by [`Hmm::learn`](crate::Hmm::learn) and draws
//! observations for [`Hmm::simulate`](crate::Hmm::simulate).
//!
//! Symbols (hmmlearn's `CategoricalHMM`) are observations of a
//! [`TableLikelihood`](crate::TableLikelihood), which needs no feature.

mod error;
mod gaussian;
mod gaussian_mixture;
mod normal;
mod rows;

pub use error::EmissionError;
pub use gaussian::{Gaussian, GaussianStatistics};
pub use gaussian_mixture::{GaussianMixture, GaussianMixtureStatistics};
pub use normal::{CovarianceType, GaussianPrior};
pub use rows::{Rows, RowsError};
